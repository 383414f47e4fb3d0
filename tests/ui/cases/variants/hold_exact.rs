//! A constant that is held.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: length = 75 mm exact;
        cluster lines on base { link a, b, c actuated length { length = radius + q; } }
        variant Full { arm full; }
        variant Basic = Full hold radius;
    }
}

fn main() {}

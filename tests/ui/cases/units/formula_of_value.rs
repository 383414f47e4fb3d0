//! A length from an angle.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: length = 75 mm;
        cluster lines on base { link a, b, c actuated angle { length = radius * q; } }
        variant Full { arm full; }
    }
}

fn main() {}

//! A held value, misspelt.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: length = 75 mm;
        cluster lines on base { link a, b, c actuated length { length = radius + q; } }
        variant Full { arm full; }
        variant Basic = Full hold raduis, all.track_ofset;
    }
}

fn main() {}

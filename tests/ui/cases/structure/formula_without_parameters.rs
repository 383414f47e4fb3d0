//! A formula of numbers alone.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length { track_offset = (1 m, 2 m, 3 mm); } }
        variant Full { arm full; }
    }
}

fn main() {}

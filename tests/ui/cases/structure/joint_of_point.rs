//! A plate joint where all links meet.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length { plate_joint = (1, 2, 3) mm; } }
        variant Full { arm full; }
    }
}

fn main() {}

//! Lines that all pull: none holds the plate.

tau_macro::tau_model! {
    robot Pulled {
        plate point in plane;
        cluster lines on base { link a, b, c actuated length { pulled = 10 N; } }
        variant Full { arm full; }
    }
}

fn main() {}

//! Two plates.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        plate body in plane;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
    }
}

fn main() {}

//! A reference that turns a point.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
        reference { position = (0, 0, 1) m; orientation = (0, 0, 0) rad; }
    }
}

fn main() {}

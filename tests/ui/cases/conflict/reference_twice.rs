//! Two references.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
        reference { position = (0, 0, 1) m; }
        reference { position = (0, 0, -1) m; }
    }
}

fn main() {}

//! A reference with fewer commands than drives.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
        reference { commands = (0, 0) m; position = (0, 0, 1) m; }
    }
}

fn main() {}

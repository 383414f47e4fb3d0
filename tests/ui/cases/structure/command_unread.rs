//! A driven length that does not follow its command.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param size: length;
        cluster lines on base { link a, b, c actuated length { length = size; } }
        variant Full { arm full; }
    }
}

fn main() {}

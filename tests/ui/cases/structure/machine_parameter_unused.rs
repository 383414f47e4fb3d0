//! A parameter of the machine that nothing reads.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param zero: length;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
    }
}

fn main() {}

//! A formula that breaks off.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param zero: length;
        cluster lines on base { link a, b, c actuated length { length = zero + ; } }
        variant Full { arm full; }
    }
}

fn main() {}

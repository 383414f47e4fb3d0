//! A length that follows a command which is none.

tau_macro::tau_model! {
    robot Arm {
        track one;
        param zero: length;
        cluster arm on one { link l1 { length = zero + q; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

//! A constant with a tolerance.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param zero: length = 1 m tol 1 mm exact;
        cluster lines on base { link a, b, c actuated length { length = zero + q; } }
        variant Full { arm full; }
    }
}

fn main() {}

//! One held line for a plate of two freedoms.

tau_macro::tau_model! {
    robot One {
        plate point in plane;
        cluster lines on base {
            link a actuated length;
            link b, c actuated length { pulled; }
        }
        variant Full { arm full; }
    }
}

fn main() {}

//! More links than freedoms of the plate and drives.

tau_macro::tau_model! {
    robot Stiff {
        plate point;
        track one;
        cluster arm on one { link a, b, c, d, e; }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

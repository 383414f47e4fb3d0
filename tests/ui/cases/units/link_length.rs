//! A link's length in degrees.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1 { length = 2 deg; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

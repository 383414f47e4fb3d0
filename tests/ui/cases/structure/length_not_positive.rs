//! A link of no length.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1 { length = -2 m tol 1 mm; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

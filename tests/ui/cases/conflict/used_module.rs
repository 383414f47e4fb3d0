//! A variant whose module would hide one that generated code uses.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Math { arm full; tracks linear; }
    }
}

fn main() {}

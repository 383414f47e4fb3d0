//! A keyword of Rust as a name.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant match { arm full; tracks linear; }
    }
}

fn main() {}

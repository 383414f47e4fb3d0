//! A name that is a keyword in generated code.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Match { arm full; tracks linear; }
    }
}

fn main() {}

//! Control flow among the declarations.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        for i in 0..3 { track t; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

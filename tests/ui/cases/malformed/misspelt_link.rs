//! A keyword in a cluster is misspelt.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { lnik l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

//! A root of a negative constant.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect backlash on cart {
            param gap: length;
            along += gap * sqrt(1 - 2) * direction;
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

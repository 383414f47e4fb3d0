//! An effect declared twice.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Full { arm full; tracks linear per link; }
        effect backlash on cart { param gap: length; along += gap * direction; }
        effect backlash on cart { param gap: length; along += gap; }
    }
}

fn main() {}

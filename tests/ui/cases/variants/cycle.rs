//! Variants that start from each other.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect backlash on cart { param gap: length; along += gap * direction; }
        variant Full { arm full; tracks linear per link; }
        variant Play = More + backlash(one);
        variant More = Last;
        variant Last = Play;
        variant After = Play;
    }
}

fn main() {}

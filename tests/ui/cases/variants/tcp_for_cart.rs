//! An effect on cart at the tcp.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect backlash on cart { param gap: length; along += gap * direction; }
        variant Full { arm full; tracks linear per link; }
        variant Play = Full + backlash(tcp);
    }
}

fn main() {}

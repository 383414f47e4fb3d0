//! All mistakes of a description are reported at once.

tau_macro::tau_model! {
    robot Slide {
        track one, two
        cluster arm1 on one { lnik l1; }
        cluster arm2 on two { link l2a l2b; }
        variant Full { arm ful; tracks linear; }
        effect rack_pitch on cart { param gap length; along += 1 mm; }
    }
}

fn main() {}

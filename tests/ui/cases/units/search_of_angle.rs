//! A searched parameter that is no length.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect rack_pitch on cart {
            param sine: length;
            search phase: angle in 0.1 rad ..= 3 rad;
            along += sine * sin(q / (1 m) + phase);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

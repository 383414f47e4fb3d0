//! A divisor that comes out as zero.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect backlash on cart {
            param gap: length;
            along += gap / (2 * 3 - 6);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

//! The argument of a sine is an angle or a number.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect rack_pitch on cart {
            param sine: length;
            along += sine * sin(2*pi*q);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

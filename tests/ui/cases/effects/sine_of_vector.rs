//! Functions take scalars.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect shift on tcp {
            param shift[3]: length;
            param turn[3]: angle;
            position += shift * sin(turn);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

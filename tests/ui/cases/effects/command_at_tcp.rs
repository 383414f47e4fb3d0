//! The tcp has no command of its own.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect shift on tcp {
            param gain: number;
            position += (gain * q, 0 m, 0 m);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

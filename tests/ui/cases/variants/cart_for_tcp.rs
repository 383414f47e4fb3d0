//! An effect on tcp at a cart.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect drift on tcp { param rate[3]: velocity; position += rate * time; }
        variant Full { arm full; tracks linear per link; }
        variant Drifting = Full + drift(one);
    }
}

fn main() {}

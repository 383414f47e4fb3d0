//! A rod has no drive of its own.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect slip on driven link {
            param gain: length;
            length += gain;
        }
        variant Full { arm full; tracks linear per link; }
        variant Slips = Full + slip(l2a);
    }
}

fn main() {}

//! Carts are driven always.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect slip on driven cart {
            param gain: length;
            along += gain;
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

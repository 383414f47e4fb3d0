//! Two searched parameters in one effect.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect rack_pitch on cart {
            param sine: length;
            search period: length in 4 mm ..= 50 mm;
            search slow: length in 60 mm ..= 1 m;
            along += sine * (sin(q / period) + sin(q / slow));
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

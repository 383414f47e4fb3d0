//! A search range that begins at zero, of whose reciprocal there is no grid.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect rack_pitch on cart {
            param sine: length;
            search period: length in 0 mm ..= 50 mm;
            along += sine * sin(q / period);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

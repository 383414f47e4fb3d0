//! A searched parameter that may be left out.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1; }
        effect rack on cart {
            optional search period: length in 4 mm ..= 50 mm;
            along += (1 um) * sin(2*pi*q/period);
        }
        variant Nominal { arm reduced; tracks linear; }
    }
}

fn main() {}

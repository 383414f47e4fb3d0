//! The fixed base is no track.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1; }
        cluster legs on base { link l2; }
        variant Full { arm full; tracks linear; track base piecewise; }
    }
}

fn main() {}

//! A plate joint of one number.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1 { plate_joint = 1 mm; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

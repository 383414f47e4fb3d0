//! A value that links do not have.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1 { plate_jont = (0, 0, 0) m; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

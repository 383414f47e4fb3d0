//! A robot that nothing drives.

tau_macro::tau_model! {
    robot Slide {
        cluster legs on base { link l1, l2; }
        variant Full { arm full; }
    }
}

fn main() {}

//! A robot of tracks only.

tau_macro::tau_model! {
    robot Slide {
        track one;
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

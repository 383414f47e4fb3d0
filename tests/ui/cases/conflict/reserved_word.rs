//! A word of the language as a name.

tau_macro::tau_model! {
    robot Slide {
        track all;
        cluster arm1 on all { link l1; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

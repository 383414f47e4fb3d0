//! A cluster that does not say what carries it.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 { link l1; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

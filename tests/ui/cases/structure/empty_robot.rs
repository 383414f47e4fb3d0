//! A robot without parts.

tau_macro::tau_model! {
    robot Slide { }
}

fn main() {}

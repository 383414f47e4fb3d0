//! A robot without braces.

tau_macro::tau_model! {
    robot Slide;
}

fn main() {}

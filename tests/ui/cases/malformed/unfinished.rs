//! The description ends in the middle.

tau_macro::tau_model! {
    pub robot
}

fn main() {}

//! Nothing at all.

tau_macro::tau_model! {}

fn main() {}

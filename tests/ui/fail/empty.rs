//! Nothing at all: without a token to point at, rustc points at the macro.

tau_macro::tau_model! {}

fn main() {}

//! A body on three legs.

tau_macro::tau_model! {
    robot Under {
        cluster legs on base { link a, b, c actuated length; }
        variant Full { arm full; }
    }
}

fn main() {}

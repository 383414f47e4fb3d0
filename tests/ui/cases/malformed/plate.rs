//! A plate of another kind.

tau_macro::tau_model! {
    robot Lines {
        plate pointt;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
    }
}

fn main() {}

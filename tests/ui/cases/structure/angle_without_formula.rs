//! A length that an angle drives, nobody knows how.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated angle; }
        variant Full { arm full; }
    }
}

fn main() {}

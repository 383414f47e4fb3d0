//! A strut that pulls by nothing.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; link d { pulled; } }
        variant Full { arm full; }
    }
}

fn main() {}

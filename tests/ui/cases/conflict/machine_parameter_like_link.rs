//! A parameter of the machine with the name of a link.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param a: length = 1 m;
        cluster lines on base { link a, b, c actuated length { length = a + q; } }
        variant Full { arm full; }
    }
}

fn main() {}

//! A reference in the plane without its position, whose help the language takes.

tau_macro::tau_model! {
    robot Belts {
        plate point in plane;
        cluster belts on base { link a, b actuated length; }
        variant Full { arm full; }
        reference { commands = (1, 1) m; }
    }
}

fn main() {}

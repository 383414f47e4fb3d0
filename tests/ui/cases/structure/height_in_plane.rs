//! A reference above the plane.

tau_macro::tau_model! {
    robot Belts {
        plate point in plane;
        cluster belts on base { link a, b actuated length; }
        variant Full { arm full; }
        reference { position = (1, 2, 0.1) m; }
    }
}

fn main() {}

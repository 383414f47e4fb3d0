//! One unit for lengths and angles.

tau_macro::tau_model! {
    robot Mixed {
        plate point in plane;
        crank one;
        cluster arm on one { link l1; }
        cluster line on base { link l2 actuated length; }
        variant Full { arm full; }
        reference { commands = (0, 1) m; position = (1, 2, 0) m; }
    }
}

fn main() {}

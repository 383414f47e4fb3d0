//! A crank that would turn its link out of the plane of the plate.

tau_macro::tau_model! {
    robot FiveBar {
        plate point in plane;
        crank left { axis = (1, 0, 0) exact; centre = (-100, 0, 0) mm exact; }
        crank right { axis = (0, 0, 1) exact; centre = (100, 0, 0) mm exact; }
        cluster on_left on left { link l1; }
        cluster on_right on right { link l2; }
        variant Full { arm full; }
    }
}

fn main() {}

//! A straight path on a crank.

tau_macro::tau_model! {
    robot Delta {
        plate point;
        crank one, two, three;
        cluster a on one { link l1 { track_direction = (1, 0, 0); } }
        cluster b on two { link l2; }
        cluster c on three { link l3; }
        variant Full { arm full; }
    }
}

fn main() {}

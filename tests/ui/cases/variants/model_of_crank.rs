//! A straight crank.

tau_macro::tau_model! {
    robot Bars {
        plate point in plane;
        crank one, two;
        cluster a on one { link l1; }
        cluster b on two { link l2; }
        variant Full { track one linear; }
    }
}

fn main() {}

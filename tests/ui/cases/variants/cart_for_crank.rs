//! An effect on carts at a crank.

tau_macro::tau_model! {
    robot Bars {
        plate point in plane;
        crank one, two;
        cluster a on one { link l1; }
        cluster b on two { link l2; }
        effect lag on cart { param size: length; along += size; }
        variant Full { arm full; }
        variant Late = Full + lag(one);
    }
}

fn main() {}

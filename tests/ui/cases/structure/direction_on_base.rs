//! A track direction on the fixed base.

tau_macro::tau_model! {
    robot Slide {
        cluster legs on base { link l1 actuated length { track_direction = (1, 0, 0); } }
        variant Full { arm full; }
    }
}

fn main() {}

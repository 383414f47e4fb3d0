//! A robot without tracks.

tau_macro::tau_model! {
    robot Slide {
        cluster legs on base { link l1, l2 actuated length; }
        variant Full { arm full; tracks piecewise; }
    }
}

fn main() {}

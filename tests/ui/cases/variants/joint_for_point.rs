//! An effect on plate joints where links meet in a point.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        effect placement on link { param offset[3]: length; joint += offset; }
        variant Full { arm full; }
        variant Off = Full + placement(a);
    }
}

fn main() {}

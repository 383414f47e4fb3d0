//! A parameter of two components: one mistake, said once.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius[2]: length = 75 mm;
        cluster lines on base { link a, b, c actuated length { length = radius + q; } }
        variant Full { arm full; }
    }
}

fn main() {}

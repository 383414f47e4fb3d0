//! Joints of all links held where there are none: one mistake, said once.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
        variant Basic = Full hold all.plate_joint;
    }
}

fn main() {}

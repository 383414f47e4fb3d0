//! Axes held on a machine without cranks.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        variant Full { arm full; }
        variant Basic = Full hold all.axis;
    }
}

fn main() {}

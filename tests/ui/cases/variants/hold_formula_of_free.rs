//! A value among those held follows from a parameter that is fitted.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param height: length = 2 m;
        cluster lines on base {
            link a actuated length { track_offset = (0 m, 1 m, height); }
            link b, c actuated length;
        }
        variant Full { arm full; }
        variant Basic = Full hold all.track_offset;
    }
}

fn main() {}

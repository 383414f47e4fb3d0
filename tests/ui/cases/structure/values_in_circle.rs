//! Values that read each other.

tau_macro::tau_model! {
    robot Strange {
        track one;
        cluster arm on one { link l1 { plate_joint = 2 * track_offset; track_offset = plate_joint / 2; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

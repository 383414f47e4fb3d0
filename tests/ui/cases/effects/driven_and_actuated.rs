//! One word says which links are meant.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: m/rad = 75 mm/rad exact;
        cluster lines on base {
            link a actuated angle { length = norm(track_offset) + radius * q; }
            link b, c actuated length;
        }
        effect e on driven link actuated angle {
            param gain: number;
            length += gain * length;
        }
        variant Full { arm full; }
    }
}

fn main() {}

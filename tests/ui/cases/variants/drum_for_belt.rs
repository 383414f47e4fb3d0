//! An effect of drums needs a drum.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: m/rad = 75 mm/rad exact;
        cluster lines on base {
            link a actuated angle { length = norm(track_offset) + radius * q; }
            link b, c actuated length;
        }
        effect e on link actuated angle {
            param gain: number;
            length += gain * paid_out;
        }
        variant Full { arm full; }
        variant Off = Full + e(b);
    }
}

fn main() {}

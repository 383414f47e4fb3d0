//! Links are pulled, carts are not.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: m/rad = 75 mm/rad exact;
        cluster lines on base {
            link a actuated angle { length = norm(track_offset) + radius * q; }
            link b, c actuated length;
        }
        effect e on pulled cart {
            param gain: number;
            along += gain * q;
        }
        variant Full { arm full; }
    }
}

fn main() {}

//! A cluster with the name of a track.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster one on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

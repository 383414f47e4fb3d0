//! A track whose exact direction is nowhere.

tau_macro::tau_model! {
    robot Slide {
        plate point;
        track one, two, three;
        cluster a on one { link l1 { track_direction = (0, 0, 0) exact; } }
        cluster b on two { link l2 { track_direction = (0, 1, 0) exact; } }
        cluster c on three { link l3; }
        variant Full { tracks linear; }
    }
}

fn main() {}

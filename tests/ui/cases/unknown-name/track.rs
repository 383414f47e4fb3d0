//! A cluster on a track that is not declared.

tau_macro::tau_model! {
    robot Slide {
        track one, two, three;
        cluster arm1 on one { link l1; }
        cluster arm2 on tow { link l2; }
        cluster arm3 on three { link l3; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

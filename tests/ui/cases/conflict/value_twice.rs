//! A link's value given twice.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1 { length = 2 m; length = 3 m; } }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

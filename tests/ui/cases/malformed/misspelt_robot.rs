//! The first keyword is misspelt.

tau_macro::tau_model! {
    robto Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

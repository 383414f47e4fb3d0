//! A driven length on a cart.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm1 on one { link l1 actuated length; }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

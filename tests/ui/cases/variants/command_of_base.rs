//! A link on the fixed base has no cart.

tau_macro::tau_model! {
    robot Slide {
        cluster legs on base { link l1; link l2 actuated length; }
        effect stretch on link { param rate: number; length += rate * q; }
        variant Full { arm full; }
        variant Stretched = Full + stretch(l1);
    }
}

fn main() {}

//! An effect at a link that is not declared.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Full { arm full; tracks linear per link; }
        effect strain on link { param rate: 1/N; length += length * rate * tension; }
        variant Strained = Full + strain(l2c);
    }
}

fn main() {}

//! The same effect at the same place, with an optional parameter.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect rack on cart {
            param first: length;
            optional param second: length;
            along += first * q/(1 m) + second * (q/(1 m))^2;
        }
        variant Full { arm full; tracks linear per link; }
        variant Bent = Full + rack(one) + rack(one) with second;
    }
}

fn main() {}

//! A reduced arm has no plate joints.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Nominal { arm reduced; tracks linear; }
        effect placement on link { param shift[3]: length; joint += shift; }
        variant Shifted = Nominal + placement(l1);
    }
}

fn main() {}

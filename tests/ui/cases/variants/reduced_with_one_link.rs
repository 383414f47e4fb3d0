//! A reduced arm has one length per cluster.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Nominal { arm reduced; tracks linear; }
        effect longer on link { param more: length; length += more; }
        variant Longer = Nominal + longer(l1) + longer(l2a);
    }
}

fn main() {}

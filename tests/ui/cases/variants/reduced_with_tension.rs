//! A reduced arm does not know the forces in single links.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Nominal { arm reduced; tracks linear; }
        effect strain on link { param rate: 1/N; length += length * rate * tension; }
        variant Strained = Nominal + strain(all);
    }
}

fn main() {}

//! A reduced arm has one length per cluster.

tau_macro::tau_model! {
    robot Slide {
        cluster legs on base { link l1, l2 actuated length; }
        variant Nominal { arm reduced; }
    }
}

fn main() {}

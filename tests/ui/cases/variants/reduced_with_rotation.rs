//! A reduced arm has no lever arms.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        variant Nominal { arm reduced; tracks linear; }
        effect tilt on cart { param rate: rad/m; roll += rate * q; }
        variant Tilted = Nominal + tilt(one);
    }
}

fn main() {}

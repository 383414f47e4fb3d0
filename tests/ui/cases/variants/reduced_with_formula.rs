//! A reduced arm of links whose values are formulas.

tau_macro::tau_model! {
    robot Arm {
        track one;
        param size: length = 2 m;
        cluster arm on one { link l1 { length = size; } }
        variant Nominal { arm reduced; tracks linear; }
    }
}

fn main() {}

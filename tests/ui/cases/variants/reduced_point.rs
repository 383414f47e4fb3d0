//! A reduced arm of a point.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        cluster lines on base { link a, b, c actuated length; }
        variant Nominal { arm reduced; }
    }
}

fn main() {}

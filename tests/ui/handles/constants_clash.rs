//! Two parameters that would be one constant, and a variant that would be the robot.

extern crate self as tau;
pub use tau_runtime as runtime;

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Nominal { arm reduced; tracks linear; }
        effect shift on cart { param a, A: length; along += a - A; }
        variant Shifted = Nominal + shift(one);
        variant Robot { arm full; tracks linear; }
    }
}

fn main() {
    let _ = Slide;
}

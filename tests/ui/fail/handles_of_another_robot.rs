//! A variant that the robot does not have, and a variant and a parameter of another robot.

extern crate self as tau;
pub use tau_runtime as runtime;

tau_macro::tau_model! {
    pub robot Slide {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Nominal { arm reduced; tracks linear; }
        effect bend on cart { param rate: 1/length; vertical += rate * q^2; }
        variant Bent = Nominal + bend(one);
    }
}

tau_macro::tau_model! {
    pub robot Other {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Nominal { arm reduced; tracks linear; }
    }
}

fn calibrate<R: runtime::DeclaredRobot>(
    _: runtime::VariantHandle<R>,
    _: runtime::ParameterHandle<R>,
) {
}

fn main() {
    let _ = Slide::BNET;
    calibrate::<Slide>(Slide::BENT, slide::bent::BEND_ONE_RATE);
    calibrate::<Slide>(Other::NOMINAL, other::nominal::ARM_LENGTH);
}

//! A mistake in a description is the only one reported: uses of the robot and of its variants raise none.

use tau::runtime::{DeclaredRobot, VariantHandle};

tau::tau_model! {
    pub robot Slide {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Nominal { arm reduced; tracks linear; }
        effect bend on cart { param rate: 1/length; vertical += rat * q^2; }
        variant Bent = Nominal + bend(one);
    }
}

fn name<R: DeclaredRobot>(variant: VariantHandle<R>) -> &'static str {
    variant.name()
}

fn main() {
    println!("{} of {}", name(Slide::BENT), Slide::ROBOT.name);
    println!("{:?}", Slide::NOMINAL);
}

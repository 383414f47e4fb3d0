//! A parameter that the variant does not have, and one that another variant has.

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

fn main() {
    let _ = slide::bent::BEND_ONE_RAET;
    let _ = (slide::bent::BEND_ONE_RATE, slide::nominal::BEND_ONE_RATE);
}

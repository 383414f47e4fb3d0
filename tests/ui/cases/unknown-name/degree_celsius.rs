//! A temperature in degrees Celsius.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on two { link l2a, l2b; }
        effect warm on link {
            param expansion: 1/K tol 5 ppm/K;
            length += length * expansion * (temperature - 20 degC);
        }
        variant Full { arm full; tracks linear per link; }
    }
}

fn main() {}

//! All mistakes at once, each under its own tokens: one, several, and over lines.

tau_macro::tau_model! {
    robot Slide {
        track one, two;
        cluster arm1 on one { link l1; }
        cluster arm2 on tow { link l2a, l2b, l2c, l2d, l2e; }
        effect tilt on cart {
            param angle: rad;
            along += angle + q;
            roll += angle
                + q;
        }
        variant Full { arm full; tracks linear; }
        variant Tilted = Full + tlit(two);
    }
}

fn main() {}

//! A catalogue of effects is not a robot.

tau_macro::tau_model! {
    effect drift on tcp {
        param rate[3]: velocity;
        position += rate * time;
    }
}

fn main() {}

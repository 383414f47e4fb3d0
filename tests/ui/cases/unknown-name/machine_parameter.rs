//! A parameter of the machine that is misspelt.

tau_macro::tau_model! {
    robot Lines {
        plate point;
        param radius: length = 75 mm;
        cluster lines on base { link a, b, c actuated length { length = raduis + radius + q; } }
        variant Full { arm full; }
    }
}

fn main() {}

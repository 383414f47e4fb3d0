//! Links without drives that hold the plate where it is.

tau_macro::tau_model! {
    robot Frame {
        track one;
        cluster struts on base { link s1, s2, s3, s4, s5; }
        cluster arm on one { link a, b; }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {}

//! A name with a prefix that only Rust has.

tau_macro::tau_model! {
    robot Slide {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant r#match { arm reduced; tracks linear; }
    }
}

fn main() {}

//! The same promises on more machines.

use proptest::prelude::*;

use crate::derivatives::{check_description, descriptions};

proptest! {
    #![proptest_config(ProptestConfig { cases: 250, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_carts_agree_with_dual_numbers(text in descriptions::carts(), seed in 0_u64..1_000_000) {
        check_description(&text, seed..seed + 1);
    }

    #[test]
    fn random_machines_agree_with_dual_numbers(text in descriptions::machines(), seed in 0_u64..1_000_000) {
        check_description(&text, seed..seed + 1);
    }
}

#[test]
fn many_long_ways_are_followed_in_one_assembly_mode() {
    crate::kinematics::check_long_ways(60, 200);
}

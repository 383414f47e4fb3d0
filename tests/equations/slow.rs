//! The same promises on more machines.

#[test]
fn many_long_ways_are_followed_in_one_assembly_mode() {
    crate::kinematics::check_long_ways(60, 200);
}

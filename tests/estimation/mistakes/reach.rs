//! What the program computed or advised is within the reach of the machine.

use tau_testkit::Work;

/// Poses that the program computed are reached again, at whatever end of the reach of a crank.
#[test]
fn cranks_reach_what_they_reached() {
    let rail = "--model ROBOTS/two_cranks_rail.tau";
    let work = Work::simulated(&format!("{rail} --seed 1 --random --poses 100"));
    let with = format!("{rail} --robot MEASURED/robot.toml --variant Full -q");
    for (way, from, to) in [
        ("forward", "MEASURED/tcp_poses.csv", "reached"),
        ("inverse", "DIR/reached.csv", "back"),
    ] {
        let line = format!("kinematics {way} {with} --poses {from} --out DIR/{to}.csv");
        work.run(&line).done();
    }
}

/// Steps that are advised for a grid hold with the turns that were asked for.
#[test]
fn an_advised_grid_is_within_reach() {
    advised_grid_is_within_reach("0.2", "0.3");
}

#[track_caller]
pub(crate) fn advised_grid_is_within_reach(tilt: &str, step: &str) {
    let work = Work::empty();
    let with = format!("simulate --model hexapod --tilt {tilt} --seed 2 --grid-step");
    let first = work.run(&format!("{with} {step},{step},{step} --out DIR/first"));
    assert!(first.says("T297"), "{}", first.err);
    let (_, advice) = first.err.split_once("--grid-step ").unwrap();
    let is_number = |own: char| own.is_ascii_digit() || ".,".contains(own);
    let end = advice.find(|own| !is_number(own)).unwrap_or(advice.len());
    let steps = advice[..end].trim_end_matches(',');
    let ran = work.run(&format!("{with} {steps} --out DIR/second"));
    assert!(ran.code == 0 && !ran.says("T297"), "{steps}: {}", ran.err);
}

//! Searches from variants that lack a full arm, or whose tracks follow measured points; and tracks that are found to.

use std::f64::consts::PI;
use std::sync::Arc;

use tau::discovery::results::{self, Motion, Target, Unnamed, Verdict};
use tau::discovery::{Discovery, Options, Status};
use tau::simulation::{CartError, CartReading, Effect, Physics, Simulation, simulate};
use tau_codegen::language::model::Place;
use tau_testkit::robots::{gantry_tau, prototype};
use tau_testkit::{Work, effects, list};

use crate::search::{at, remarks, searched, steps, trial};

/// The joints of these robots lie off the Tau configuration, so a reduced arm lacks the full one first.
#[test]
fn a_reduced_arm_lacks_the_full_one() {
    let found = trial("02").discovered("--base Nominal");
    assert_eq!(effects(&found), ["full_arm(all)", "rack_pitch(two)"]);
    assert_eq!(found["effects"][0]["name"], "full_arm");
    assert_eq!(found["base"], "Nominal");
    let first = &found["steps"][0]["model"];
    assert_eq!(first, "variant Discovered = Nominal;");
    let steps = steps(&found);
    assert!(steps.windows(2).all(|two| two[1] < two[0]), "{steps:?}");
    assert!((steps[2] - at(&found, "validation.after.mean_um")).abs() < 1e-9);
    // Removed and remaining errors add up to those that any method could remove.
    let [before, after] = ["before", "after"].map(|when| at(&found["validation"][when], "rms_um"));
    let removable = (before.powi(2) + at(&found, "remaining_um").powi(2) - after.powi(2)).sqrt();
    assert!((at(&found, "ceiling_um") / removable - 1.0).abs() < 0.02);
}

/// A stretch of links needs a full arm. Beside a reduced one it stays without a name, with the advice that leads to it.
#[test]
fn what_needs_a_full_arm_is_found_from_the_variant_that_is_advised() {
    const REDUCED_ARM: &str = "T641";
    let work = Work::simulated("--variant Nominal --effect link_compliance(l1):strain=1e-6");
    let reduced = work.discovered("--base Nominal");
    assert_eq!(reduced["status"], "unnamed_structure");
    assert_eq!(remarks(&reduced, REDUCED_ARM), 1);
    let full = work.discovered("--base Full");
    assert_eq!(effects(&full), ["link_compliance(l1)"]);
    assert_eq!(remarks(&full, REDUCED_ARM), 0);
}

/// If nothing is hidden, points that carry noise get no name, nor do carts that turn as they go; and the
/// residuals are as large as the stated noise says.
#[test]
fn the_noise_of_measured_points_gets_no_name() {
    for (base, expected) in [("BestPerLink", &[][..]), ("Piecewise", &["full_arm(all)"])] {
        let found = trial("01").discovered(&format!("--base {base}"));
        assert_eq!(effects(&found), expected, "{base}");
        assert!(list(&found["unnamed"]).is_empty(), "{base}");
        for noise in list(&found["noise"]) {
            assert!((at(noise, "factor") - 1.0).abs() < 0.1, "{base}: {noise}");
        }
    }
}

/// A held-out stretch of a measured path, which other blocks hardly determine, does not hide what they tell of an
/// effect.
#[test]
fn an_effect_is_confirmed_beside_measured_points() {
    let found = trial("03").discovered("--base BestPerLink");
    assert_eq!(effects(&found), ["backlash(one)"]);
    assert_eq!(found["status"], "explained");
    assert!(at(&found, "validation.after.mean_um") < 20.0);
}

/// A stretch of a track that lies off: its middle, its length, and how far it lies off horizontally and
/// vertically (m).
type Bump = (f64, f64, [f64; 2]);

/// Deviation of a cart at a command (m).
fn path(bumps: &[Bump], q_m: f64) -> [f64; 2] {
    let mut off = [0.0; 2];
    for (middle, length, height) in bumps {
        let at = (q_m - middle) / length;
        if at.abs() < 0.5 {
            let share = (PI * at).cos().powi(2);
            off[0] += share * height[0];
            off[1] += share * height[1];
        }
    }
    off
}

/// The search on a machine with one bent track.
fn bent(track: usize, bumps: &'static [Bump], seed: u64) -> Discovery {
    let (robot, file) = (gantry_tau(), prototype().1);
    let bent = move |at: &CartReading| {
        let [horizontal, vertical] = path(bumps, at.q_m);
        CartError {
            shift_m: [0.0, horizontal, vertical],
            turn_rad: [0.0; 3],
        }
    };
    let physics = Physics::Cart(Arc::new(bent));
    let place = Place::Cart {
        track,
        source: None,
    };
    let simulated = simulate(&Simulation {
        effects: vec![Effect::unlisted("bent", place, physics)],
        seed,
        ..Simulation::new(robot.clone(), file.clone())
    })
    .unwrap();
    let options = Options::default();
    searched((&robot, "Full"), &file, &simulated.folder, &options).discovery
}

fn cart(name: &str) -> results::Place {
    results::Place::Cart(name.to_owned())
}

/// A wavy track follows its measured points: the error at the tool falls to the noise, and what the points show
/// is the shape that was hidden.
#[test]
fn a_wavy_track_follows_its_points() {
    const BUMPS: &[Bump] = &[
        (-0.38, 0.25, [55e-6, -45e-6]),
        (-0.1, 0.28, [-50e-6, -60e-6]),
        (0.12, 0.22, [60e-6, 40e-6]),
        (0.38, 0.26, [-45e-6, 60e-6]),
    ];
    let found = bent(1, BUMPS, 0);
    assert!(found.effects.is_empty());
    assert_eq!(found.status, Status::UnnamedStructure);
    let places: Vec<_> = found.piecewise_tracks.iter().map(|t| &t.place).collect();
    assert_eq!(places, [&cart("two")]);
    assert!(found.unnamed.iter().all(|own| own.place == cart("two")));
    for (axis, target) in [Target::Horizontal, Target::Vertical]
        .into_iter()
        .enumerate()
    {
        let direction = Motion::Target(target, 0);
        let shown = found.unnamed.iter().find(|own| own.direction == direction);
        let left = off_a_line(shown.unwrap(), |q_m| path(BUMPS, q_m)[axis]);
        // They carry 10 µm of noise.
        assert!(left < 13e-6, "{direction}: {left}");
    }
    let lines: Vec<String> = (found.steps.iter())
        .map(|step| step.model.to_string())
        .collect();
    let expected = ["Full", "BestPerLink"].map(|base| format!("variant Discovered = {base};"));
    assert_eq!(lines, expected);
    assert!(found.model_text.contains(&lines[1]));
    let (before, after) = (found.validation.before, found.validation.after);
    assert!(
        after.mean_um < 0.85 * before.mean_um,
        "{before:?} {after:?}"
    );
    assert!(
        (after.mean_um / found.noise_floor_um - 1.0).abs() < 0.15,
        "{after:?}"
    );
    let noted = &found.considered[0];
    assert_eq!(
        (noted.name.as_str(), &noted.place),
        ("piecewise_track", &cart("two"))
    );
}

/// One stretch of a track is described, but the path stays straight where measured points are noisier than that.
#[test]
fn a_track_with_a_single_bump_stays_straight() {
    let found = bent(2, &[(0.1, 0.25, [0.0, 30e-6])], 3);
    assert!(found.effects.is_empty() && found.piecewise_tracks.is_empty());
    assert_eq!(found.status, Status::UnnamedStructure);
    assert!(!found.unnamed.is_empty());
    assert!(found.unnamed.iter().all(|own| own.place == cart("three")));
    assert_eq!(found.steps.len(), 1);
    let mut considered = found.considered.iter();
    let noted = considered.find(|own| own.name == "piecewise_track");
    assert_eq!(noted.unwrap().verdict, Verdict::NotConfirmed);
}

/// Root mean square of how far a curve lies off a shape, less a straight line, which the track itself may have.
fn off_a_line(shown: &Unnamed, shape: impl Fn(f64) -> f64) -> f64 {
    let off: Vec<(f64, f64)> = (shown.curve.iter())
        .map(|[q, d]| (*q, d - shape(*q)))
        .collect();
    let count = off.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| off.iter().map(of).sum::<f64>() / count;
    let (q, d) = (mean(&|at| at.0), mean(&|at| at.1));
    let slope = mean(&|at| (at.0 - q) * (at.1 - d)) / mean(&|at| (at.0 - q).powi(2));
    mean(&|at| (at.1 - d - slope * (at.0 - q)).powi(2)).sqrt()
}

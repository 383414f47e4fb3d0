//! Searches from variants that lack a full arm, or whose tracks follow measured points; and tracks that are found to.

use std::f64::consts::PI;
use std::sync::Arc;

use serde_json::Value;
use tau::simulation::{CartError, CartReading, Effect, Physics, Simulation, simulate};
use tau_codegen::language::model::Place;
use tau_testkit::{Work, effects, list};

use crate::kinds::gantry;
use crate::search::{assert_alike, at, of_effect, remarks, steps, trial};

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
    assert_alike(at(&found, "ceiling_um"), removable, 0.02);
}

/// A stretch of links needs a full arm. Beside a reduced one it stays without a name, with the advice that leads to it.
#[test]
fn what_needs_a_full_arm_is_found_from_the_variant_that_is_advised() {
    const REDUCED_ARM: &str = "T641";
    let work = Work::simulated(
        "--variant Nominal --random --poses 100 --cart-poses 60 --effect link_compliance(l1):strain=1e-6",
    );
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
    let found = trial("01").discovered("--base Piecewise");
    assert_eq!(effects(&found), ["full_arm(all)"]);
    assert!(list(&found["unnamed"]).is_empty());
    for noise in list(&found["noise"]) {
        assert_alike(at(noise, "factor"), 1.0, 0.1);
    }
}

/// A held-out stretch of a measured path, which other blocks hardly determine, does not hide what they tell of an
/// effect.
#[test]
fn an_effect_is_confirmed_beside_measured_points() {
    let found = trial("03").discovered("--base BestPerLink");
    assert_eq!(effects(&found), ["backlash(one)"]);
    // Paths through measured points have their noise, which the fit does not know.
    assert_eq!(found["status"], "partly_explained");
    assert!(at(&found, "validation.after.mean_um") < 20.0);
}

/// A stretch of a track that lies off: its middle, its length, and how far it lies off horizontally and
/// vertically (m).
pub(crate) type Bump = (f64, f64, [f64; 2]);

/// Deviation of a cart at a command (m), horizontally or vertically.
pub(crate) fn path(bumps: &[Bump], q_m: f64, axis: usize) -> f64 {
    let of = |(middle, length, height): &Bump| {
        let at = ((q_m - middle) / length).clamp(-0.5, 0.5);
        (PI * at).cos().powi(2) * height[axis]
    };
    bumps.iter().map(of).sum()
}

/// What is found in a machine with one bent track.
pub(crate) fn bent(machine: Simulation, track: usize, bumps: &'static [Bump]) -> Value {
    let bent = move |at: &CartReading| CartError {
        shift_m: [0.0, path(bumps, at.q_m, 0), path(bumps, at.q_m, 1)],
        turn_rad: [0.0; 3],
    };
    let physics = Physics::Cart(Arc::new(bent));
    let source = None;
    let place = Place::Cart { track, source };
    let simulated = simulate(&Simulation {
        effects: vec![Effect::unlisted("bent", place, physics)],
        ..machine
    });
    let work = Work::empty();
    simulated.unwrap().write(&work.measured()).unwrap();
    let found = work.discovered("");
    assert_eq!(effects(&found), [""; 0]);
    assert_eq!(found["status"], "unnamed_structure");
    found
}

/// The same place for all entries of a list.
#[track_caller]
pub(crate) fn assert_all_at(place: &str, entries: &Value) {
    let all = list(entries);
    let are_there = all.iter().all(|own| own["place"] == place);
    assert!(!all.is_empty() && are_there, "{entries}");
}

/// One stretch of a track is described, but the path stays straight where measured points are noisier than that.
#[test]
fn a_track_with_a_single_bump_stays_straight() {
    const NOT_CONFIRMED: &str = "T619";
    let found = bent(gantry(3), 2, &[(0.1, 0.25, [0.0, 30e-6])]);
    assert_eq!(found["piecewise_tracks"], Value::Null);
    assert_all_at("three", &found["unnamed"]);
    assert_eq!(list(&found["steps"]).len(), 1);
    let noted = of_effect(&found, "considered", "piecewise_track");
    assert_eq!(noted[0]["code"], NOT_CONFIRMED);
}

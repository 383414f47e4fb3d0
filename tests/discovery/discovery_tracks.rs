//! Carts whose tracks are bent in a way that no effect of the catalogue describes.

use std::f64::consts::PI;
use std::sync::Arc;

use tau::discovery::results::{self, Motion, Target, Unnamed, Verdict};
use tau::discovery::{Discovery, Options, Status, discover};
use tau::simulation::{CartError, CartReading, Effect, Physics, Simulation, simulate};
use tau_codegen::language::model::Place;

use crate::support::{gantry_tau, prototype};

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
fn searched(track: usize, bumps: &'static [Bump], seed: u64) -> Discovery {
    let (robot, file) = (gantry_tau(), prototype().1);
    let bent = move |at: &CartReading| {
        let [horizontal, vertical] = path(bumps, at.q_m);
        CartError {
            shift_m: [0.0, horizontal, vertical],
            turn_rad: [0.0; 3],
        }
    };
    let place = Place::Cart {
        track,
        source: None,
    };
    let simulated = simulate(&Simulation {
        effects: vec![Effect::unlisted(
            "bent",
            place,
            Physics::Cart(Arc::new(bent)),
        )],
        seed,
        ..Simulation::new(robot.clone(), file.clone())
    })
    .unwrap();
    let options = Options::default();
    discover(
        &robot,
        "Full",
        &file,
        &simulated.folder,
        &options,
        &mut |_| {},
    )
    .unwrap()
    .discovery
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
    let found = searched(1, BUMPS, 0);
    assert!(found.effects.is_empty());
    assert_eq!(found.status, Status::UnnamedStructure);
    let cart = |name: &str| results::Place::Cart(name.to_owned());
    let places: Vec<_> = found.piecewise_tracks.iter().map(|t| &t.place).collect();
    assert_eq!(places, [&cart("two")]);
    assert!(found.unnamed.iter().all(|own| own.place == cart("two")));
    let sideways = [Target::Horizontal, Target::Vertical];
    for (axis, target) in sideways.into_iter().enumerate() {
        let direction = Motion::Target(target, 0);
        let shown = found.unnamed.iter().find(|own| own.direction == direction);
        let left = off_a_line(shown.unwrap(), |q_m| path(BUMPS, q_m)[axis]);
        // They carry 10 µm of noise.
        assert!(left < 13e-6, "{direction}: {left}");
    }
    let lines = found.steps.iter().map(|step| step.model.to_string());
    let lines: Vec<String> = lines.collect();
    assert_eq!(
        lines,
        [
            "variant Discovered = Full;",
            "variant Discovered = BestPerLink;"
        ]
    );
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
    let found = searched(2, &[(0.1, 0.25, [0.0, 30e-6])], 3);
    assert!(found.effects.is_empty() && found.piecewise_tracks.is_empty());
    assert_eq!(found.status, Status::UnnamedStructure);
    let three = results::Place::Cart("three".to_owned());
    assert!(!found.unnamed.is_empty());
    assert!(found.unnamed.iter().all(|unnamed| unnamed.place == three));
    assert_eq!(found.steps.len(), 1);
    let noted = found
        .considered
        .iter()
        .find(|own| own.name == "piecewise_track");
    assert_eq!(noted.unwrap().verdict, Verdict::NotConfirmed);
}

/// Root mean square of how far a curve lies off a shape, less a straight line, which the track itself may have.
fn off_a_line(shown: &Unnamed, shape: impl Fn(f64) -> f64) -> f64 {
    let off = shown.curve.iter().map(|[q, d]| (*q, d - shape(*q)));
    let off: Vec<(f64, f64)> = off.collect();
    let count = off.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| off.iter().map(of).sum::<f64>() / count;
    let (q, d) = (mean(&|at| at.0), mean(&|at| at.1));
    let slope = mean(&|at| (at.0 - q) * (at.1 - d)) / mean(&|at| (at.0 - q).powi(2));
    mean(&|at| (at.1 - d - slope * (at.0 - q)).powi(2)).sqrt()
}

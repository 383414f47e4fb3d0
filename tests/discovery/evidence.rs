//! The evidence that discovery shows, against what was hidden.

use std::path::Path;

use tau::discovery::results::{Dimension, Discovery, Order, Pattern, Place, Readable};
use tau::discovery::{Options, discover};
use tau::measurements::{Folder, Shape};
use tau::robot_file::RobotFile;
use tau::simulation::{Effect, Noise, Simulation, simulate};

use crate::support::{gantry_tau, prototype};

fn search(folder: &Folder, file: &RobotFile) -> Discovery {
    let options = Options::default();
    discover(&gantry_tau(), "Full", file, folder, &options, &mut |_| {})
        .unwrap()
        .discovery
}

fn trial(name: &str) -> Discovery {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../data/trials")
        .join(name);
    let robot = gantry_tau();
    search(
        &Folder::read(&folder, &Shape::from(&robot)).unwrap(),
        &RobotFile::read(&folder.join("robot.toml"), &robot).unwrap(),
    )
}

fn simulated(effects: &[&str], serial: f64) -> Discovery {
    let (robot, file) = (gantry_tau(), prototype().1);
    let effects = effects
        .iter()
        .map(|text| Effect::parse(text, &robot, "--effect").unwrap())
        .collect();
    let measured = simulate(&Simulation {
        effects,
        noise: Noise {
            serial,
            ..Noise::default()
        },
        ..Simulation::new(robot, file)
    })
    .unwrap();
    search(&measured.folder, &measured.file)
}

fn is_flat(Pattern { bins, .. }: &Pattern) -> bool {
    !bins.is_empty() && bins.iter().all(|bin| bin.after.abs() < 4.0 * bin.sigma)
}

#[test]
fn a_spectrum_peaks_at_the_hidden_period_and_residuals_follow_it() {
    const PERIOD_M: f64 = 0.00942;
    let hidden = format!("rack_pitch(two): sine=3e-5, period={PERIOD_M}");
    let found = simulated(&[&hidden], 0.0);
    let [evidence] = &found.evidence[..] else {
        panic!("{:?}", found.effects);
    };
    let spectrum = evidence.spectrum.as_ref().unwrap();
    assert_eq!(
        (&spectrum.parameter[..], spectrum.unit),
        ("period", Dimension::LENGTH)
    );
    let highest =
        |points: &[[f64; 3]]| *points.iter().max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
    for points in [&spectrum.points, &spectrum.curve] {
        // Commands range over 1.4 m, so that peaks are 0.7 / m wide.
        let [period, before, _] = highest(points);
        assert!((period.recip() - PERIOD_M.recip()).abs() < 0.7, "{period}");
        assert!(before > 5.0 * spectrum.threshold, "{before}");
        assert!(points.iter().all(|point| point[2] < spectrum.threshold));
    }
    assert!(spectrum.points.len() <= 48);

    let [pattern] = &evidence.residuals[..] else {
        panic!("{:?}", evidence.residuals);
    };
    let shown = format!("{}, {}", pattern.place, pattern.target);
    assert_eq!(shown, "two, along");
    let period = pattern.period.unwrap();
    assert_eq!(pattern.bins.len(), 12);
    for bin in &pattern.bins {
        let hidden = 30.0 * (std::f64::consts::TAU * bin.at / period).sin();
        // Means over a twelfth of a period, of a signal of which the model absorbs some hundredths.
        assert!(
            (bin.before - hidden).abs() < 4.0 * bin.sigma + 3.0,
            "{bin:?}"
        );
    }
    assert!(is_flat(pattern), "{pattern:?}");
}

/// A gap of 119 µm is hidden in trial 03.
#[test]
fn residuals_against_the_side_of_approach_show_the_gap() {
    let found = trial("03");
    let [pattern] = &found.evidence[0].residuals[..] else {
        panic!("{:?}", found.evidence);
    };
    assert_eq!(pattern.against.readable, Readable::Direction);
    let [back, forth] = &pattern.bins[..] else {
        panic!("{:?}", pattern.bins);
    };
    assert_eq!((back.at, forth.at), (-1.0, 1.0));
    let gap = forth.before - back.before;
    // The base takes up some of it.
    assert!((0.65 * 119.0..119.0).contains(&gap), "{gap}");
    assert!(is_flat(pattern), "{pattern:?}");
    assert!(found.remaining_um < 0.2 * found.ceiling_um);
}

#[test]
fn serial_noise_is_told_from_white_noise() {
    let says_so = |found: &Discovery| {
        found
            .remarks
            .iter()
            .any(|remark| remark.text.contains("depend on each other"))
    };
    let serial = simulated(&[], 0.7);
    let found = serial.whiteness.as_ref().unwrap();
    assert_eq!(found.order, Order::Time);
    // Every other pose calibrates, so that neighbours correlate by 0.7².
    assert!((0.2..0.6).contains(&found.after.lag1), "{found:?}");
    assert!(found.after.p_value < 1e-4 && says_so(&serial));
    let white = simulated(&[], 0.0);
    let found = white.whiteness.as_ref().unwrap();
    assert!(found.after.p_value > 0.01 && !says_so(&white), "{found:?}");
}

/// The only link on a track looks like its track when both lengthen; three links of one cluster do not.
#[test]
fn look_alikes_are_listed_before_anything_is_found() {
    let found = trial("06");
    let is_pair = |a: (&str, &str), b: (&str, &str)| {
        found.ambiguous.iter().any(|pair| {
            let places = [&pair.place, &pair.with_place].map(ToString::to_string);
            let one = (&pair.name[..], &places[0][..]);
            let other = (&pair.with_name[..], &places[1][..]);
            (one, other) == (a, b) || (one, other) == (b, a)
        })
    };
    assert!(is_pair(("link_thermal", "l1"), ("track_thermal", "one")));
    assert!(!is_pair(
        ("link_thermal", "l3a"),
        ("track_thermal", "three")
    ));
    for pair in &found.ambiguous {
        assert!(pair.kappa > 0.64 && pair.kappa <= 1.0);
        assert!(pair.kappa_reverse <= pair.kappa && pair.kappa_reverse >= 0.0);
        let is_seen = |name: &str, place: &Place| {
            let mut seen = found.detectable.iter();
            seen.any(|other| other.name == name && other.place == *place)
        };
        assert!(is_seen(&pair.name, &pair.place) && is_seen(&pair.with_name, &pair.with_place));
    }
}

//! Starts of a fit: the nominal values, or, where they are those of a sketch, draws from their tolerances.

use std::collections::BTreeSet;

use tau_kinematics::{Machine, Pose, Sample};
use tau_robot::robot::{Owner, Parameter};
use tau_solver::{Method, Options};

use super::{RowDivision, UnknownPoses};
use crate::calibration::is_along_z;
use crate::machine::Error;
use crate::machine::nominal::Nominal;
use crate::machine::prepared::Prepared;
use crate::numerics::distribution::Random;

/// Draws that are tried beside the nominal values. Of redundant belts with anchors drawn half of the machine off, two
/// starts in a hundred lead elsewhere than to the machine at its reference.
const DRAWS: u64 = 8;
/// Tolerances of places beyond this share of the mean length of the links are those of a sketch: poses found by them may
/// be those of another assembly.
const SKETCH: f64 = 0.1;
/// Residuals for each parameter, beyond what poses take, by which a machine is found from a sketch. From where they
/// lead, all poses need some iterations, from the sketch dozens.
const ROWS_EACH: usize = 6;
/// Iterations after which a start is given up for the next. Of 409 descents of four belts drawn half of the machine off,
/// 385 arrive within 25 iterations, 392 within 40, eight more within 400, and nine nowhere: from there on another start is
/// the shorter way (M. Luby, A. Sinclair and D. Zuckerman, Inf. Process. Lett. 47, 1993).
pub(super) const DESCENT: usize = 40;
/// Iterations after which a fit at the stated noise is given up: those that arrive take dozens, those of a model that misses
/// far more than the noise creep along valleys in thousands.
const CREEPING: usize = 300;
/// Poses up to which the solver is told to eliminate each; of more it does so by itself.
const FEW: usize = 1000;
/// Standard deviation of a reference, as a share of the mean length of the links: it is stated roughly.
pub(super) const AT_REFERENCE: f64 = 0.1;

/// Manner of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Search {
    /// From any start to the end.
    Whole,
    /// From the nominal values at the stated noise, given up where it creeps.
    Stated,
    /// From the nominal values at as much noise as the misfit suggests.
    Widened,
    /// From one of several starts, soon given up.
    Descent,
    /// The same by some poses, which only lead to where all are fitted from.
    Lead,
}

impl Search {
    /// Options of the solver for it, for so many poses.
    pub(super) fn options(self, options: &Options, poses: usize) -> Options {
        let mut options = options.clone();
        if self == Self::Stated {
            options.max_iterations = options.max_iterations.min(CREEPING);
        }
        if matches!(self, Self::Descent | Self::Lead) {
            options.max_iterations = options.max_iterations.min(DESCENT);
            // A dense factor of all poses' columns would be most of the time.
            if options.method == Method::Auto && poses <= FEW {
                options.method = Method::Schur;
            }
        }
        options
    }
}

/// The fit from the nominal values, which are a sketch of links of so many metres. Where it fails or leads to a machine
/// that does not stand at its reference, draws from their tolerances are fitted too, until one does. Beside each counts its
/// mirror image, which may fit as well: of these the most plausible is taken, by the tolerances and the reference.
///
/// Of many poses, some find the machine from which all are then fitted.
///
/// # Errors
/// Of the fit from the nominal values, where no start leads to a fit.
pub(super) fn best(
    prepared: &Prepared,
    length_m: f64,
    division: &RowDivision,
    fitted: impl Fn(Machine, &RowDivision, Search) -> Result<UnknownPoses, Error>,
    mirrored: impl Fn(&UnknownPoses) -> Option<Machine>,
) -> Result<UnknownPoses, Error> {
    let plausible = |of: &RowDivision, search: Search, is_fit: fn(&Start) -> bool| {
        let mut best: Option<Start> = None;
        for draw in 0..=DRAWS {
            let found = fitted(drawn(prepared, draw), of, search);
            let found = found.map(|fit| Start::new(fit, length_m));
            let Some(found) = found.ok().filter(is_fit) else {
                continue;
            };
            // A fit that is no better was found before, or is the image of one that was.
            if best.as_ref().is_some_and(|best| !found.is_better(best)) {
                continue;
            }
            let image = mirrored(&found.fit);
            let image = image.and_then(|machine| fitted(machine, of, search).ok());
            let image = image.map(|fit| Start::new(fit, length_m)).filter(is_fit);
            let found = match image {
                Some(image) if image.is_better(&found) => image,
                _ => found,
            };
            let is_found = found.is_found();
            best = Some(found);
            if is_found {
                break;
            }
        }
        best.map(|best| best.fit)
    };
    let is_sure = |start: &Start| start.is_found() || start.is_told();
    if let Some(some) = some_poses(prepared, division)
        && let Some(near) = plausible(&some, Search::Lead, is_sure)
        && let Ok(found) = fitted(near.calibration.machine, division, Search::Whole)
    {
        let found = Start::new(found, length_m);
        if is_sure(&found) {
            return Ok(found.fit);
        }
    }
    if let Some(found) = plausible(division, Search::Descent, is_sure) {
        return Ok(found);
    }
    match plausible(division, Search::Whole, |_| true) {
        Some(found) => Ok(found),
        None => fitted(prepared.machine.clone(), division, Search::Whole),
    }
}

/// A fit from one of several starts.
struct Start {
    fit: UnknownPoses,
    /// Distance of its machine from the reference, over what that is known to.
    off: f64,
}

impl Start {
    fn new(fit: UnknownPoses, length_m: f64) -> Self {
        let off_m = off_reference_m(&fit.calibration.machine);
        let off = off_m.map_or(f64::INFINITY, |off_m| off_m / (AT_REFERENCE * length_m));
        Self { fit, off }
    }

    /// True if it stands at its reference, and misses nothing.
    fn is_found(&self) -> bool {
        self.off < 1.0 && self.fit.is_consistent()
    }

    /// True if the noise follows from the residuals, which tell nothing then: those of all fits are alike.
    fn is_estimated(&self) -> bool {
        self.fit.kinds.iter().any(|own| own.kind.is_estimated())
    }

    /// True if residuals tell that it is the machine, wherever it stands.
    fn is_told(&self) -> bool {
        self.fit.is_consistent() && !self.is_estimated()
    }

    /// True if measurements, tolerances and reference together speak for it, by their squares.
    fn is_better(&self, than: &Self) -> bool {
        let are_alike = self.is_estimated() && than.is_estimated();
        let cost = |start: &Self| {
            if are_alike {
                0.0
            } else {
                start.fit.calibration.cost
            }
        };
        let total = |start: &Self| 2.0 * cost(start) + start.off.powi(2);
        total(self) < total(than)
    }
}

/// Poses, evenly among all, whose redundant drives tell the parameters several times over; `None` where all are not many
/// more, or distances couple them.
fn some_poses(prepared: &Prepared, division: &RowDivision) -> Option<RowDivision> {
    let machine = &prepared.machine;
    let redundancy = machine
        .closure_count()
        .checked_sub(machine.pose_unknowns().len())?;
    let closures = machine.closure_instances();
    let of_links: BTreeSet<usize> = closures
        .flat_map(|closure| closure.parameters.iter().copied())
        .filter(|&index| prepared.nominal[index].tolerance != Some(0.0))
        .collect();
    let needed = (ROWS_EACH * of_links.len()).checked_div(redundancy)?;
    let step = division.calibration.len() / needed.max(1);
    let pays = division.distances.is_empty() && step > 1;
    pays.then(|| RowDivision {
        calibration: (division.calibration.iter().step_by(step).copied()).collect(),
        ..RowDivision::default()
    })
}

/// Mean length of the links (m) at the reference.
pub(super) fn length_m(machine: &Machine) -> Option<f64> {
    let stated = machine.surroundings.reference.as_ref()?;
    let sample = Sample::new(Pose::from(stated), &stated.commands_m);
    machine.mean_length_m(&sample).ok()
}

/// The same, if a place is known to no better than a share of it.
pub(super) fn sketched(prepared: &Prepared) -> Option<f64> {
    let machine = &prepared.machine;
    let length_m = length_m(machine)?;
    let described = machine.variant.parameters.iter().zip(&prepared.nominal);
    // The tolerance of an effect says nothing of the drawing.
    let is_drawn = |parameter: &Parameter| !matches!(parameter.owner, Owner::Effect(_));
    let is_wide = |(parameter, nominal): (&Parameter, &Nominal)| {
        parameter.unit == "m"
            && is_drawn(parameter)
            && nominal
                .tolerance
                .is_some_and(|tolerance| tolerance > SKETCH * length_m)
    };
    described.into_iter().any(is_wide).then_some(length_m)
}

/// Distance (m) from the stated reference to where the machine stands at its commands.
fn off_reference_m(machine: &Machine) -> Option<f64> {
    let stated = machine.surroundings.reference.as_ref()?;
    let pose = Pose::from(stated);
    let reached = machine
        .forward_fitted(&Sample::new(pose, &stated.commands_m))
        .ok()?;
    Some((reached.pose.position - pose.position).norm())
}

/// The variant at its nominal values, or, from the first draw on, at values drawn evenly from as wide about them as their
/// tolerances say.
fn drawn(prepared: &Prepared, draw: u64) -> Machine {
    if draw == 0 {
        return prepared.machine.clone();
    }
    let mut random = Random(draw);
    let Machine { robot, variant, .. } = &prepared.machine;
    let is_in_plane = robot.plate.is_in_plane();
    let values = prepared.nominal.iter().enumerate().map(|(index, nominal)| {
        let even = random.bits() as f64 / u64::MAX as f64;
        let tolerance = nominal.tolerance.filter(|tolerance| tolerance.is_finite());
        // Lengths make up for heights, which closures in a plane hold as squares: drawn, they creep.
        let tolerance = tolerance.filter(|_| !(is_in_plane && is_along_z(variant, index)));
        // An even distribution of standard deviation 1 is as wide as the root of 12.
        nominal.value + tolerance.unwrap_or(0.0) * 12.0_f64.sqrt() * (even - 0.5)
    });
    let values = values.collect();
    prepared.machine.with_values(values)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use tau_robot::measurements::{Conditions, Folder, PlateKind, PlateRow, Split};
    use tau_robot::robot::Robot;
    use tau_robot::robot_file::RobotFile;

    use super::*;
    use crate::calibration::Options;
    use crate::setup::Setup;
    use crate::unknown_poses::{RowDivision, calibrate, mirror};

    const ANCHORS: [[f64; 2]; 4] = [[0.02, 1.93], [3.35, 1.92], [0.0, 0.0], [3.36, 0.0]];
    const NOISE_M: f64 = 2e-4;
    /// Anchors of two machines on four cables.
    const FIRST: Anchors = [
        [-0.0954, -0.0806, 2.3257],
        [2.8368, 0.0400, 2.2914],
        [1.3752, 2.2221, 2.1100],
        [1.5630, 1.2249, -0.1400],
    ];
    const SECOND: Anchors = [
        [0.1220, 0.1232, 2.2061],
        [2.9143, -0.1784, 2.1533],
        [1.4634, 2.2181, 2.0195],
        [1.6997, 1.2609, -0.1062],
    ];

    fn even(random: &mut Random, low: f64, high: f64) -> f64 {
        low + (high - low) * (random.bits() as f64 / u64::MAX as f64)
    }

    /// A sum of twelve even numbers, nearly normal.
    fn normal(random: &mut Random) -> f64 {
        (0..12).map(|_| even(random, -0.5, 0.5)).sum()
    }

    /// A point in a plane that hangs from four belts, drawn so far off at most (m), and readings at places that nobody
    /// measured. The first lower anchor is the origin, the other lies on the x axis: nothing else is left open.
    fn belts(seed: u64, off_m: f64, tolerance_m: f64) -> (Robot, Folder) {
        let mut random = Random(seed);
        let mut drawn = ANCHORS;
        for (anchor, axis) in [(0, 0), (0, 1), (1, 0), (1, 1), (3, 0)] {
            drawn[anchor][axis] += even(&mut random, -off_m, off_m);
        }
        let parameter = |name: &str, value: f64| {
            format!("param {name}: length = {value} m tol {tolerance_m} m;")
        };
        let [[ax, ay], [bx, by], _, [dx, _]] = drawn;
        let parameters = [
            parameter("tl_x", ax),
            parameter("tl_y", ay),
            parameter("tr_x", bx),
            parameter("tr_y", by),
            parameter("br_x", dx),
        ];
        let belt = |name: &str, anchor: &str| {
            format!("link {name} actuated length {{ length = q; track_offset = {anchor}; }}")
        };
        let text = format!(
            "robot Belts {{ plate point in plane; {} cluster belts on base {{ {} {} {} {} }} \
             reference {{ commands = (1.93, 1.93, 1.94, 1.94) m; position = (1.68, 0.96, 0) m; }} \
             variant Full {{ arm full; }} }}",
            parameters.concat(),
            belt("tl", "(tl_x, tl_y, 0 m)"),
            belt("tr", "(tr_x, tr_y, 0 m)"),
            belt("bl", "(0, 0, 0) m exact"),
            belt("br", "(br_x, 0 m, 0 m)"),
        );
        let rows = (0_u32..48).map(|pose| {
            let at = [even(&mut random, 0.3, 3.0), even(&mut random, 0.3, 1.6)];
            let mut read = |anchor: [f64; 2]| {
                (anchor[0] - at[0]).hypot(anchor[1] - at[1]) + NOISE_M * normal(&mut random)
            };
            PlateRow {
                kind: PlateKind::Reading,
                line: pose as usize + 2,
                pose: pose + 1,
                commands_m: ANCHORS.map(&mut read).to_vec(),
                conditions: Conditions::default(),
                directions: None,
                tensions_n: None,
                values: [None; 3],
                sigmas: [None; 3],
                of: None,
            }
        });
        let folder = Folder {
            plate_rows: rows.collect(),
            ..Folder::default()
        };
        (Robot::from_text(&text).unwrap(), folder)
    }

    fn calibrated(robot: &Robot, folder: &Folder) -> UnknownPoses {
        let text = format!(
            "robot = \"Belts\"\n[noise]\nposition_m = 1e-4\nrotation_rad = 1e-4\n[drives]\nnoise_m = {NOISE_M}\n"
        );
        let file = RobotFile::parse(&text, "robot.toml").unwrap();
        let division = RowDivision::of(folder, Split::All);
        let variant = robot.variant("Full").unwrap();
        let options = Options::default();
        calibrate(
            Setup::new(robot, variant, &file, folder),
            &division,
            &options,
        )
        .unwrap()
    }

    /// Errors of the anchors (m), and their standard deviations.
    fn errors(robot: &Robot, folder: &Folder) -> Vec<(f64, f64)> {
        let found = calibrated(robot, folder);
        let [[ax, ay], [bx, by], _, [dx, _]] = ANCHORS;
        let estimates = found.calibration.parameters.iter();
        let pairs = estimates.zip([ax, ay, bx, by, dx]);
        pairs
            .map(|(estimate, truth)| (estimate.value - truth, estimate.sigma))
            .collect()
    }

    /// Anchors drawn up to half of the machine off. From 61 the nominal values alone lead to the mirror image, from 37
    /// nowhere.
    #[test]
    fn a_sketch_leads_to_the_machine_at_its_reference() {
        for seed in [1, 2, 3, 4, 37, 61] {
            let (robot, folder) = belts(seed, 1.7, 1.7);
            for (error, sigma) in errors(&robot, &folder) {
                assert!(
                    error.abs() < 5.0 * sigma && sigma < 1e-3,
                    "{seed}: {error} ± {sigma}"
                );
            }
        }
    }

    type Anchors = [[f64; 3]; 4];

    /// A point in space on four cables with a common zero, as drawn, and readings of it as it is.
    fn cables(drawn: Anchors, anchors: Anchors, commands: [f64; 4]) -> (Robot, Folder) {
        let cable = |(index, [x, y, z]): (usize, &[f64; 3])| {
            format!(
                "link l{index} actuated length {{ length = zero + q; track_offset = ({x}, {y}, {z}) m tol 0.75 m; }}"
            )
        };
        let links: String = drawn.iter().enumerate().map(cable).collect();
        let [a, b, c, d] = commands;
        let text = format!(
            "robot Belts {{ plate point; param zero: length = 0 m tol 20 mm; \
             cluster cables on base {{ {links} }} \
             reference {{ commands = ({a}, {b}, {c}, {d}) m; position = (1.53, 1.17, 1.12) m; }} \
             variant Full {{ }} }}"
        );
        let (_, mut folder) = belts(1, 0.0, 1.0);
        let mut random = Random(2);
        for row in &mut folder.plate_rows {
            let box_m = [[0.6, 2.4], [0.6, 1.8], [0.5, 1.7]];
            let at = box_m.map(|[low, high]| even(&mut random, low, high));
            let mut read = |anchor: [f64; 3]| {
                let squares: f64 = (0..3).map(|k| (anchor[k] - at[k]).powi(2)).sum();
                squares.sqrt() - 0.012 + NOISE_M * normal(&mut random)
            };
            row.commands_m = anchors.map(&mut read).to_vec();
        }
        (Robot::from_text(&text).unwrap(), folder)
    }

    /// Six times the volume between anchors, whose sign is the hand of the machine.
    fn volume(anchors: Anchors) -> f64 {
        let [a, b, c, d] = anchors.map(Vector3::from);
        (b - a).cross(&(c - a)).dot(&(d - a))
    }

    /// Lengths of cables in a free frame are those of the mirror image as well. Of both machines the nominal values lead to
    /// that, at squares of 6.5 and 13.9 over the tolerances; it stands as near to the reference.
    #[test]
    fn of_a_machine_and_its_mirror_image_the_one_that_is_drawn_is_taken() {
        let first = cables(
            [
                [-0.2645, 0.3446, 2.1318],
                [3.1712, 1.2140, 2.7512],
                [1.1030, 1.4366, 1.7231],
                [1.5908, 2.2074, 0.5521],
            ],
            FIRST,
            [2.3728, 2.1215, 1.4303, 1.2298],
        );
        let second = cables(
            [
                [-0.0414, 1.3141, 3.2049],
                [3.7788, -0.4486, 2.1358],
                [1.9071, 1.1151, 2.1591],
                [1.1257, 2.2144, -1.2006],
            ],
            SECOND,
            [2.0573, 2.2263, 1.3604, 1.2121],
        );
        for ((robot, folder), anchors) in [(first, FIRST), (second, SECOND)] {
            let found = calibrated(&robot, &folder).calibration.parameters;
            let value = |link: usize, axis: &str| {
                let name = format!("l{link}.track_offset.{axis}");
                found.iter().find(|own| own.name == name).unwrap().value
            };
            let found = [0, 1, 2, 3].map(|link| ["x", "y", "z"].map(|axis| value(link, axis)));
            let share = volume(found) / volume(anchors);
            assert!((share - 1.0).abs() < 0.05, "{share}");
        }
    }

    /// Of the machine in a mirror, the drawn one is the image, but for the centimetres by which it misses its reference; of
    /// the drawn one, none is.
    #[test]
    fn the_image_of_a_mirrored_machine_is_as_drawn() {
        let (robot, folder) = cables(FIRST, FIRST, [2.3728, 2.1215, 1.4303, 1.2298]);
        let text = "robot = \"Belts\"\n[noise]\nposition_m = 1e-4\nrotation_rad = 1e-4\n";
        let file = RobotFile::parse(text, "robot.toml").unwrap();
        let file = file.completed(&robot);
        let variant = robot.variant("Full").unwrap();
        let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &[]).unwrap();
        let drawn = &prepared.machine;
        assert!(mirror::image(&prepared, drawn).is_none());
        let parameters = drawn.variant.parameters.iter().zip(&drawn.values);
        let mirrored = parameters.map(|(parameter, value)| {
            let is_across = parameter.name.ends_with("track_offset.x");
            if is_across { 3.06 - value } else { *value }
        });
        let mirrored = drawn.with_values(mirrored.collect());
        let image = mirror::image(&prepared, &mirrored).unwrap();
        for (value, drawn) in image.values.iter().zip(&drawn.values) {
            assert!((value - drawn).abs() < 0.1, "{value} {drawn}");
        }
    }

    /// Over 200 errors, the root mean square departs from 1 by more than 0.16 once in a thousand times.
    #[test]
    fn anchors_are_off_by_their_standard_deviations() {
        let of = |seed| {
            let (robot, folder) = belts(seed, 0.02, 0.02);
            errors(&robot, &folder)
        };
        let squares: Vec<f64> = (100..140)
            .flat_map(of)
            .map(|(e, sigma)| (e / sigma).powi(2))
            .collect();
        let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((rms - 1.0).abs() < 0.16, "{rms}");
    }
}

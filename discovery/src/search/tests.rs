//! Searches on small folders with known answers.

mod linear;

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::{Model, check_text};
use tau_estimation::samples::outliers;
use tau_robot::Robot;
use tau_robot::measurements::{Division, Folder, Poses};
use tau_robot::prototype;
use tau_robot::robot_file::RobotFile;

use super::super::candidate_set::Score;
use super::super::candidates;
use super::super::results::{Separation, Undecided};
use super::super::{Input, Options, Status, begun, discover};
use super::*;

struct Case {
    robot: Robot,
    model: Model,
    file: RobotFile,
    folder: Folder,
    division: Division,
    options: Options,
}

impl Case {
    /// The prototype's folder, of which the errors are known.
    fn prototype() -> Self {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let folder = prototype::folder().unwrap();
        let file = prototype::robot_file().unwrap().completed(&robot);
        let options = Options::default();
        let Poses { division, .. } = Poses::select(&robot, &file, &folder, options.split).unwrap();
        Self {
            model: check_text(&robot.description).unwrap(),
            robot,
            file,
            folder,
            division,
            options,
        }
    }

    fn input(&self) -> Input<'_> {
        Input {
            robot: &self.robot,
            model: &self.model,
            base: "Full",
            file: &self.file,
            folder: &self.folder,
            division: &self.division,
            unknown: None,
            options: &self.options,
        }
    }
}

/// No model that was tried has a better score than the one that is the answer, which was tried, and each of its five
/// effects improves the score.
#[test]
fn the_best_model_visited_is_the_answer() {
    let case = Case::prototype();
    let input = case.input();
    let (mut search, _) = begun(&input, None, &mut |_| {}).unwrap();
    let base = search.score;
    search.run(&mut |_| {}).unwrap();
    assert!(search.score < base - 100.0);
    let mut best: BTreeMap<usize, f64> = BTreeMap::new();
    for ((members, families), score) in &search.visited {
        if let Some(score) = score {
            let least = best.entry(members.len() + families.len()).or_insert(*score);
            *least = score.min(*least);
        }
    }
    let best: Vec<f64> = best.into_values().collect();
    assert_eq!(best.len(), 6, "{best:?}");
    assert!(
        best.windows(2)
            .all(|pair| pair[1] < pair[0] - SCORE_TOLERANCE),
        "{best:?}"
    );
    assert!(
        (best[5] - search.score).abs() < SCORE_TOLERANCE,
        "{best:?} {}",
        search.score
    );
    for (composition, score) in &search.visited {
        let is_no_better = score.is_none_or(|score| score > search.score - SCORE_TOLERANCE);
        assert!(is_no_better, "{composition:?}: {score:?} {}", search.score);
    }
}

/// Sixteen poses alone fit something significant that blocks of them do not confirm: it is undecided, with a number of poses
/// that would decide. With five more, effects are confirmed and nothing is undecided.
#[test]
fn a_significant_effect_that_is_not_confirmed_is_undecided() {
    let mut case = Case::prototype();
    case.folder.cart_poses.clear();
    case.folder.cart_positions.clear();
    let all = case.division.calibration.clone();
    let mut searched = |part: usize| {
        case.division.calibration = all.iter().copied().step_by(part).collect();
        let input = case.input();
        let (mut search, _) = begun(&input, None, &mut |_| {}).unwrap();
        search.run(&mut |_| {}).unwrap();
        (search.undecided(), search.state.count())
    };
    let (open, count) = searched(4);
    let open = open.unwrap();
    assert!(count == 0 && open.p_value.value() < 1e-9, "{open:?}");
    assert!((5..100).contains(&open.more_poses), "{open:?}");
    let (open, count) = searched(3);
    assert!(open.is_none() && count == 3, "{open:?}");
}

/// An answer at rest is said of a consistent fit only, beside nothing that is undecided, and where something could have been
/// seen.
#[test]
fn what_is_open_is_no_answer_at_rest() {
    let Case {
        robot,
        file,
        folder,
        options,
        ..
    } = Case::prototype();
    let found = discover(&robot, "Full", &file, &folder, &options, &mut |_| {});
    let mut found = found.unwrap().discovery;
    let open = Undecided {
        name: found.effects[0].name.clone(),
        place: found.effects[0].place.clone(),
        p_value: found.effects[0].p_value,
        more_poses: 1,
    };
    found.unnamed.clear();
    found.undecided = None;
    assert_eq!(Status::of(&found, true), Status::Explained);
    assert_eq!(Status::of(&found, false), Status::PartlyExplained);
    found.undecided = Some(open.clone());
    assert_eq!(Status::of(&found, true), Status::PartlyExplained);
    found.effects.clear();
    assert_eq!(Status::of(&found, true), Status::Unresolved);
    found.undecided = None;
    assert_eq!(Status::of(&found, true), Status::NothingMissing);
    assert_eq!(Status::of(&found, false), Status::Unresolved);
    found.detectable.clear();
    assert_eq!(Status::of(&found, true), Status::Unresolved);
}

/// The change that the linear model predicts for a weak effect is the one that a refit brings.
#[test]
fn predicted_changes_are_those_of_refits() {
    let case = Case::prototype();
    let input = case.input();
    let (mut search, _) = begun(&input, None, &mut |_| {}).unwrap();
    search.run(&mut |_| {}).unwrap();
    // Every effect taken out, linearly and by a refit.
    let linear = search.state.linear(&search.set);
    for member in 0..search.state.members.len() {
        let statistic = search
            .state
            .own_statistic(&search.context(), member)
            .unwrap();
        let linear = search.change(linear.total(), linear.total() + statistic);
        let mut members = search.state.members.clone();
        let removed = members.remove(member);
        let fit = search
            .state
            .refitted(&search.context(), &members, None)
            .unwrap();
        let next = State {
            fit,
            members,
            unnamed: search.state.unnamed.clone(),
        };
        let cheaper = search.cost_of(removed) + search.set.significance.cost_of_number(2);
        let refitted = search.score_of_state(&next) - search.score + cheaper;
        // The noise is one in the linear model and each component's own in the score, so that they agree to the
        // curvature of the logarithm only; both are rises.
        assert!(linear > 0.0 && refitted > 0.0);
        assert!(
            (0.8..1.05).contains(&(refitted / linear)),
            "{refitted} {linear}"
        );
    }
}

/// A model that has lost its last effect is the base, to the bit: what went with the effect leads nowhere else.
#[test]
fn without_effects_the_fit_is_that_of_the_base() {
    let case = Case::prototype();
    let input = case.input();
    let (mut search, _) = begun(&input, None, &mut |_| {}).unwrap();
    search.run(&mut |_| {}).unwrap();
    let fit = search.refitted(&[], None).unwrap();
    assert_eq!(fit.fitted, search.base.fit.fitted);
    let again = search.state.refitted(&search.context(), &[], None).unwrap();
    assert_ne!(again.fitted, search.base.fit.fitted);
}

/// An effect is separated from a rival by as much of its signal as least squares on all columns leave.
#[test]
fn separations_are_what_least_squares_leave() {
    let case = Case::prototype();
    let input = case.input();
    let (mut search, _) = begun(&input, None, &mut |_| {}).unwrap();
    search.run(&mut |_| {}).unwrap();
    let Search { state, set, .. } = &search;
    let fit = &state.fit;
    let columns_of = |candidate: usize, values: &[f64]| {
        let wanted = set.candidates[candidate].amplitudes();
        let entries = set.entries(candidate, values, &wanted)?;
        let columns = candidates::columns(&entries, &wanted, &set.probes);
        Some(LinearModel::of(fit).weighted(&columns))
    };
    let of_member = |member: usize| {
        let own = &set.candidates[state.members[member].candidate];
        let values = state.values_of(&search.context(), member);
        let amplitudes = own.amplitudes().into_iter();
        let amplitudes = amplitudes.map(|k| values[k] - own.parameters[k].none);
        let amplitudes = DVector::from_vec(amplitudes.collect());
        columns_of(state.members[member].candidate, &values).unwrap() * amplitudes
    };
    let plain = (0..set.candidates.len()).filter(|&own| set.candidates[own].search.is_none());
    let rivals: Vec<usize> = plain
        .filter(|&own| !search.is_in_model(own))
        .step_by(9)
        .collect();
    for member in [0, 3] {
        let separator = search.separator(member);
        let signal = of_member(member);
        let mine = state.columns_of_all(&search.context(), &[member]);
        let others = (0..fit.jacobian.ncols()).filter(|column| !mine.contains(column));
        let base = fit.jacobian.select_columns(&others.collect::<Vec<usize>>());
        for &rival in &rivals {
            let Some(columns) = columns_of(rival, &set.candidates[rival].none()) else {
                continue;
            };
            let all: Vec<_> = base.column_iter().chain(columns.column_iter()).collect();
            let u = DMatrix::from_columns(&all).svd(true, false).u.unwrap();
            let left = (&signal - &u * u.tr_mul(&signal)).norm_squared();
            let found = search.separate_by(&separator, &[(rival, None)]);
            let Separation::Repeat { chi2, poses, .. } = found else {
                panic!("{found:?}");
            };
            assert!((chi2[0] - left).abs() < 1e-3 * left, "{chi2:?} {left}");
            assert!(chi2[1] >= chi2[0] && poses.len() == crate::separation::POSES);
        }
    }
    assert!(rivals.len() > 5);
}

/// Without any effect, the misfit is that of each component's noise, estimated where it exceeds the stated one, and the priors'; an outlier counts as a
/// sample that is just none.
#[test]
fn the_misfit_is_that_of_the_estimated_noise() {
    for spoilt in [0, 2] {
        let mut case = Case::prototype();
        for &pose in &case.division.calibration[..spoilt] {
            case.folder.tcp_poses[pose].position_m[2] += 5e-3;
        }
        let input = case.input();
        let (search, _) = begun(&input, None, &mut |_| {}).unwrap();
        let fit = &search.state.fit;
        let linear = LinearModel::of(fit);
        let of_priors = linear.residuals.rows_range(linear.rows.len()..);
        let mut expected = of_priors.norm_squared() - fit.joint.completed().sum::<f64>();
        for component in tau_estimation::joint::Component::ALL {
            let (sum, degrees, _) = fit.misfit(|row| fit.joint.rows[row].component == component);
            let sum = sum * fit.scales[component as usize].powi(2);
            let variance = f64::max(sum / degrees, 1.0);
            expected += degrees * (variance.ln() - 1.0) + sum / variance;
        }
        let found = search.likelihood.misfit(fit, &linear);
        let mut rows = vec![0.0; fit.weights.len()];
        for row in &fit.joint.rows {
            rows[row.sample] += 1.0;
        }
        let limits = outliers::limits(&rows, &search.set.samples);
        let left_out = limits.iter().zip(&fit.weights);
        let left_out: Vec<f64> = (left_out.filter(|(_, weight)| **weight == 0.0))
            .map(|(limit, _)| *limit)
            .collect();
        let more = found - expected;
        assert!(left_out.len() >= spoilt, "{left_out:?}");
        // To first order each adds its own χ², in units of the noise that is estimated to a fiftieth.
        let of_outliers: f64 = left_out.iter().sum();
        assert!(
            more >= 0.85 * of_outliers - 1e-9 && more <= 1.05 * of_outliers + 1e-9,
            "{more} {of_outliers}"
        );
    }
}

/// The worth of a joint that leaves its drawing is most of what the sum of squares loses with the rows of its
/// tolerances, and no more.
#[test]
fn an_absorbed_effect_is_worth_the_tolerances_that_it_relieves() {
    let mut case = Case::prototype();
    let joint = case.file.links.get_mut("l1").unwrap().plate_joint.as_mut();
    let joint = joint.unwrap();
    for value in &mut joint.value {
        *value += 5.0 * joint.tol;
    }
    let input = case.input();
    let (search, _) = begun(&input, None, &mut |_| {}).unwrap();
    let fit = &search.state.fit;
    let absorbed = search.absorbed(&LinearModel::of(fit));
    let name = |score: &Score| {
        let own = &search.set.candidates[score.candidate];
        format!("{}({})", own.name, own.at)
    };
    let own = absorbed
        .iter()
        .find(|own| name(&own.0) == "joint_placement(l1)");
    let (score, _) = own.expect("the base absorbs it");

    let columns: Vec<usize> = (0..fit.jacobian.ncols()).collect();
    let left = |is_relieved: &dyn Fn(&str) -> bool| {
        let mut residuals = fit.residuals.clone();
        let mut jacobian = fit.jacobian.select_columns(&columns);
        for &column in &columns {
            let parameter = &fit.joint.machine.variant.parameters[fit.joint.used[column]];
            if is_relieved(&parameter.name) {
                let row = fit.joint.rows.len() + column;
                jacobian.row_mut(row).fill(0.0);
                residuals[row] = 0.0;
            }
        }
        // In units in which all columns are equally long.
        for mut column in jacobian.column_iter_mut() {
            let length = column.norm();
            column /= length;
        }
        let step = jacobian.clone().svd(true, true).solve(&residuals, 1e-12);
        (residuals - jacobian * step.unwrap()).norm_squared()
    };
    let relieved = left(&|_| false) - left(&|name| name.starts_with("l1.plate_joint"));
    assert!(relieved > 1.0, "{relieved}");
    let ratio = score.statistic / relieved;
    assert!(
        (0.8..1.0 + 1e-6).contains(&ratio),
        "{} {relieved}",
        score.statistic
    );
}

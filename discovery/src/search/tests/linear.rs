//! Moves and scores on a linear problem: one row a sample, which one cart displaces, beside an offset of each cart.
//!
//! Sums of squares are those of least squares by a singular value decomposition of columns that are written out here.
//! Noise is orthogonal to everything that the catalogue can do, so that every answer is known exactly.

mod world;

use nalgebra::{DMatrix, DVector};
use tau_codegen::compile::compile_some;
use tau_codegen::language::model::Readable;
use tau_codegen::language::{Model, check_text, effects_from_text};
use tau_estimation::calibration::Nominal;
use tau_estimation::joint::{Component, Joint, Row};
use tau_estimation::numerics::distribution::{Random, f_survival, falling_root};
use tau_estimation::numerics::grouped::Grouped;
use tau_estimation::numerics::projection::Basis;
use tau_estimation::samples::Sample;
use tau_estimation::samples::frames::Frames;
use tau_kinematics::{Machine, Surroundings};
use tau_robot::Robot;
use tau_robot::measurements::{Conditions, Division, Folder, PoseSigmas, TcpPose};
use tau_robot::robot::{Owner, Parameter, Variant};
use tau_robot::robot_file::RobotFile;

use super::super::moves::Move;
use super::super::*;
use crate::candidates::Candidate;
use crate::generic::{Family, Placement};
use crate::probes::{Probe, Probes};
use crate::{Input, Options};
use world::{Used, World, used};

const DESCRIPTION: &str = "robot Slides {
    track one, two, three;
    cluster a on one { link l; } cluster b on two { link m; } cluster c on three { link n; }
    variant Plain { arm reduced; tracks linear; }
}";
const CATALOGUE: &str = "
    effect gap on cart { param size: length; along += size * direction; }
    effect tilt on cart { param slope: ratio; along += slope * q; }
    effect bow on cart { param bend: length; optional param twist: length;
        along += bend * (q / 1 m)^2 + twist * (q / 1 m)^3; }";
/// The last effect of the catalogue, as a family without a name.
const FAMILY: &str = "
    effect unnamed_q on cart { param a, b: length; along += a * q / (1 m) + b * (q / 1 m)^4; }";
/// Rows; every third is of the same cart.
const ROWS: usize = 60;
/// Displacement along that is as large as the noise (m).
const SIGMA_M: f64 = 1e-5;

/// Command and side of approach of a row, and the cart that displaces it.
fn at(row: usize) -> (usize, f64, f64) {
    let turn = row / 3;
    let side = if (7 * turn % 20) < 10 { 1.0 } else { -1.0 };
    (row % 3, (turn as f64 + 0.5) / 20.0, side)
}

/// A column: what a function of command and side of approach does at some carts, per metre of displacement.
fn column(carts: &[usize], along: impl Fn(f64, f64) -> f64) -> DVector<f64> {
    DVector::from_fn(ROWS, |row, _| {
        let (cart, q, side) = at(row);
        let is_meant = carts.contains(&cart);
        if is_meant {
            along(q, side) / SIGMA_M
        } else {
            0.0
        }
    })
}

fn gap(carts: &[usize]) -> DVector<f64> {
    column(carts, |_, side| side)
}

fn tilt(carts: &[usize]) -> DVector<f64> {
    column(carts, |q, _| q)
}

fn bow(carts: &[usize]) -> DVector<f64> {
    column(carts, |q, _| q * q)
}

/// Columns that the base absorbs.
fn offsets() -> Vec<DVector<f64>> {
    (0..3).map(|cart| column(&[cart], |_, _| 1.0)).collect()
}

/// Sum of squares that least squares leave.
fn left(of: &DVector<f64>, columns: &[DVector<f64>]) -> f64 {
    remainder(of, columns).norm_squared()
}

fn remainder(of: &DVector<f64>, columns: &[DVector<f64>]) -> DVector<f64> {
    let matrix = DMatrix::from_columns(columns);
    let solution = matrix.clone().svd(true, true).solve(of, 1e-12).unwrap();
    of - matrix * solution
}

/// Noise that leaves nothing to any effect, which has one per degree of freedom of the rows.
fn noise() -> DVector<f64> {
    let mut random = Random(5);
    let noise = DVector::from_fn(ROWS, |_, _| random.normal());
    let mut columns = offsets();
    for cart in 0..3 {
        columns.extend([gap(&[cart]), tilt(&[cart]), bow(&[cart])]);
        columns.push(column(&[cart], |q, _| q.powi(3)));
        columns.push(column(&[cart], |q, _| q.powi(4)));
    }
    let left = remainder(&noise, &columns);
    &left * (DEGREES.sqrt() / left.norm())
}

/// Degrees of freedom of the rows beside the offsets, and sum of squares of the noise.
const DEGREES: f64 = ROWS as f64 - 3.0;

/// The machine's dimensions, which nothing here depends on.
fn robot_file() -> String {
    let link = |name: &str| {
        format!(
            "[links.{name}]
            length_m = {{ value = 1.0, tol = 1e-3 }}
            plate_joint_m = {{ value = [0.0, 0.0, 0.0], tol = 1e-3 }}
            track_offset_m = {{ value = [0.0, 0.0, 0.0], tol = 1e-3 }}
            track_direction = {{ value = [1.0, 0.0, 0.0], tol = 1e-3 }}\n"
        )
    };
    let noise = "robot = \"Slides\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    [noise, &link("l"), &link("m"), &link("n")].concat()
}

/// A candidate by its name and place.
fn candidate(set: &CandidateSet, name: &str, place: &str) -> usize {
    let mut candidates = set.candidates.iter();
    let is_meant = |own: &Candidate| own.name == name && own.at.to_string() == place;
    candidates.position(is_meant).unwrap()
}

/// Names and places of what a move leads to, families last.
fn named(search: &Search<'_>, change: &Move) -> Vec<String> {
    let members = change.members.iter().map(|member| member.candidate);
    let all = members.chain(change.unnamed.iter().map(|unnamed| unnamed.0));
    let mut names: Vec<String> = all.map(|candidate| name_of(search, candidate)).collect();
    names.sort();
    names
}

fn name_of(search: &Search<'_>, candidate: usize) -> String {
    let Candidate { name, at, .. } = &search.set.candidates[candidate];
    format!("{name}({at})")
}

/// The cost of one amplitude among twelve names without families: of the fall of −2 ln L where its F test has its
/// share of 5 %.
fn cost() -> f64 {
    let f = falling_root(0.0, 5.0, |f| {
        f_survival(f, 1.0, DEGREES - 1.0) - 0.05 / 12.0
    });
    DEGREES * (1.0 + f / (DEGREES - 1.0)).ln()
}

/// The cost of each effect beside the first, wherever it acts: odds of ten to one.
fn further() -> f64 {
    2.0 * 10.0_f64.ln()
}

fn fall(before: f64, after: f64) -> f64 {
    DEGREES * (after / before).ln()
}

#[track_caller]
fn close(found: f64, expected: f64) {
    let off = (found - expected).abs();
    assert!(off < 1e-6 * (1.0 + expected.abs()), "{found} {expected}");
}

/// Every candidate's score is the fall of the sum of squares, and its chance that of the F test.
#[test]
fn scores_are_those_of_least_squares() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 2e-5 * gap(&[0]) + 3e-5 * tilt(&[0, 1, 2]);
    let search = world.search(&input, &rows, &[]);
    let table = search.set.table(&search.state.linear(&search.set));
    assert_eq!(table.scores.len(), 12);
    let before = left(&rows, &offsets());
    let places = [
        ("one", vec![0]),
        ("two", vec![1]),
        ("three", vec![2]),
        ("all", vec![0, 1, 2]),
    ];
    for (place, carts) in places {
        let columns = [
            ("gap", gap(&carts)),
            ("tilt", tilt(&carts)),
            ("bow", bow(&carts)),
        ];
        for (name, column) in columns {
            let index = candidate(&search.set, name, place);
            let score = table
                .scores
                .iter()
                .find(|score| score.candidate == index)
                .unwrap();
            let after = left(&rows, &[offsets(), vec![column]].concat());
            close(score.statistic, before - after);
            let f = (before - after) / (after / (DEGREES - 1.0));
            close(
                score.p_value.value().ln(),
                f_survival(f, 1.0, DEGREES - 1.0).ln(),
            );
        }
    }
}

/// The score of a model is −2 ln L with its noise estimated, and what its effects cost.
#[test]
fn the_score_of_a_model_is_that_by_hand() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 2e-5 * gap(&[0]) + 3e-5 * tilt(&[1]);
    let score = |members: &[Used]| world.search(&input, &rows, members).score;
    let misfit = |columns: &[DVector<f64>]| {
        let left = left(&rows, &[&offsets()[..], columns].concat());
        DEGREES * (left / DEGREES).ln()
    };
    close(score(&[]), misfit(&[]));
    let one = [used("gap", "one", gap(&[0]))];
    close(score(&one), misfit(&[gap(&[0])]) + cost());
    let both = [
        used("gap", "one", gap(&[0])),
        used("tilt", "two", tilt(&[1])),
    ];
    let columns = [gap(&[0]), tilt(&[1])];
    // The noise is one.
    close(misfit(&columns), 0.0);
    close(score(&both), 2.0 * cost() + further());
}

#[test]
fn nothing_moves_where_nothing_is_missing() {
    let world = World::new(FAMILY);
    let input = world.input();
    let mut search = world.search(&input, &noise(), &[]);
    for (exchange, with_families) in [(false, false), (true, false), (false, true), (true, true)] {
        assert!(search.moves(exchange, with_families).is_empty());
    }
}

/// An effect joins where the fall of −2 ln L is more than its cost, and not where it is less.
#[test]
fn an_effect_joins_where_it_pays() {
    let world = World::new("");
    let input = world.input();
    let column = tilt(&[1]);
    let own = left(&column, &offsets());
    for (share, joins) in [(0.98, false), (1.02, true)] {
        // DEGREES · ln(1 + a²·own / DEGREES) is that share of the cost.
        let fall_by_hand = share * cost();
        let amplitude = (DEGREES * (fall_by_hand / DEGREES).exp_m1() / own).sqrt();
        let rows = noise() + amplitude * &column;
        let mut search = world.search(&input, &rows, &[]);
        let moves = search.moves(false, false);
        assert_eq!(!moves.is_empty(), joins);
        if let Some(best) = moves.first() {
            assert_eq!(named(&search, best), ["tilt(two)"]);
            close(best.predicted, cost() - fall_by_hand);
        }
    }
}

/// Two places of one effect are one move, since the amplitude that all have in common would come first by itself.
#[test]
fn an_effect_joins_at_all_places_that_pay() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 4e-5 * gap(&[0]) + 4e-5 * gap(&[2]);
    let mut search = world.search(&input, &rows, &[]);
    let moves = search.moves(false, false);
    assert_eq!(named(&search, &moves[0]), ["gap(one)", "gap(three)"]);
    let before = left(&rows, &offsets());
    // It is one effect.
    close(moves[0].predicted, fall(before, DEGREES) + 2.0 * cost());
}

/// Of two falls alike, between the cost of a place and that of an effect, one makes a further place and none a further effect.
#[test]
fn a_further_place_costs_less_than_a_further_effect() {
    let world = World::new("");
    let input = world.input();
    for (column, joins) in [(gap(&[2]), true), (tilt(&[2]), false)] {
        let own = left(&column, &offsets());
        let fall_by_hand = cost() + 0.5 * further();
        let amplitude = (DEGREES * (fall_by_hand / DEGREES).exp_m1() / own).sqrt();
        let rows = noise() + 4e-5 * gap(&[0]) + amplitude * column;
        let mut search = world.search(&input, &rows, &[used("gap", "one", gap(&[0]))]);
        let moves = search.moves(false, false);
        assert_eq!(!moves.is_empty(), joins);
        if let Some(best) = moves.first() {
            assert_eq!(named(&search, best), ["gap(one)", "gap(three)"]);
            close(best.predicted, cost() - fall_by_hand);
        }
    }
}

/// An effect that does less than it costs leaves.
#[test]
fn an_effect_that_does_too_little_leaves() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 4e-5 * gap(&[0]) + 1e-5 * tilt(&[1]);
    let members = [
        used("gap", "one", gap(&[0])),
        used("tilt", "two", tilt(&[1])),
    ];
    let mut search = world.search(&input, &rows, &members);
    let moves = search.moves(false, false);
    assert_eq!(moves.len(), 1);
    assert_eq!(named(&search, &moves[0]), ["gap(one)"]);
    let after = left(&rows, &[offsets(), vec![gap(&[0])]].concat());
    close(
        moves[0].predicted,
        fall(DEGREES, after) - cost() - further(),
    );
    assert!(fall(DEGREES, after) > 1.0);
}

/// An effect that stands in for another gives way to it.
#[test]
fn the_effect_takes_the_place_of_its_look_alike() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 3e-4 * bow(&[2]);
    let mut search = world.search(&input, &rows, &[used("tilt", "three", tilt(&[2]))]);
    let moves = search.moves(true, false);
    assert_eq!(named(&search, &moves[0]), ["bow(three)"]);
    let before = left(&rows, &[offsets(), vec![tilt(&[2])]].concat());
    close(moves[0].predicted, fall(before, DEGREES));
}

/// Equal amplitudes at all places are one in common.
#[test]
fn equal_amplitudes_become_one() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 4e-5 * gap(&[0, 1, 2]);
    let members = [("one", 0), ("two", 1), ("three", 2)]
        .map(|(place, cart)| used("gap", place, gap(&[cart])));
    let mut search = world.search(&input, &rows, &members);
    let moves = search.moves(false, false);
    assert_eq!(named(&search, &moves[0]), ["gap(all)"]);
    close(moves[0].predicted, -2.0 * cost());
}

/// One amplitude for all gives way to those of the places that have any.
#[test]
fn an_amplitude_in_common_is_split() {
    let world = World::new("");
    let input = world.input();
    let rows = noise() + 4e-5 * gap(&[0]) + 3e-5 * gap(&[1]);
    let mut search = world.search(&input, &rows, &[used("gap", "all", gap(&[0, 1, 2]))]);
    let moves = search.moves(true, false);
    assert_eq!(named(&search, &moves[0]), ["gap(one)", "gap(two)"]);
    let before = left(&rows, &[offsets(), vec![gap(&[0, 1, 2])]].concat());
    close(moves[0].predicted, fall(before, DEGREES) + cost());
}

/// Places with amplitudes of their own may be meant by one that all have in common, where they fit as well.
#[test]
fn places_are_rivals_of_an_amplitude_in_common() {
    let world = World::new("");
    let input = world.input();
    let alone = 2e-5 * gap(&[0]) + 2e-5 * gap(&[1]);
    let everywhere = 2e-5 * gap(&[0, 1, 2]);
    for (signal, rivals) in [(alone, vec!["gap(one)", "gap(two)"]), (everywhere, vec![])] {
        let rows = noise() + signal;
        let mut search = world.search(&input, &rows, &[used("gap", "all", gap(&[0, 1, 2]))]);
        let found = search.found().remove(0);
        let told = found.rivals.iter().flat_map(|rival| &rival.candidates);
        let mut told: Vec<String> = told.map(|&told| name_of(&search, told)).collect();
        told.sort();
        assert_eq!(told, rivals);
        let after = left(&rows, &[offsets(), vec![gap(&[0]), gap(&[1])]].concat());
        let by_common = left(&rows, &[offsets(), vec![gap(&[0, 1, 2])]].concat());
        let change = fall(by_common, after) + cost();
        assert_eq!(
            change < search.input.options.constants.as_good,
            !rivals.is_empty()
        );
    }
}

/// An optional parameter joins its effect where there is something for it, and only there.
#[test]
fn an_optional_parameter_joins_where_it_pays() {
    let world = World::new("");
    let input = world.input();
    let twist = column(&[0], |q, _| q.powi(3));
    for size in [0.0, 3e-4] {
        let rows = noise() + 3e-4 * bow(&[0]) + size * &twist;
        let mut search = world.search(&input, &rows, &[used("bow", "one", bow(&[0]))]);
        let moves = search.moves(false, false);
        let extends = |change: &&Move| change.members.iter().any(|member| member.extended);
        let found = moves.iter().find(extends);
        assert_eq!(found.is_some(), size > 0.0);
        let Some(found) = found else { continue };
        // One test at the level of one effect more.
        let f = falling_root(0.0, 5.0, |f| f_survival(f, 1.0, DEGREES - 1.0) - 0.05 * 0.1);
        let cost = DEGREES * (1.0 + f / (DEGREES - 1.0)).ln();
        let before = left(&rows, &[offsets(), vec![bow(&[0])]].concat());
        let after = left(&rows, &[offsets(), vec![bow(&[0]), twist.clone()]].concat());
        // The rows are white, so that serial noise is none of it.
        close(found.predicted, cost + fall(before, after));
    }
}

/// Structure that no name explains is a family's: only where families take part, and in the place of a name that stands in.
#[test]
fn a_family_takes_what_no_name_explains() {
    let world = World::new(FAMILY);
    let input = world.input();
    let fourth = column(&[1], |q, _| q.powi(4));
    let rows = noise() + 3e-4 * tilt(&[1]) - 3e-3 * fourth;
    let mut search = world.search(&input, &rows, &[]);
    let moves = search.moves(false, true);
    assert_eq!(named(&search, &moves[0]), ["unnamed_q(two)"]);
    assert!(search.starts_with_family);
    let by_names = search.moves(false, false);
    assert!(by_names.iter().all(|change| change.unnamed.is_empty()) && !by_names.is_empty());
    let mut search = world.search(&input, &rows, &[used("bow", "two", bow(&[1]))]);
    let moves = search.moves(true, true);
    assert_eq!(named(&search, &moves[0]), ["unnamed_q(two)"]);
}

//! Mistakes in words, and how to mend them.

use nalgebra::{Rotation3, Vector3};
use tau_robot::input_error::quoted;
use tau_robot::measurements::{Actuator, CART_POSES, DISTANCES, PlateKind, Shape, TCP_POSES};
use tau_robot::robot::{Parameter, Plate, Robot};

use crate::machine::Nominal;
use crate::trust::hypothesis::{Case, Hypothesis, INCH_MM, THOUSAND};
use crate::trust::mistake::{Mistake, MistakeKind};
use crate::trust::{ABSURD_TOLERANCES, general};

const ROBOT: &str = "robot.toml";
const AXES: [&str; 3] = ["x", "y", "z"];
const ANGLES: [&str; 3] = ["alpha_rad", "beta_rad", "gamma_rad"];
/// Digits of a change of frame: turned by as much, places in a hundred metres move by a tenth of a micrometre.
const FRAME_DIGITS: usize = 10;
/// Rivals that are named beside the best explanation.
const RIVALS: usize = 3;

/// The mistake that hypotheses describe, the likeliest first, each with the values of the variant under it.
pub(crate) fn mistake(case: &Case<'_>, all: &[(&Hypothesis, &[f64])]) -> Option<Mistake> {
    let all = (all.iter()).filter_map(|(hypothesis, values)| of(case, hypothesis, values));
    beside(all.collect())
}

/// The first of several mistakes, the likeliest, with the others beside it.
pub(crate) fn beside(all: Vec<Mistake>) -> Option<Mistake> {
    let mut all = all.into_iter();
    let mut mistake = all.next()?;
    let mut rivals: Vec<String> = vec![];
    for Mistake { what, .. } in all {
        if what != mistake.what && !rivals.contains(&what) && rivals.len() < RIVALS {
            rivals.push(what);
        }
    }
    if !rivals.is_empty() {
        mistake.what += &format!(" (or nearly as well: {})", rivals.join("; "));
    }
    Some(mistake)
}

/// A mistake in the columns of measurements in a file; `None` of hypotheses about something else.
pub(crate) fn of_measurements(
    robot: &Robot,
    hypothesis: &Hypothesis,
    file: &'static str,
) -> Option<Mistake> {
    let (kind, _, what, mend) = match hypothesis {
        Hypothesis::Commands(columns) => commands(robot, columns),
        Hypothesis::Signs(commands) => signs(robot, commands),
        Hypothesis::Zero { command, by } => zero(robot, *command, *by),
        Hypothesis::CommandsInDegrees(commands) => {
            let columns: Vec<String> = commands.iter().map(|&k| robot.command_column(k)).collect();
            (
                MistakeKind::Degrees,
                TCP_POSES,
                "the commands are in degrees".to_owned(),
                format!(
                    "multiply {} by π/180",
                    quoted(columns.iter().map(String::as_str))
                ),
            )
        }
        Hypothesis::Shifted(by) if file == DISTANCES => (
            MistakeKind::PoseNumbers,
            DISTANCES,
            "the numbers of the poses are those of others".to_owned(),
            format!(
                "{} 1 {} each of `pose_a` and `pose_b`",
                if *by > 0 { "subtract" } else { "add" },
                if *by > 0 { "from" } else { "to" },
            ),
        ),
        Hypothesis::Shifted(by) => (
            MistakeKind::Rows,
            TCP_POSES,
            "the rows of what was measured are shifted by one against those of the commands"
                .to_owned(),
            format!(
                "move the measured columns {} by one row",
                if *by > 0 { "down" } else { "up" }
            ),
        ),
        Hypothesis::Heights => (
            MistakeKind::HeightSign,
            TCP_POSES,
            "`height_m` counts the other way".to_owned(),
            "change its sign, or turn the normal of the surface round".to_owned(),
        ),
        Hypothesis::Axes {
            columns,
            signs,
            turned,
        } => axes(*columns, *signs, *turned),
        Hypothesis::Angles {
            axes,
            fixed,
            transposed,
        } if robot.plate == Plate::Body || file == CART_POSES => angles(*axes, *fixed, *transposed),
        Hypothesis::Angles { .. } => (
            MistakeKind::AngleSign,
            TCP_POSES,
            "`alpha_rad` counts the other way".to_owned(),
            "change its sign: it is the turn of the plate against the measurement frame".to_owned(),
        ),
        Hypothesis::Frame { rotation, shift } => frame(rotation, shift, file == TCP_POSES),
        Hypothesis::Unit(of_metre) => unit(*of_metre, file),
        Hypothesis::AngleSign(angle) => (
            MistakeKind::AngleSign,
            TCP_POSES,
            format!("`{}` counts the other way", ANGLES[*angle]),
            "change its sign".to_owned(),
        ),
        Hypothesis::Degrees => (
            MistakeKind::Degrees,
            TCP_POSES,
            "the angles are in degrees".to_owned(),
            format!("multiply {} by π/180", quoted(angles_of(robot.plate))),
        ),
        _ => return None,
    };
    Some(Mistake {
        kind,
        file,
        lines: vec![],
        what,
        mend,
        // Joints of one drive that are off alike make the same machine; one that a fit can't reach is told where it is.
        is_absurd: kind != MistakeKind::CommandZero,
    })
}

/// Stated noise that is off by a thousand, which `factor` mends.
pub(crate) fn of_noise(whose: &str, factor: f64) -> Mistake {
    let (size, mend) = if factor < 1.0 {
        (
            "too large, as if in thousandths of the unit",
            "divide it by",
        )
    } else {
        ("too small", "multiply it by")
    };
    Mistake {
        kind: MistakeKind::Noise,
        file: ROBOT,
        lines: vec![],
        what: format!("the stated noise {whose} is a thousand times {size}"),
        mend: format!("write metres and radians: {mend} {THOUSAND}"),
        is_absurd: true,
    }
}

/// Tolerances that are off by a factor; `None` of hypotheses about something else.
pub(crate) fn of_tolerances(hypothesis: &Hypothesis) -> Option<Mistake> {
    let Hypothesis::Tolerances {
        factor,
        lengths_only,
        from_m,
    } = *hypothesis
    else {
        return None;
    };
    let (kind, file, what, mend) = tolerances(factor, lengths_only, from_m);
    Some(Mistake {
        kind,
        file,
        lines: vec![],
        what,
        mend,
        is_absurd: true,
    })
}

/// Distances of two lines that are exchanged.
pub(crate) fn exchanged([one, other]: [usize; 2]) -> Mistake {
    Mistake {
        kind: MistakeKind::Distances,
        file: DISTANCES,
        lines: vec![one, other],
        what: format!("the distances of lines {one} and {other} are exchanged"),
        mend: "exchange them".to_owned(),
        is_absurd: true,
    }
}

/// A numbering in words; it holds the cart on each track.
pub(super) fn carts(robot: &Robot, file: &'static str, numbering: &[usize]) -> Mistake {
    let list: Vec<String> = numbering
        .iter()
        .zip(&robot.tracks)
        .map(|(cart, track)| format!("cart {} on `{track}`", cart + 1))
        .collect();
    Mistake {
        kind: MistakeKind::Carts,
        file,
        lines: vec![],
        what: format!(
            "the carts do not run where set 1 has their tracks; they would with {}",
            list.join(", ")
        ),
        mend: "carts are numbered in the order in which the description declares the tracks"
            .to_owned(),
        is_absurd: true,
    }
}

fn frame(rotation: &Rotation3<f64>, shift: &Vector3<f64>, of_poses: bool) -> Words {
    let vector = |of: &Vector3<f64>| {
        let components = of.iter().map(|&own| general(own, FRAME_DIGITS));
        format!("({})", components.collect::<Vec<_>>().join(", "))
    };
    let (turn, shift) = (vector(&rotation.scaled_axis()), vector(shift));
    (
        MistakeKind::Frame,
        TCP_POSES,
        format!(
            "the {} are those of another frame than that of the drawing",
            if of_poses { "poses" } else { "positions" }
        ),
        format!(
            "turn them by the rotation vector {turn} rad, then shift them by {shift} m, or state the places of the drawing in \
             the frame of the measurements"
        ),
    )
}

fn unit(of_metre: f64, file: &str) -> Words {
    let (kind, name) = if of_metre < 1.0 {
        (
            MistakeKind::InchesForMillimetres,
            "inches taken for millimetres",
        )
    } else if of_metre < 1e2 {
        (MistakeKind::Inches, "inches")
    } else if of_metre < THOUSAND {
        (MistakeKind::Centimetres, "centimetres")
    } else {
        (MistakeKind::Millimetres, "millimetres")
    };
    let (what, columns) = if file == PlateKind::Height.file() {
        ("heights", "`height_m`")
    } else if [DISTANCES, PlateKind::BallBar.file()].contains(&file) {
        ("distances", "`distance_m`")
    } else {
        ("positions", "`x_m`, `y_m` and `z_m`")
    };
    (
        kind,
        TCP_POSES,
        format!("the {what} are in {name}"),
        if of_metre < 1.0 {
            format!("multiply {columns} by {INCH_MM}")
        } else {
            format!("divide {columns} by {}", general(of_metre, 6))
        },
    )
}

/// Columns of the angles by which a plate turns.
fn angles_of(plate: Plate) -> impl Iterator<Item = &'static str> {
    ANGLES.into_iter().take(plate.turning_axes().len())
}

fn of(case: &Case<'_>, hypothesis: &Hypothesis, values: &[f64]) -> Option<Mistake> {
    let (kind, file, what, mend) = match hypothesis {
        Hypothesis::Carts(numbering) => return Some(carts(case.robot, CART_POSES, numbering)),
        Hypothesis::Noise { position, rotation } => noise(case, *position, *rotation),
        Hypothesis::Tolerances {
            factor,
            lengths_only,
            from_m,
        } => tolerances(*factor, *lengths_only, *from_m),
        Hypothesis::Dimension { parameter, .. } => {
            let (prepared, parameter) = (case.prepared().ok()?, *parameter);
            return Some(dimension(
                &case.variant.parameters[parameter],
                &prepared.nominal[parameter],
                values[parameter],
            ));
        }
        of_poses => return of_measurements(case.robot, of_poses, case.folder.poses_file()),
    };
    Some(Mistake {
        kind,
        file,
        lines: vec![],
        what,
        mend,
        is_absurd: true,
    })
}

type Words = (MistakeKind, &'static str, String, String);

fn commands(robot: &Robot, columns: &[usize]) -> Words {
    let moved: Vec<usize> = (0..columns.len()).filter(|&k| columns[k] != k).collect();
    let name = |k: &usize| robot.command_column(*k);
    let names: Vec<String> = moved.iter().map(name).collect();
    let (what, mend) = if let [one, other] = names.as_slice() {
        (
            format!("the columns `{one}` and `{other}` are exchanged"),
            format!("exchange the names `{one}` and `{other}` in the header"),
        )
    } else {
        let held: Vec<String> = moved
            .iter()
            .map(|&k| {
                let column = robot.command_column(columns[k]);
                format!("command {} stands in `{column}`", k + 1)
            })
            .collect();
        (
            format!(
                "the columns of the commands are out of order: {}",
                held.join(", ")
            ),
            "name the columns in the order in which the description declares the drives".to_owned(),
        )
    };
    (MistakeKind::Commands, TCP_POSES, what, mend)
}

fn signs(robot: &Robot, commands: &[usize]) -> Words {
    let &[command] = commands else {
        return (
            MistakeKind::CommandSign,
            TCP_POSES,
            "all commands count the other way".to_owned(),
            "change their signs, or those of what they drive in the description".to_owned(),
        );
    };
    let column = robot.command_column(command);
    let drives = Shape::from(robot).drives;
    let driven = match drives.get(command) {
        Some(Actuator::Cart) => "the track direction",
        Some(Actuator::Crank) => "the axis of the crank",
        _ => "the length",
    };
    (
        MistakeKind::CommandSign,
        TCP_POSES,
        format!("`{column}` counts the other way"),
        format!("change its sign, or that of {driven} that it drives"),
    )
}

fn zero(robot: &Robot, command: usize, by: f64) -> Words {
    let column = robot.command_column(command);
    let unit = if robot.is_angle(command) { "rad" } else { "m" };
    let by = general(by, 4);
    (
        MistakeKind::CommandZero,
        TCP_POSES,
        format!("`{column}` counts from another zero than the drawing has"),
        format!("add {by} {unit} to it, or home that drive again and measure anew"),
    )
}

/// Axes of measurements; a mirror image of the drawing would fit the measurements as they are just as well.
fn axes(columns: [usize; 3], signs: [f64; 3], turned: bool) -> Words {
    let rotations = if turned {
        " of positions and rotations"
    } else {
        " of the positions"
    };
    let too = if turned {
        ", and turn the rotations with them"
    } else {
        ""
    };
    let mirrored = (0..3).find(|&axis| signs[axis] < 0.0);
    let (kind, what, mend) = if let Some(axis) = mirrored {
        let axis = AXES[axis];
        (
            MistakeKind::Mirrored,
            format!("the {axis} axis{rotations} is mirrored against the drawing"),
            format!(
                "change the sign of `{axis}_m`{too}, or that of {axis} of the anchors and joints in {ROBOT}, if it is the \
                 drawing that is mirrored"
            ),
        )
    } else {
        let moved: Vec<&str> = (0..3)
            .filter(|&k| columns[k] != k)
            .map(|k| AXES[k])
            .collect();
        let names: Vec<String> = moved.iter().map(|axis| format!("{axis}_m")).collect();
        (
            MistakeKind::Axes,
            format!(
                "the axes {}{rotations} are exchanged against the drawing",
                moved.join(" and ")
            ),
            format!(
                "exchange {}{too}, or {} of the anchors and joints in {ROBOT}, if it is the drawing where they are \
                 exchanged",
                quoted(names.iter().map(String::as_str)),
                moved.join(" and ")
            ),
        )
    };
    (kind, TCP_POSES, what, mend)
}

fn angles(axes: [usize; 3], fixed: bool, transposed: bool) -> Words {
    let letters: String = axes.iter().map(|&axis| AXES[axis]).collect();
    let named = if fixed {
        format!("angles about the fixed axes {letters}")
    } else {
        format!("{} Euler angles", letters.to_uppercase())
    };
    let factors: Vec<String> = (0..3)
        .map(|k| format!("R{}({})", AXES[axes[k]], ANGLES[k]))
        .collect();
    let ordered: Vec<String> = if fixed {
        factors.into_iter().rev().collect()
    } else {
        factors
    };
    let is_asked_for = axes == [2, 1, 2] && !fixed;
    let what = match (is_asked_for, transposed) {
        (true, _) => {
            "the rotation is transposed: that of the measurement frame against the plate".to_owned()
        }
        (false, false) => format!("the angles are {named}, not ZYZ Euler angles"),
        (false, true) => {
            format!("the angles are {named} of the transposed rotation, not ZYZ Euler angles")
        }
    };
    let inverse = if transposed { "ᵀ" } else { "" };
    let mend = format!(
        "compute R = ({}){inverse} and write its ZYZ Euler angles, R = Rz(alpha_rad)·Ry(beta_rad)·Rz(gamma_rad)",
        ordered.join("·")
    );
    (MistakeKind::Angles, TCP_POSES, what, mend)
}

fn noise(case: &Case<'_>, position: f64, rotation: f64) -> Words {
    let noise = case.file.noise;
    let of = [
        ("position_m", noise.position_m, position),
        ("rotation_rad", noise.rotation_rad, rotation),
    ];
    let wrong: Vec<_> = of
        .into_iter()
        .filter(|(.., factor)| *factor != 1.0)
        .collect();
    let names = quoted(wrong.iter().map(|(name, ..)| *name));
    let size = if position.min(rotation) < 1.0 {
        "a thousand times too large, as if in thousandths of the unit"
    } else {
        "a thousand times too small"
    };
    let mended: Vec<String> = wrong
        .iter()
        .map(|(name, value, factor)| format!("{name} = {:e}", value * factor))
        .collect();
    (
        MistakeKind::Noise,
        ROBOT,
        format!("{names} of `[noise]` is {size}"),
        format!("write metres and radians: {}", mended.join(", ")),
    )
}

fn tolerances(factor: f64, lengths_only: bool, from_m: f64) -> Words {
    let which = if lengths_only {
        "the tolerances of lengths"
    } else {
        "the tolerances"
    };
    let beyond = if from_m > 0.0 {
        format!(" beyond {} m", general(from_m, 2))
    } else {
        String::new()
    };
    let (what, mend) = if factor < 1.0 {
        (
            format!("{which}{beyond} are a thousand times too large, as if in millimetres"),
            format!("write metres: divide `tol` of lengths{beyond} by {THOUSAND}"),
        )
    } else {
        (
            format!("{which} are a thousand times too small for these measurements"),
            format!("write one standard deviation in metres: multiply `tol` by {THOUSAND}"),
        )
    };
    (MistakeKind::Tolerances, ROBOT, what, mend)
}

/// One dimension far off, which measurements ask to be another.
pub(crate) fn dimension(described: &Parameter, stated: &Nominal, value: f64) -> Mistake {
    let name = &described.name;
    let unit = if described.unit == "1" {
        ""
    } else {
        &described.unit
    };
    let tolerances = stated.tolerances_to(value).abs();
    Mistake {
        kind: MistakeKind::Dimension,
        file: ROBOT,
        lines: vec![],
        what: format!(
            "`{name}` is {} tolerances off: {} {unit} is stated, the measurements ask for {} {unit}",
            general(tolerances, 3),
            general(stated.value, 6),
            general(value, 6),
        ),
        mend: format!("measure `{name}` again and correct its value or its tolerance"),
        is_absurd: tolerances >= ABSURD_TOLERANCES,
    }
}

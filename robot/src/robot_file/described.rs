//! Instances that a description gives by itself, and the file to fill in where it gives less.

use std::fmt::{self, Write};

use tau_codegen::language::model::Value as Geometry;
use tau_codes::fit;

use super::keys::{crank_values, described_links, described_reference, machine_parameters};
use super::write::{key, string};
use super::{Noise, Origin, Reference, RobotFile};
use crate::input_error::{InputError, quoted};
use crate::measurements::Shape;
use crate::robot::{Link, LinkKey, Robot};

/// Noise of a laser tracker over a few metres with the repeatability of a machine, one standard deviation per axis: what
/// stands where no file states any.
const USUAL_NOISE: Noise = Noise {
    position_m: 1e-5,
    rotation_rad: 4e-5,
};

/// Stands in a file for a number that is still to be filled in.
pub(crate) const PLACEHOLDER: &str = "?";

/// Meaning of a link's value; none of rotations along measured paths, which calibrations find.
fn meaning(key: LinkKey) -> Option<&'static str> {
    Some(match key {
        LinkKey::Geometry(Geometry::Length) => "between the two joints",
        LinkKey::Geometry(Geometry::PlateJoint) => "in TCP coordinates",
        LinkKey::Geometry(Geometry::TrackOffset) => "in the measurement frame, at command 0",
        LinkKey::Geometry(Geometry::TrackDirection) => {
            "displacement of the joint per unit of the command"
        }
        LinkKey::Pull => "to which its drive is controlled",
        LinkKey::TrackRotation => return None,
    })
}

impl RobotFile {
    /// The instance that a description gives by itself, with the noise of a laser tracker.
    ///
    /// # Errors
    /// The description lacks values, which are listed.
    pub fn described(robot: &Robot) -> Result<Self, InputError> {
        let described = described_links(robot);
        let of_link = |(index, link): (usize, &Link)| {
            let values = described.get(index);
            let lacks = keys_of(robot, index)
                .filter(|(key, _)| values.is_none_or(|values| values.get(*key).is_none()));
            let lacks: Vec<&str> = lacks.map(|(key, _)| key.name()).collect();
            (!lacks.is_empty()).then(|| format!("{} of `{}`", quoted(lacks), link.name))
        };
        let of_links = robot.links.iter().enumerate().filter_map(of_link);
        let of_machine = undescribed(robot);
        let lacks: Vec<String> = of_links.chain(of_machine).collect();
        if !lacks.is_empty() {
            return Err(input_error!(fit::NO_VALUE, &robot.source;
                "nothing gives a value for {}", lacks.join(", ");
                "`tau init F.tau` writes a robot.toml to fill in, to be named with `--robot`"));
        }
        Ok(Self {
            source: Origin(robot.source.clone()),
            robot: robot.name.clone(),
            noise: USUAL_NOISE,
            ..Self::default()
        })
    }

    /// The text of a `robot.toml` for a robot: what its description gives is filled in, for the rest stand
    /// placeholders, which are refused when the file is read.
    pub fn template(robot: &Robot) -> String {
        let mut text = String::new();
        // Writing into a string can't fail.
        let _ = write_template(&mut text, robot);
        text
    }
}

/// The values that a link has, with their meaning.
fn keys_of(robot: &Robot, link: usize) -> impl Iterator<Item = (LinkKey, &'static str)> {
    let keys = LinkKey::ALL.into_iter();
    let keys = keys.filter(move |key| robot.has_parameter(link, *key));
    keys.filter_map(|key| Some((key, meaning(key)?)))
}

/// Parameters of the machine and values of cranks to which the description gives no number, in words.
fn undescribed(robot: &Robot) -> Vec<String> {
    let of_crank = |(crank, key): (String, &'static str)| format!("`{key}` of `{crank}`");
    let cranks = crank_values(robot)
        .into_iter()
        .filter(|(_, value)| value.quantity.value.is_none())
        .map(|(crank, value)| of_crank((crank, value.name)));
    let parameters = machine_parameters(robot)
        .into_iter()
        .filter(|parameter| parameter.nominal.is_none())
        .map(|parameter| format!("parameter `{}`", parameter.name));
    cranks.chain(parameters).collect()
}

const HEAD: &str = "\
# Instance of the robot: dimensions of the drawing with tolerances, noise, loads. SI units: m, rad, kg, N.
# Replace every \"?\" by a number; the file is refused until none is left.
";

const NOISE: &str = "
# Noise of a measured pose, tracker and repeatability of the machine together: one standard deviation per axis.
# A laser tracker over a few metres has 1.0e-5 m and 4.0e-5 rad.
[noise]
position_m = \"?\"
rotation_rad = \"?\"
";

/// Where links hold more than the plate's freedoms: drives that are taken for exact can then only contradict each other.
const DRIVES: &str = "
# Noise of what a drive does or reads, one standard deviation (m; rad of cranks and drums): one for all drives, an array
# with one for each, or \"estimate\". This robot has more links than freedoms, so its drives measure each other. Without
# this section they are exact, and as soon as they contradict each other a calibration is inconsistent.
[drives]
noise_m = \"?\"
";

const PAYLOAD: &str = "
# Load, for effects that follow forces: plate, tool and half of the links. The centre is in TCP coordinates, gravity
# in the measurement frame.
# [payload]
# mass_kg = 5.0
# centre_m = [0.0, 0.0, 0.0]
# gravity_m_s2 = [0.0, 0.0, -9.81]
";

const RANGE: &str = "
# Commands that measurements cover, where no cart poses (set 2) say so: lowest and highest (m).
# [range]
# q_m = [-0.5, 0.5]
";

const REFERENCE: &str = "
# How the arm is assembled: where the TCP stands (m; ZYZ Euler angles in rad) at these commands, to a few centimetres
# and degrees. Kinematics and simulation need it.
";

const LINKS: &str = "
# Dimensions. tol is one standard deviation of the drawing's tolerance: 3.0e-4 m is usual for rods and joints, 1.0e-2
# for how tracks stand in the frame of a tracker. The file counts before the description.
";

fn write_template(out: &mut String, robot: &Robot) -> fmt::Result {
    // A point has no rotation to measure.
    let noise = if robot.plate.is_point() && !Shape::from(robot).has_carts() {
        NOISE.replace("rotation_rad = \"?\"\n", "")
    } else {
        NOISE.to_owned()
    };
    let drives = if robot.is_redundant() { DRIVES } else { "" };
    let name = string(&robot.name);
    write!(out, "{HEAD}robot = {name}\n{noise}{drives}{PAYLOAD}")?;
    // Angles have no such range.
    if (0..robot.commands).any(|command| !robot.is_angle(command)) {
        write!(out, "{RANGE}")?;
    }
    write!(out, "{REFERENCE}")?;
    match described_reference(robot) {
        Some(reference) => {
            writeln!(out, "[reference]")?;
            let commands = numbers(&reference.commands_m);
            writeln!(out, "{} = {commands}", reference.key())?;
            writeln!(out, "position_m = {}", numbers(&reference.position_m))?;
            // A point has none.
            if !robot.plate.is_point() {
                let orientation = numbers(&reference.orientation_rad);
                writeln!(out, "orientation_rad = {orientation}")?;
            }
        }
        None => {
            let commands = vec!["0.0"; robot.commands].join(", ");
            let has_angles = (0..robot.commands).any(|command| robot.is_angle(command));
            let (commands_key, height) = (
                Reference::key_of(has_angles),
                if robot.plate.is_in_plane() {
                    "0.0"
                } else {
                    "z"
                },
            );
            writeln!(out, "# [reference]\n# {commands_key} = [{commands}]")?;
            writeln!(out, "# position_m = [x, y, {height}]")?;
            if !robot.plate.is_point() {
                writeln!(out, "# orientation_rad = [0.0, 0.0, 0.0]")?;
            }
        }
    }
    write!(out, "{LINKS}")?;
    for (index, link) in robot.links.iter().enumerate() {
        if keys_of(robot, index).next().is_none() {
            continue;
        }
        let described = robot.model.links.get(index);
        let separator = if index == 0 { "" } else { "\n" };
        writeln!(out, "{separator}[links.{}]", key(&link.name))?;
        for (key, meaning) in keys_of(robot, index) {
            let given = described.map(|link| key.described(link));
            let (value, tol) = given.unwrap_or_default();
            let (value, tol) = (or_blanks(value.as_deref(), key.components()), or_blank(tol));
            let name = key.key();
            let note = match (index, link.actuated_by, key) {
                (0, Some(_), LinkKey::Geometry(Geometry::Length)) => {
                    "  # at command 0; the command is added to it"
                }
                (0, ..) => &format!("  # {meaning}"),
                _ => "",
            };
            writeln!(out, "{name} = {{ value = {value}, tol = {tol} }}{note}")?;
        }
    }
    write_machine(out, robot)
}

/// Values of cranks and parameters of the machine.
fn write_machine(out: &mut String, robot: &Robot) -> fmt::Result {
    let mut of = String::new();
    for (crank, value) in crank_values(robot) {
        if crank != of {
            writeln!(out, "\n[cranks.{}]", key(&crank))?;
            of = crank;
        }
        let (given, tolerance) = value.quantity.given();
        let (text, tol) = (or_blanks(given, 3), or_blank(tolerance));
        writeln!(out, "{} = {{ value = {text}, tol = {tol} }}", value.key)?;
    }
    let parameters = machine_parameters(robot);
    if !parameters.is_empty() {
        writeln!(
            out,
            "\n# Parameters of the whole machine, in SI units.\n[parameters]"
        )?;
    }
    for parameter in parameters {
        let text = or_blanks(parameter.nominal.as_deref(), parameter.components);
        let tol = or_blank(parameter.tolerance);
        let name = key(&parameter.name);
        let unit = parameter.dimension.si_unit();
        writeln!(out, "{name} = {{ value = {text}, tol = {tol} }}  # {unit}")?;
    }
    Ok(())
}

/// A number or several as the file has them, blanks where they are to be filled in.
fn or_blanks(values: Option<&[f64]>, components: usize) -> String {
    match (values, components) {
        (Some([value]), _) => number(*value),
        (Some(values), _) => numbers(values),
        (None, 1) => or_blank(None),
        (None, _) => format!("[{}]", vec![or_blank(None); components].join(", ")),
    }
}

fn or_blank(value: Option<f64>) -> String {
    value.map_or_else(|| format!("\"{PLACEHOLDER}\""), number)
}

fn numbers(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|&value| number(value)).collect();
    format!("[{}]", values.join(", "))
}

/// To fifteen digits, so that 48.7 mm are 0.0487 m.
fn number(value: f64) -> String {
    let rounded = format!("{value:.14e}").parse().unwrap_or(value);
    format!("{rounded:?}")
}

//! Checks of a `robot.toml` against its robot: names that exist, values for every link.

use std::collections::BTreeMap;

use tau_codegen::language::model::{Formula, Value as Geometry};
use tau_codes::{Code, files};
use tau_model_dsl::nearest;
use tau_model_dsl::units::Dimension;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

use super::keys::{WIDE, crank_values, described_links, key_place, machine_parameters};
use super::{LinkValues, RobotFile};
use crate::input_error::{Mistakes, quoted, suggestion};
use crate::measurements::plausible::{FARTHEST_M, LARGEST_ANGLE_RAD, LONGEST_M};
use crate::measurements::set::{ANGLES, NO_MOTION, POSITION, stays};
use crate::measurements::{Actuator, Shape};
use crate::robot::{LinkKey, Owner, Robot};

/// Names in the file are names of the robot. Returns those that misspelt ones probably mean.
pub(super) fn names<'r>(
    mistakes: &mut Mistakes<'_>,
    root: &DeTable<'_>,
    file: &RobotFile,
    robot: &'r Robot,
) -> Vec<&'r str> {
    let mut meant = Vec::new();
    let links: Vec<&str> = robot.links.iter().map(|link| link.name.as_str()).collect();
    let clusters: Vec<&str> = robot.clusters.iter().map(|c| c.name.as_str()).collect();
    let tracks: Vec<&str> = robot.tracks.iter().map(String::as_str).collect();
    let cranks = (robot.model.tracks.iter()).filter(|track| track.crank.is_some());
    let cranks: Vec<&str> = cranks.map(|track| track.name.as_str()).collect();
    let parameters = (robot.model.parameters.iter()).filter(|own| !own.exact);
    let parameters: Vec<&str> = parameters.map(|own| own.name.as_str()).collect();
    for (section, what, known) in [
        ("links", "link", &links),
        ("clusters", "cluster", &clusters),
        ("tracks", "track", &tracks),
        ("paths", "track", &tracks),
        ("cranks", "crank", &cranks),
        ("parameters", "parameter", &parameters),
    ] {
        for key in keys_of(root, section) {
            let name = key.get_ref().as_ref();
            if known.contains(&name) {
                continue;
            }
            let nearest = nearest(name, known.iter().copied());
            meant.extend(nearest);
            mistake!(mistakes, files::UNKNOWN_NAME, key.span(); "robot `{}` has no {what} `{name}`", robot.name;
                "{}", suggestion(name, known.iter().copied()));
        }
    }
    reference(mistakes, root, file, robot);
    drives(mistakes, root, robot);
    pulls(mistakes, root, robot);
    let places = [&["all", "tcp"], &tracks[..], &links[..]].concat();
    for key in keys_of(root, "effects") {
        let form = key
            .get_ref()
            .strip_suffix(')')
            .and_then(|form| form.split_once('('));
        let Some((name, at)) = form else {
            mistake!(mistakes, files::EFFECT_KEY, key.span();
                "found effect `{}`, expected its name and place", key.get_ref(); "such as \"rack_pitch(two)\"");
            continue;
        };
        for place in at
            .split(',')
            .map(str::trim)
            .filter(|place| !places.contains(place))
        {
            mistake!(mistakes, files::UNKNOWN_NAME, key.span(); "robot `{}` has no place `{place}`", robot.name;
                "expected one of {}", quoted(places.iter().copied()));
        }
        effect_values(mistakes, root, key, (name.trim(), at), robot);
    }
    meant
}

/// The reference has a number for each command.
fn reference(mistakes: &mut Mistakes<'_>, root: &DeTable<'_>, file: &RobotFile, robot: &Robot) {
    let table = root.get("reference").map(Spanned::get_ref);
    let given = table.and_then(|table| table.get("commands_m").or_else(|| table.get("commands")));
    if let (Some(reference), Some(given)) = (&file.reference, given)
        && reference.commands_m.len() != robot.commands
    {
        let (found, expected) = (reference.commands_m.len(), robot.commands);
        mistake!(mistakes, files::COUNT, given.span();
            "found {found} commands, expected {expected}, as robot `{}` has", robot.name);
    }
    let Some((reference, table)) = file.reference.as_ref().zip(table) else {
        return;
    };
    let shape = Shape::from(robot);
    turns(mistakes, given.map(Spanned::get_ref), file, &shape);
    for (key, names, values) in [
        ("position_m", POSITION, reference.position_m),
        ("orientation_rad", ANGLES, reference.orientation_rad),
    ] {
        let idle = shape.idle_names();
        let is_astray = |k: usize| idle.contains(&names[k]) && values[k].abs() > NO_MOTION;
        if let (true, Some(given)) = ((0..3).any(is_astray), table.get(key)) {
            mistake!(mistakes, files::IDLE_MOTION, given.span();
                "the reference does not fit the plate: {}", stays(robot.plate); "write zeros there");
        }
    }
}

/// Commands of cranks in the reference are radians; a calibration may have written those of an encoder that counts turns.
fn turns(
    mistakes: &mut Mistakes<'_>,
    given: Option<&DeValue<'_>>,
    file: &RobotFile,
    shape: &Shape,
) {
    let calibrated = file
        .calibration
        .as_ref()
        .map_or(&[][..], |own| &own.commands_m);
    let each = given.and_then(DeValue::as_array).into_iter().flatten();
    let reference = file.reference.iter().flat_map(|own| &own.commands_m);
    for ((k, command), place) in reference.enumerate().zip(each) {
        let is_known = calibrated
            .get(k)
            .is_some_and(|[low, high]| (*low..=*high).contains(command));
        if shape.drives.get(k) == Some(&Actuator::Crank)
            && command.abs() > LARGEST_ANGLE_RAD
            && !is_known
        {
            mistake!(mistakes, files::NOT_RADIANS, place.span();
                "found the command {command} of a crank, expected radians between -2*pi and 2*pi";
                "are these degrees? multiply by pi/180, and leave out whole turns");
        }
    }
}

/// The noise of the drives is one number, or one for each command; their travel is a range for each.
fn drives(mistakes: &mut Mistakes<'_>, root: &DeTable<'_>, robot: &Robot) {
    let table = root.get("drives").and_then(|own| own.get_ref().as_table());
    let given = table.and_then(|table| table.get("noise_m"));
    if let Some(given) = given
        && let DeValue::Array(each) = given.get_ref()
        && each.len() != robot.commands
    {
        mistake!(mistakes, files::COUNT, given.span();
            "found {} numbers, expected {}, one for each command of robot `{}`, or a single one for all",
                each.len(), robot.commands, robot.name);
    }
    let given = table.and_then(|table| table.get("travel"));
    let Some((given, each)) = given.and_then(|own| Some((own, own.get_ref().as_array()?))) else {
        return;
    };
    if each.len() != robot.commands {
        let plural = if each.len() == 1 { "" } else { "s" };
        mistake!(mistakes, files::COUNT, given.span();
            "found {} range{plural}, expected {}, one for each command of robot `{}`",
                each.len(), robot.commands, robot.name);
        return;
    }
    for (command, pair) in each.iter().enumerate() {
        let ends = pair.get_ref().as_array().into_iter().flatten();
        let mut ends = ends.filter_map(|end| number(end.get_ref()));
        if let Some(end) = ends.find(|end| end.abs() > LONGEST_M && !robot.is_angle(command)) {
            let message = format!("found {end}, expected metres, at most {LONGEST_M}");
            let help = if end.is_finite() {
                "this looks like millimetres: divide by 1000"
            } else {
                "write the end of the travel as a number, or leave `travel` out"
            };
            mistakes.push_with_help(files::NOT_METRES, pair.span(), message, help);
        }
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) => integer.as_str().parse().ok(),
        _ => None,
    }
}

/// A tension that a link is pulled to is given for links alone whose description gives one with a tolerance.
fn pulls(mistakes: &mut Mistakes<'_>, root: &DeTable<'_>, robot: &Robot) {
    for name in keys_of(root, "links") {
        let link = (robot.links.iter()).position(|link| link.name == name.get_ref().as_ref());
        let table = root.get("links").and_then(|own| own.get_ref().as_table());
        let table = table.and_then(|own| own.get(name.get_ref().as_ref())?.get_ref().as_table());
        let key = table.and_then(|table| table.get_key_value(LinkKey::Pull.key()));
        if let (Some(link), Some((key, _))) = (link, key)
            && !robot.has_parameter(link, LinkKey::Pull)
        {
            let name = name.get_ref();
            let message = format!("link `{name}` is not pulled to a tension with a tolerance");
            let help = "leave `pull_N` out, or write `pulled = … N tol … N;` in the description";
            mistakes.push_with_help(files::NOT_PULLED, key.span(), message, help);
        }
    }
}

/// An effect that the robot has anywhere has the parameters that the file gives it, in as many components.
///
/// One that it has nowhere may be that of another description, which is no mistake.
fn effect_values(
    mistakes: &mut Mistakes<'_>,
    root: &DeTable<'_>,
    key: &Spanned<DeString<'_>>,
    (name, at): (&str, &str),
    robot: &Robot,
) {
    let places: Vec<String> = at.split(',').map(|place| place.trim().to_owned()).collect();
    let meant = robot.model.effect_at(name, &places);
    let mut components: BTreeMap<&str, usize> = BTreeMap::new();
    let variants = robot.variants.iter();
    let parameters = variants.flat_map(|own| own.parameters.iter().map(move |p| (own, p)));
    for (variant, parameter) in parameters {
        let Owner::Effect(index) = parameter.owner else {
            continue;
        };
        // Effects of one name on places of other kinds have parameters of their own.
        let (own, own_places) = &variant.effects[index];
        if own == name && robot.model.effect_at(own, own_places) == meant {
            let count = components.entry(&parameter.quantity).or_default();
            *count = parameter.component.map_or(1, |c| (c + 1).max(*count));
        }
    }
    let values = root
        .get("effects")
        .and_then(|effects| effects.get_ref().get(key.get_ref().as_ref()))
        .and_then(|values| values.get_ref().as_table());
    if components.is_empty() {
        return;
    }
    for (parameter, value) in values.into_iter().flatten() {
        let quantity = parameter.get_ref().as_ref();
        let Some(&expected) = components.get(quantity) else {
            mistake!(mistakes, files::UNKNOWN_NAME, parameter.span(); "effect `{name}` has no parameter `{quantity}`";
                "{}", suggestion(quantity, components.keys().copied()));
            continue;
        };
        let found = value.get_ref().get("value");
        let count = found.map(|value| value.get_ref().as_array().map_or(1, |array| array.len()));
        if count.is_some_and(|count| count != expected) {
            let expected = if expected == 1 {
                "a number"
            } else {
                "three numbers"
            };
            mistake!(mistakes, files::COUNT, value.span(); "expected {expected} as the value of `{quantity}`");
        }
    }
}

/// Every link has its values, from the file or from the description, unless its cluster has been
/// calibrated as a reduced arm.
pub(super) fn complete(
    mistakes: &mut Mistakes<'_>,
    root: &DeTable<'_>,
    file: &RobotFile,
    robot: &Robot,
    misspelt: &[&str],
) {
    of_machine(mistakes, root, robot, misspelt);
    let described = described_links(robot);
    for (index, link) in robot.links.iter().enumerate() {
        let cluster = &robot.clusters[link.cluster];
        if file.clusters.contains_key(&cluster.name) || misspelt.contains(&link.name.as_str()) {
            continue;
        }
        let described = |key: LinkKey| {
            let values = described.get(index);
            values.is_some_and(|values| values.get(key).is_some())
        };
        let shared = cluster
            .track
            .and_then(|track| file.tracks.get(&robot.tracks[track]));
        let oriented = |values: &LinkValues| {
            values.track_direction.is_some() || values.track_rotation.is_some()
        };
        // A value that was there but wrong has been reported already.
        let given = |key: LinkKey| {
            let table = root
                .get("links")
                .and_then(|links| links.get_ref().get(link.name.as_str()));
            table.is_some_and(|table| table.get_ref().get(key.key()).is_some())
        };
        let direction = LinkKey::Geometry(Geometry::TrackDirection);
        let oriented_here = given(direction) || given(LinkKey::TrackRotation);
        let keys = Geometry::ALL.into_iter().map(LinkKey::Geometry);
        let missing = keys.filter(|&key| {
            let is_given = if key == direction {
                oriented_here || cluster.track.is_none() || shared.is_some_and(oriented)
            } else {
                given(key)
            };
            robot.has_parameter(index, key) && !is_given && !described(key)
        });
        let missing: Vec<&str> = missing.map(LinkKey::key).collect();
        if missing.is_empty() {
            continue;
        }
        let key = keys_of(root, "links").find(|key| key.get_ref().as_ref() == link.name);
        match key {
            Some(key) => {
                mistake!(mistakes, files::KEY_MISSING, key.span(); "link `{}` lacks {}", link.name, quoted(missing);
                    "a length is given as `{{ value = 2.0, tol = 3e-4 }}`, the others as `{{ value = [0.1, 0.2, 0.3], tol = \
                     3e-4 }}`");
            }
            None => mistake!(mistakes, files::KEY_MISSING, key_place(root, "links");
                "`[links.{}]` is missing, expected {}", link.name, quoted(missing)),
        }
    }
}

/// Every crank and every parameter of the machine has its values, in as many components, from the file or from the
/// description.
fn of_machine(mistakes: &mut Mistakes<'_>, root: &DeTable<'_>, robot: &Robot, misspelt: &[&str]) {
    let entry = |section: &str, name: &str| {
        let table = root.get(section)?.get_ref().as_table()?;
        Some(table.get(name)?.clone())
    };
    for parameter in machine_parameters(robot) {
        let name = parameter.name.as_str();
        let Some(given) = entry("parameters", name) else {
            if parameter.nominal.is_none() && !misspelt.contains(&name) {
                let place = key_place(root, "parameters");
                let message = format!("parameter `{name}` is missing in `[parameters]`");
                let unit = parameter.dimension.si_unit();
                let help = format!("write `{name} = {{ value = …, tol = … }}`, in {unit}");
                mistakes.push_with_help(files::KEY_MISSING, place, message, help);
            }
            continue;
        };
        let value = given.get_ref().get("value");
        let count = value.map(|value| value.get_ref().as_array().map_or(1, |array| array.len()));
        if count.is_some_and(|count| count != parameter.components) {
            let expected = if parameter.components == 1 {
                "a number"
            } else {
                "three numbers"
            };
            mistake!(mistakes, files::COUNT, given.span(); "expected {expected} as the value of `{name}`");
        }
        if parameter.dimension == Dimension::ANGLE && !winds(robot, name) {
            angles(mistakes, &given, name);
        } else if parameter.dimension == Dimension::LENGTH {
            let is_place = parameter.components > 1;
            let largest = if is_place { FARTHEST_M } else { LONGEST_M };
            lengths(mistakes, &given, name, largest);
        }
    }
    for (crank, value) in crank_values(robot) {
        let given = entry("cranks", &crank);
        let is_given = given.is_some_and(|given| given.get_ref().get(value.key).is_some());
        if !is_given && value.quantity.value.is_none() {
            let message = format!("`{}` is missing in `[cranks.{crank}]`", value.key);
            mistakes.push(files::KEY_MISSING, key_place(root, "cranks"), message);
        }
    }
}

/// True if a parameter stands in the length of a link that a drum winds up, whose angle may be of many turns.
fn winds(robot: &Robot, parameter: &str) -> bool {
    let model = &robot.model;
    let reads = |part: &Formula| match part {
        Formula::OfRobot(index, _) => {
            let read = model.parameters.get(*index);
            read.is_some_and(|own| own.name == parameter)
        }
        _ => false,
    };
    let wound = model.links.iter().filter(|link| link.is_driven_by_angle);
    let mut lengths = wound.filter_map(|link| link.defaults.length.formula.as_ref());
    lengths.any(|length| length.parts().any(reads))
}

/// Value and tolerance of a parameter that is an angle are radians.
fn angles(mistakes: &mut Mistakes<'_>, given: &Spanned<DeValue<'_>>, name: &str) {
    let value = "radians between -2*pi and 2*pi".to_owned();
    let tol = "radians, at most pi".to_owned();
    let bounds = [(LARGEST_ANGLE_RAD, value), (std::f64::consts::PI, tol)];
    let help = "are these degrees? multiply by pi/180";
    within(
        mistakes,
        given,
        &format!("`{name}`, an angle"),
        bounds,
        (files::NOT_RADIANS, help),
    );
}

/// Value and tolerance of a parameter that is a length, or a place, are metres.
fn lengths(mistakes: &mut Mistakes<'_>, given: &Spanned<DeValue<'_>>, name: &str, largest_m: f64) {
    let bounds =
        [largest_m, WIDE * largest_m].map(|most| (most, format!("metres, at most {most}")));
    let help = "these look like millimetres: divide by 1000";
    within(
        mistakes,
        given,
        &format!("`{name}`, a length"),
        bounds,
        (files::NOT_METRES, help),
    );
}

/// The numbers of value and tolerance are no larger than they can be: `bounds` are those of each, with what is expected.
fn within(
    mistakes: &mut Mistakes<'_>,
    given: &Spanned<DeValue<'_>>,
    what: &str,
    bounds: [(f64, String); 2],
    (code, help): (Code, &str),
) {
    for (key, (largest, expected)) in ["value", "tol"].into_iter().zip(bounds) {
        let Some(stated) = given.get_ref().get(key) else {
            continue;
        };
        let numbers = match stated.get_ref() {
            DeValue::Array(numbers) => numbers.iter().collect(),
            _ => vec![stated],
        };
        for number in numbers {
            let found = as_number(number.get_ref()).filter(|found| found.abs() > largest);
            if let Some(found) = found {
                let message =
                    format!("found {found} as the `{key}` of {what}, expected {expected}");
                mistakes.push_with_help(code, number.span(), message, help);
            }
        }
    }
}

/// A number of the file; what is none is reported where it is read.
fn as_number(value: &DeValue<'_>) -> Option<f64> {
    let text = match value {
        DeValue::Integer(number) => number.as_str(),
        DeValue::Float(number) => number.as_str(),
        _ => return None,
    };
    text.parse().ok()
}

fn keys_of<'t, 'i>(
    root: &'t DeTable<'i>,
    section: &str,
) -> impl Iterator<Item = &'t Spanned<DeString<'i>>> + use<'t, 'i> {
    let table = root
        .get(section)
        .and_then(|value| value.get_ref().as_table());
    table.into_iter().flat_map(|table| table.keys())
}

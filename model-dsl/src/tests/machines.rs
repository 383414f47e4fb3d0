//! Plates, parameters of the machine, formulas, cranks, drives and what variants hold.

use std::cmp::Ordering;

use tau_codes::language;

use super::{codes, model};
use crate::model::{
    BinaryOperator, CrankValue, Formula, Function, Held, Plate, Readable, TrackShape, Value,
};
use crate::{Model, check_text};

/// A robot of three links on the base that hold a point, with items before them and values in each.
fn lines(items: &str, values: &str) -> String {
    format!(
        "robot Lines {{
    plate point;
    {items}
    cluster lines on base {{ link a, b, c {values} }}
    variant Full {{ arm full; }}
}}"
    )
}

fn length(model: &Model) -> &Formula {
    model.links[0].defaults.formula(Value::Length).unwrap()
}

#[test]
fn plates() {
    for (written, plate, freedoms) in [
        ("", Plate::Body, 6),
        ("plate body;", Plate::Body, 6),
        ("plate point;", Plate::Point, 3),
        ("plate body in plane;", Plate::BodyInPlane, 3),
        ("plate point in plane;", Plate::PointInPlane, 2),
    ] {
        let text = format!(
            "robot Any {{ {written} cluster legs on base {{ link a, b, c, d, e, f actuated length; }} variant Full {{ arm full; }} }}"
        );
        let found = model(&text).plate;
        assert_eq!(
            (found, found.freedoms().len()),
            (plate, freedoms),
            "{written}"
        );
    }
}

#[test]
fn commands_are_numbered_over_all_drives() {
    let model = model(
        "robot Mixed {
    plate point;
    cluster ropes on base { link rope actuated length; link drum actuated angle { length = pitch * q; } }
    crank arm;
    track rail;
    param pitch: m/rad;
    cluster on_arm on arm { link rod; }
    cluster on_rail on rail { link strut; }
    variant Full { arm full; tracks linear; }
}",
    );
    let drives: Vec<(String, bool)> = model
        .drives()
        .into_iter()
        .map(|drive| (drive.name, drive.is_angle))
        .collect();
    let expected = [
        ("arm", true),
        ("rail", false),
        ("rope", false),
        ("drum", true),
    ];
    assert_eq!(
        drives,
        expected.map(|(name, angle)| (name.to_owned(), angle))
    );
    let shapes: Vec<TrackShape> = model.variants[0]
        .tracks
        .iter()
        .map(|own| own.shape)
        .collect();
    assert_eq!(shapes, [TrackShape::Crank, TrackShape::Linear]);
}

#[test]
fn a_formula_reads_parameters_constants_and_its_command() {
    let model = model(&lines(
        "param radius: m/rad = 75 mm/rad tol 0.5 mm/rad; param gear: ratio = 2.0 exact;",
        "actuated angle { length = radius * q / gear; }",
    ));
    assert_eq!(model.parameters[0].nominal, Some(vec![0.075]));
    assert!(model.parameters[1].exact);
    let expected = Formula::OfRobot(0, 0) * Formula::Read(Readable::Command) / Formula::Number(2.0);
    assert_eq!(length(&model), &expected);
}

#[test]
fn a_formula_reads_other_values_of_its_link() {
    // In whatever order they are written; what is a formula itself is put in.
    let model = model(&lines(
        "param far: length;",
        "actuated length { length = norm(track_offset) + q; track_offset = (far, 2 * far, 3 m); }",
    ));
    let Formula::Binary(BinaryOperator::Add, norm, _) = length(&model) else {
        panic!("{:?}", length(&model));
    };
    let Formula::Call(Function::Sqrt, squares) = &**norm else {
        panic!("{norm:?}");
    };
    let far = |value: f64| {
        squares[0].value(&|leaf| matches!(leaf, Formula::OfRobot(0, 0)).then_some(value))
    };
    assert_eq!(far(2.0), Some(4.0 + 16.0 + 9.0));
}

#[test]
fn what_has_parameters_of_its_own_is_read_by_them() {
    let model = model(&lines(
        "",
        "actuated length { length = norm(track_offset) + q; }",
    ));
    let mut leaves = length(&model).parts().filter_map(|part| match part {
        Formula::OfLink(value, component) => Some((*value, *component)),
        _ => None,
    });
    assert!(
        leaves
            .by_ref()
            .eq([0, 1, 2].map(|k| (Value::TrackOffset, k)))
    );
}

#[test]
fn exact_values_are_constants() {
    let model = model(&lines(
        "",
        "actuated length { length = 2 m exact; track_offset = (1, 2, 3) mm exact; }",
    ));
    let defaults = &model.links[0].defaults;
    assert_eq!(
        length(&model),
        &(Formula::Number(2.0) + Formula::Read(Readable::Command))
    );
    let numbers = [1e-3, 2e-3, 3e-3].map(Formula::Number);
    assert_eq!(
        defaults.formula(Value::TrackOffset),
        Some(&Formula::Vector(Box::new(numbers)))
    );
    assert_eq!(
        (defaults.length.value, defaults.track_offset.value),
        (None, None)
    );
}

#[test]
fn held_parameters_are_inherited() {
    let model = model(
        "robot Bars {
    plate point in plane;
    param upper: length;
    crank left, right { axis = (0, 0, 1) exact; }
    cluster on_left on left { link l1 { track_offset = (upper, 0 m, 0 m); } }
    cluster on_right on right { link r1 { track_offset = (upper, 0 m, 0 m); } }
    variant Full { hold upper; }
    variant Rods = Full hold all.centre;
    variant Nothing = Rods hold all.length;
}",
    );
    let holds = |name: &str| model.variant(name).unwrap().holds.clone();
    assert_eq!(holds("Full"), [Held::Parameter(0)]);
    let centres = [0, 1].map(|crank| Held::Crank(crank, CrankValue::Centre));
    assert_eq!(holds("Rods"), [Held::Parameter(0), centres[0], centres[1]]);
    let lengths = [0, 1].map(|link| Held::Link(link, Value::Length));
    let all = [
        Held::Parameter(0),
        lengths[0],
        lengths[1],
        centres[0],
        centres[1],
    ];
    assert_eq!(holds("Nothing"), all);
    let written: Vec<String> = all.iter().map(|held| held.written(&model)).collect();
    let expected = [
        "upper",
        "l1.length",
        "r1.length",
        "left.centre",
        "right.centre",
    ];
    assert_eq!(written, expected);
}

#[test]
fn pulling_drives() {
    let model = model(
        "robot Belts {
    plate point in plane;
    cluster belts on base {
        link a, b actuated length;
        link c actuated length { pulled = 140 N tol 20 N; }
        link d actuated length { pulled; }
    }
    variant Full { arm full; }
}",
    );
    let pulls: Vec<Option<Option<f64>>> = model
        .links
        .iter()
        .map(|link| {
            link.pull
                .as_ref()
                .map(|pull| pull.value.map(|[tension]| tension))
        })
        .collect();
    assert_eq!(pulls, [None, None, Some(Some(140.0)), Some(None)]);
    assert_eq!(model.links[2].pull.as_ref().unwrap().tolerance, Some(20.0));
}

#[test]
fn commands_of_a_reference_have_one_unit_or_one_each() {
    let robot = |commands: &str| {
        format!(
            "robot Mixed {{
    plate point in plane;
    crank arm;
    cluster on_arm on arm {{ link rod; }}
    cluster rope on base {{ link line actuated length; }}
    variant Full {{ arm full; }}
    reference {{ commands = {commands}; position = (1, 2, 0) m; }}
}}"
        )
    };
    let reference = model(&robot("(90 deg, 20 mm)")).reference.unwrap();
    assert_eq!(reference.commands, [std::f64::consts::FRAC_PI_2, 0.02]);
}

/// Freedoms of the plate, links and drives: what moves and is held is admitted, what cannot move or is loose is refused.
#[test]
fn mobility_is_counted() {
    let robot = |plate: &str, on_cart: usize, struts: usize| {
        let names = |what: &str, count: usize| {
            let names: Vec<String> = (0..count).map(|k| format!("{what}{k}")).collect();
            names.join(", ")
        };
        let mut text = format!(
            "robot Any {{ plate {plate}; track one; cluster arm on one {{ link {}; }}",
            names("l", on_cart)
        );
        if struts > 0 {
            text += &format!(
                "cluster base_arm on base {{ link {}; }}",
                names("s", struts)
            );
        }
        codes(&(text + " variant Full { arm full; tracks linear; } }"))
    };
    for (plate, freedoms) in [
        ("body", 6),
        ("point", 3),
        ("body in plane", 3),
        ("point in plane", 2),
    ] {
        for on_cart in 1..=freedoms + 2 {
            for struts in 0..=freedoms + 1 {
                let taken = on_cart - 1 + struts;
                let expected = match taken.cmp(&freedoms) {
                    Ordering::Less if on_cart + struts < freedoms => vec![language::LOOSE],
                    Ordering::Less => vec![],
                    Ordering::Equal => vec![language::CANNOT_MOVE],
                    Ordering::Greater => vec![language::OVER_CONSTRAINED],
                };
                let found = robot(plate, on_cart, struts);
                assert_eq!(found, expected, "{plate} {on_cart} {struts}");
            }
        }
    }
}

/// `all` holds what there is: values that follow from held parameters stay where they are.
#[test]
fn all_of_a_value_holds_what_is_not_held_already() {
    let model = model(
        "robot Lines {
    plate point;
    param height: length = 2 m;
    cluster lines on base {
        link a actuated length { track_offset = (0 m, 1 m, height); }
        link b actuated length { track_offset = (1, 0, 2) m exact; }
        link c actuated length;
    }
    variant Full { arm full; }
    variant Anchors = Full hold all.track_offset, height;
    variant Later = Anchors hold all.length;
}",
    );
    let holds = |name: &str| model.variant(name).unwrap().holds.clone();
    let anchors = [Held::Parameter(0), Held::Link(2, Value::TrackOffset)];
    assert_eq!(holds("Anchors"), anchors);
    let lengths = (0..3).map(|link| Held::Link(link, Value::Length));
    let later: Vec<Held> = holds("Later");
    assert_eq!(later.len(), anchors.len() + 3);
    assert!(lengths.chain(anchors).all(|one| later.contains(&one)));
}

/// Tracks have no values of their own: what the help names in their place can be held.
#[test]
fn what_a_track_carries_is_held() {
    let slide = |held: &str| {
        format!(
            "robot Slide {{
    track a, b;
    crank c {{ axis = (0, 0, 1) exact; }}
    param arm: length = 1 m;
    cluster ca on a {{ link l1, l2; }}
    cluster cb on b {{ link l3 {{ length = arm; }} link l4; }}
    cluster cc on c {{ link l5, l6; }}
    variant Full {{ arm full; tracks linear per link; }}
    variant Part = Full hold {held};
}}"
        )
    };
    for held in ["a", "b", "c", "l3", "a.track_direction", "c.length"] {
        let text = slide(held);
        assert_eq!(codes(&text), [language::CANNOT_HOLD], "{held}");
        let named = quoted(&text);
        assert!(!named.is_empty(), "{held}");
        for named in named {
            model(&slide(&named));
        }
    }
    let of_crank = slide("c.track_direction");
    assert_eq!(codes(&of_crank), [language::UNKNOWN_VALUE]);
}

/// Texts between backquotes in the help of a description's first mistake.
fn quoted(text: &str) -> Vec<String> {
    let errors = check_text(text).unwrap_err();
    let help = errors.diagnostics[0].help.as_deref().unwrap_or("");
    let quoted = help.split('`').skip(1).step_by(2);
    quoted.map(str::to_owned).collect()
}

/// The variant that a robot without any is advised to declare is one that it can have.
#[test]
fn the_variant_that_is_advised_compiles() {
    for parts in [
        "track one; cluster arm on one { link a, b, c, d, e, f; }",
        "cluster arm on base { link a, b, c, d, e, f actuated length; }",
        "plate point; crank one; cluster arm on one { link a; } cluster rope on base { link b, c actuated length; }",
        "plate point; track one; cluster arm on one { link a; } cluster rope on base { link b, c actuated length; }",
    ] {
        let robot = |variant: &str| format!("robot Any {{ {parts} {variant} }}");
        assert_eq!(codes(&robot("")), [language::PARTS_MISSING]);
        let [advised] = &quoted(&robot(""))[..] else {
            panic!("{parts}");
        };
        model(&robot(advised));
    }
}

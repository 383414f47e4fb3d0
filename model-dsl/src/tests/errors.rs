//! What becomes of mistakes: places, the name of a broken robot, conversions, catalogues.

use proc_macro2::Span;
use tau_codes::language;

use super::{GANTRY_TAU, codes_of, model, robot};
use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::{check_text, effects_from_text};

#[test]
fn positions_count_lines_and_characters() {
    let text = "\u{feff}// °\r\nrobot Slide {\r\n    /* ° */ trakc one;\r\n}\r\n";
    let errors = check_text(text).unwrap_err();
    let first = &errors.diagnostics[0];
    assert_eq!((first.line(), first.column()), (3, 13));
    assert_eq!(&text[first.byte_range()], "trakc");
}

#[test]
fn a_range_reaches_over_lines() {
    let text = robot("effect e on cart { param t: angle;\n along += q\n + t; }");
    let errors = check_text(&text).unwrap_err();
    assert_eq!(&text[errors.diagnostics[0].byte_range()], "q\n + t");
}

#[test]
fn the_robot_is_named_where_it_can_be() {
    let name = |text: &str| {
        let robot = check_text(text).unwrap_err().robot;
        robot.map(|(public, name)| (public, name.to_string()))
    };
    assert_eq!(
        name("pub robot Slide { track one }"),
        Some((true, "Slide".to_owned()))
    );
    assert_eq!(
        name("robot Slide { track one; }"),
        Some((false, "Slide".to_owned()))
    );
    assert_eq!(name("robot Slide"), Some((false, "Slide".to_owned())));
    assert_eq!(name("robot { }"), None);
}

#[test]
fn errors_become_one_of_syn() {
    let errors = check_text("robot Slide { track one; trakc two; }").unwrap_err();
    let combined: Vec<_> = syn::Error::from(&errors)
        .into_iter()
        .map(|one| one.to_string())
        .collect();
    let own: Vec<_> = errors.diagnostics.iter().map(ToString::to_string).collect();
    assert_eq!(combined, own);
}

#[test]
fn a_catalogue_joins_a_model() {
    let robot = model(GANTRY_TAU);
    let catalogue = "
        effect rack_pitch on cart { param other: length; along += other; }
        effect coupling on cart { param gain: number; along += gain * q(two); }";
    let joined = effects_from_text(catalogue, &robot).unwrap();
    let names: Vec<_> = joined
        .effects
        .iter()
        .map(|effect| effect.name.as_str())
        .collect();
    assert_eq!(names, ["rack_pitch", "coupling"]);
    assert_eq!(
        joined.effects[0], robot.effects[0],
        "the robot's own effect stands"
    );
    assert_eq!(joined.variants, robot.variants);
}

#[test]
fn the_code_stands_behind_the_first_line() {
    let errors = check_text("robot Slide { track one; trakc two; }").unwrap_err();
    let [one] = &errors.diagnostics[..] else {
        panic!("{errors}");
    };
    let help = one.help.as_deref().unwrap();
    assert_eq!(
        one.to_string(),
        format!("{} [{}]\nhelp: {help}", one.message, one.code)
    );
    assert_eq!(errors.to_string(), format!("1:26: {one}"));
}

#[test]
fn a_catalogue_with_mistakes() {
    let robot = model(GANTRY_TAU);
    let term = |formula: &str| {
        format!("effect e on cart {{ param gain: number; along += gain * {formula}; }}")
    };
    for (text, code, place) in [
        (
            "robot Other { }".to_owned(),
            language::UNKNOWN_WORD,
            "robot",
        ),
        (term("q(for)"), language::RUST_CODE, "for"),
        (term("q(ones)"), language::UNKNOWN_TRACK, "ones"),
    ] {
        let errors = effects_from_text(&text, &robot).unwrap_err();
        assert_eq!(codes_of(&errors), [code], "{errors}");
        let one = &errors.diagnostics[0];
        assert_eq!(&text[one.byte_range()], place);
        assert!(one.help.is_some(), "{one}");
    }
    assert_eq!(effects_from_text("", &robot).unwrap(), robot);
}

#[test]
#[should_panic(expected = "diagnostics were dropped unread")]
#[cfg(debug_assertions)]
fn diagnostics_cannot_be_forgotten() {
    let mut diagnostics = Diagnostics::new();
    diagnostics.push(Diagnostic::new(
        language::SYNTAX,
        Span::call_site(),
        "unread",
    ));
}

/// Drums wind many turns: their commands, and what is added to them.
#[test]
fn angles_of_drums_are_any() {
    model(
        "robot Drum {
    plate point in plane;
    param zero: angle = 40 rad tol 4 rad;
    param turns: angle = 50 rad exact;
    cluster lines on base {
        link a, b actuated angle {
            length = norm(track_offset) + 50 mm/rad * (q + turns);
            track_offset = (50 mm/rad * zero, 1 m, 0 m);
        }
    }
    reference { commands = (200, 300) rad; position = (0, 0, 0) m; }
    variant Full { arm full; }
}",
    );
}

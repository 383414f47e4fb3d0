//! Mistakes beyond the compile-fail cases: what happens after a mistake, and texts that are no tokens.

use insta::assert_snapshot;
use proc_macro2::Span;

use super::{GANTRY_TAU, errors, excerpts, model, robot};
use crate::diagnostics::{Diagnostic, Diagnostics};
use crate::{check_text, effects_from_text};

#[test]
fn all_at_once() {
    assert_snapshot!(errors(
        "pub robot Slide {
    track one, one, three;
    cluster arm1 on one { link l1; }
    cluster arm2 on tow { link l1; }
    cluster arm3 on three { }
    effect wobble on cart {
        param size: lenght tol -1 mm;
        param left: angle;
        along += size * sine(q) + left;
        rol += left;
    }
    variant Full { tracks linear; track four piecewise; }
    variant Wobbly = Ful + wobble(l1) + wobbel(one);
}"
    ), @r"
    track one, one, three;
               ^^^
    `one` is already declared as a track, on line 2
    help: choose another name
    cluster arm2 on tow { link l1; }
                    ^^^
    cannot find track `tow`
    help: the tracks are `one`, `three`
    cluster arm2 on tow { link l1; }
                               ^^
    `l1` is already declared as a link, on line 3
    help: choose another name
    cluster arm3 on three { }
            ^^^^
    cluster `arm3` has no links
    help: declare one: `link l1;`
    param size: lenght tol -1 mm;
                ^^^^^^
    unknown dimension or unit `lenght`
    help: did you mean `length`?
    along += size * sine(q) + left;
                    ^^^^
    `sine` is not a function
    help: a function with a similar name exists: `sin`
    rol += left;
    ^^^
    an effect cannot add to `rol`
    help: did you mean `roll`?
    variant Full { tracks linear; track four piecewise; }
            ^^^^
    variant `Full` has no arm
    help: write `arm reduced;` or `arm full;`
    variant Full { tracks linear; track four piecewise; }
                                        ^^^^
    cannot find track `four`
    help: the tracks are `one`, `three`
    variant Wobbly = Ful + wobble(l1) + wobbel(one);
                     ^^^
    cannot find variant `Ful`
    help: a variant with a similar name exists: `Full`
    variant Wobbly = Ful + wobble(l1) + wobbel(one);
                                  ^^
    `wobble` acts on a cart, but `l1` is a link
    help: name a track: `one`, `one`, `three`
    variant Wobbly = Ful + wobble(l1) + wobbel(one);
                                        ^^^^^^
    cannot find effect `wobbel`
    help: an effect with a similar name exists: `wobble`
    ");
}

#[test]
fn items_after_a_mistake_are_read() {
    assert_snapshot!(errors(
        "robot Slide {
    track one two;
    cluster arm1 on one { link l1 l2; lnk l3; link l4 }
    effect e on cart { param a: length b; search p: length in 1 m .. 2 m; along += (a q); along -= a; }
    variant Full { arm full tracks linear; track one curved; }
}
robot
effect"
    ), @r"
    track one two;
              ^^^
    expected `;`, found `two`
    help: every declaration without braces ends with `;`
    cluster arm1 on one { link l1 l2; lnk l3; link l4 }
                                  ^^
    expected `;`, found `l2`
    help: a link ends with `;`, or with its values in braces
    cluster arm1 on one { link l1 l2; lnk l3; link l4 }
                                      ^^^
    expected `link`, found `lnk`
    help: did you mean `link`?
    cluster arm1 on one { link l1 l2; lnk l3; link l4 }
                                                      ^
    expected `;`, found `}`
    help: a link ends with `;`, or with its values in braces
    effect e on cart { param a: length b; search p: length in 1 m .. 2 m; along += (a q); along -= a; }
                                       ^
    expected `;`, found `b`
    help: every declaration without braces ends with `;`
    effect e on cart { param a: length b; search p: length in 1 m .. 2 m; along += (a q); along -= a; }
                                                                  ^
    expected `..=`, found `.`
    help: a searched parameter reads `search name: length in 4 mm ..= 50 mm;`
    effect e on cart { param a: length b; search p: length in 1 m .. 2 m; along += (a q); along -= a; }
                                                                                      ^
    expected an operator, `,` or `)`, found `q`
    help: any two values have an operator or a comma between them
    effect e on cart { param a: length b; search p: length in 1 m .. 2 m; along += (a q); along -= a; }
                                                                                                ^
    expected `+=`, found `-`
    help: effects add up: `along += …;`
    variant Full { arm full tracks linear; track one curved; }
                            ^^^^^^
    expected `;`, found `tracks`
    help: every declaration without braces ends with `;`
    variant Full { arm full tracks linear; track one curved; }
                                                     ^^^^^^
    expected `linear` or `piecewise`, found `curved`
    help: write one of these words
    effect
    ^^^^^^
    expected `{`, found the end of the description
    help: a robot's parts stand in braces: `robot Name { … }`
    ");
}

#[test]
fn text_that_is_no_tokens() {
    assert_snapshot!(errors("robot Slide { track one;"), @r"
    robot Slide { track one;
                ^
    `{` is never closed
    help: every bracket needs its partner
    ");
    assert_snapshot!(errors("robot Slide { track one; }}"), @r"
    robot Slide { track one; }}
                              ^
    `}` closes nothing that is open
    help: every bracket needs its partner
    ");
    assert_snapshot!(errors("robot Slide { track one; )"), @r"
    robot Slide { track one; )
                             ^
    `)` does not close the `{` of line 1, column 13
    help: close that with `}` before
    ");
    assert_snapshot!(errors("robot Slide { /* ( */ track one; // (\n link l1 { length = (1 m }\n}"), @r"
    link l1 { length = (1 m }
                            ^
    `}` does not close the `(` of line 2, column 21
    help: close that with `)` before
    ");
    assert_snapshot!(errors("robot Slide { track \"one; }"), @r#"
    robot Slide { track "one; }
                        ^
    this quotation mark has no meaning in a model
    help: names and numbers are written without quotation marks
    "#);
    assert_snapshot!(errors("robot Slide { track µ°; }"), @r"
    robot Slide { track µ°; }
                         ^
    `°` has no meaning in a model
    help: a description consists of names, numbers, operators and brackets
    ");
    assert_snapshot!(errors("/* robot Slide {}"), @r"
    /* robot Slide {}
    ^
    this comment is never closed
    help: end it with `*/`
    ");
}

#[test]
fn nothing_at_all() {
    assert_snapshot!(errors(""), @r"
    ^
    the description is empty
    help: write `robot Name { track …; cluster …; variant …; }`
    ");
    assert_snapshot!(errors("  \n// a comment\n"), @r"
    ^
    the description is empty
    help: write `robot Name { track …; cluster …; variant …; }`
    ");
}

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
fn a_catalogue_with_mistakes() {
    let robot = model(GANTRY_TAU);
    let wrong = |text: &str| excerpts(text, &effects_from_text(text, &robot).unwrap_err());
    assert_snapshot!(wrong("robot Other { }"), @r"
    robot Other { }
    ^^^^^
    expected `effect`, found `robot`
    help: a catalogue holds effects only
    ");
    assert_snapshot!(wrong("effect e on cart { param gain: number; along += gain * q(for); }"), @r"
    effect e on cart { param gain: number; along += gain * q(for); }
                                                             ^^^
    this Rust code has no meaning in a model
    help: a model is declared, without control flow; formulas stand in the terms of effects
    ");
    assert_snapshot!(wrong("effect e on cart { param gain: number; along += gain * q(ones); }"), @r"
    effect e on cart { param gain: number; along += gain * q(ones); }
                                                             ^^^^
    cannot find track `ones`
    help: a track with a similar name exists: `one`
    ");
    assert_eq!(effects_from_text("", &robot).unwrap(), robot);
}

#[test]
#[should_panic(expected = "diagnostics were dropped unread")]
#[cfg(debug_assertions)]
fn diagnostics_cannot_be_forgotten() {
    let mut diagnostics = Diagnostics::new();
    diagnostics.push(Diagnostic::new(Span::call_site(), "unread"));
}

#[test]
fn references_that_say_nothing() {
    let text = robot("reference { height = 2 m; }");
    assert_snapshot!(errors(&text), @"
    reference { height = 2 m; }
                ^^^^^^
    expected `commands`, `position` or `orientation`, found `height`
    help: every declaration begins with its keyword
    ");
    let text = robot(
        "reference { commands = (0, 0, 0) m; position = (1, 2, 3) rad; orientation = 2 rad; }
    reference { }",
    );
    assert_snapshot!(errors(&text), @"
    reference { commands = (0, 0, 0) m; position = (1, 2, 3) rad; orientation = 2 rad; }
                           ^^^^^^^^^^^
    `commands` must be 2 numbers, found 3
    help: one for each track or crank, then one for each driven link
    reference { commands = (0, 0, 0) m; position = (1, 2, 3) rad; orientation = 2 rad; }
                                                   ^^^^^^^^^^^^^
    `position` must be length (m), found angle (rad)
    help: write one of the units m, km, cm, mm, um, nm
    reference { commands = (0, 0, 0) m; position = (1, 2, 3) rad; orientation = 2 rad; }
                                                                                ^^^^^
    `orientation` must be 3 numbers, found 1
    help: write the ZYZ Euler angles `(alpha, beta, gamma)`
    reference { }
    ^^^^^^^^^
    a second `reference`, but one pose settles how the arm is assembled
    help: leave out one of them
    ");
}

#[test]
fn too_many_links_say_why_not() {
    let links: Vec<String> = (0..201).map(|k| format!("l{k}")).collect();
    let text = format!(
        "robot Centipede {{ track one; cluster legs on one {{ link {}; }}\n\
         variant Full {{ arm full; tracks linear; }} }}",
        links.join(", ")
    );
    let found = check_text(&text).unwrap_err().to_string();
    assert!(
        found.contains("robot `Centipede` has 201 links, expected at most 200"),
        "{found}"
    );
}

const ARMS: &str = "robot Arms {
    plate point in plane;
    param lead: angle = 2 rad tol 1 mrad;
    crank left, right { axis = (0, 0, 1) exact; centre = (0, 0, 0) m tol 1 mm; }
    cluster a on left { link la { length = 1 m tol 1 mm; track_offset = (0.5 m * cos(lead), 0.5 m * sin(lead), 0 m); } }
    cluster b on right { link lb { length = 1 m tol 1 mm; track_offset = (0.5, 0, 0) m tol 1 mm; } }
    reference { commands = (0.5, 1) rad; position = (0, 1, 0) m; }
    variant Full { arm full; }
}";

/// The bounds are those of robot files, and the place is the number's.
#[test]
fn numbers_that_no_machine_has() {
    model(ARMS);
    for (from, to, place, message, help) in [
        (
            "length = 1 m",
            "length = 1000 m",
            "1000 m",
            "found 1000 m, expected at most 50 m",
            "this looks like millimetres: write `mm`",
        ),
        (
            "length = 1 m",
            "length = 1e6 mm",
            "1e6 mm",
            "found 1000 m, expected at most 50 m",
            "check the number and its unit",
        ),
        (
            "length = 1 m tol 1 mm",
            "length = 1 m tol 1e-300 mm",
            "1e-300 mm",
            "e-303 m, expected at least 1e-12 m",
            "a tolerance is one standard deviation",
        ),
        (
            "length = 1 m tol 1 mm",
            "length = 1 m tol 1e6 m",
            "1e6 m",
            "found a tolerance of 1000000.0 m, expected at most 50000 m",
            "a tolerance is one standard deviation",
        ),
        (
            "track_offset = (0.5, 0, 0) m",
            "track_offset = (500, 0, 0) m",
            "(500, 0, 0) m",
            "found 500 m, expected at most 100 m",
            "write `mm`",
        ),
        (
            "centre = (0, 0, 0) m tol 1 mm",
            "centre = (0, 0, -400) m exact",
            "(0, 0, -400) m",
            "found -400 m, expected at most 100 m",
            "write `mm`",
        ),
        (
            "angle = 2 rad",
            "angle = 210 rad",
            "210 rad",
            "found 210 rad as the value of `lead`, an angle, expected radians between -2*pi and 2*pi",
            "are these degrees? write `deg`",
        ),
        (
            "angle = 2 rad tol 1 mrad",
            "angle = 210 rad exact",
            "210 rad",
            "found 210 rad as the value of `lead`",
            "write `deg`",
        ),
        (
            "tol 1 mrad",
            "tol 5 rad",
            "5 rad",
            "found a tolerance of 5 rad for `lead`, an angle, expected at most pi",
            "write `deg`",
        ),
        (
            "tol 1 mrad",
            "tol 1e-300 rad",
            "1e-300 rad",
            "found a tolerance of 1e-300 rad, expected at least 1e-30 rad",
            "a tolerance is one standard deviation",
        ),
        (
            "(0.5, 1) rad",
            "(120, 60) rad",
            "(120, 60) rad",
            "found the command 120 of a crank, expected radians between -2*pi and 2*pi",
            "are these degrees? write `deg`, and leave out whole turns",
        ),
        (
            "(0.5, 1) rad",
            "(0.5 rad, 450 deg)",
            "450 deg",
            "of a crank, expected radians between -2*pi and 2*pi",
            "leave out whole turns",
        ),
        (
            "position = (0, 1, 0) m",
            "position = (0, 415, 0) m",
            "(0, 415, 0) m",
            "found 415 m, expected at most 100 m",
            "write `mm`",
        ),
    ] {
        let text = ARMS.replacen(from, to, 1);
        assert_ne!(text, ARMS, "{from}");
        let found = check_text(&text).unwrap_err();
        let [one] = &found.diagnostics[..] else {
            panic!("{found}");
        };
        assert_eq!(&text[one.byte_range()], place, "{found}");
        let said = one.to_string();
        assert!(said.contains(message) && said.contains(help), "{said}");
    }
    for (reference, message) in [
        (
            "commands = (0, 300) m; position = (0, 0, 0) m;",
            "found 300 m, expected at most 50 m",
        ),
        (
            "position = (0, 0, 0) m; orientation = (90, 0, 0) rad;",
            "found the angle 90, expected radians",
        ),
    ] {
        let found = errors(&robot(&format!("reference {{ {reference} }}")));
        assert!(found.contains(message), "{found}");
    }
    let found = errors(&robot(
        "effect e on cart { param gap: length tol 1e-40 m; along += gap; }",
    ));
    assert!(found.contains("expected at least 1e-30 m"), "{found}");
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

/// A formula that has no value at the description's own numbers is told where it stands; one that reads the command is not
/// known before.
#[test]
fn formulas_have_values() {
    let arm = |length: &str| {
        errors(&format!(
            "robot Delta {{
    plate point;
    param radius: length = 140 mm tol 1 mm;
    param arm: length = {length} exact;
    track a, b, c;
    cluster on_a on a {{ link one {{ length = arm; track_offset = (radius, 0 m, sqrt(arm^2 - radius^2)); track_direction = (0, 0, 1); }} }}
    cluster on_b on b {{ link two {{ length = arm; track_offset = (0 m, radius, 0 m); track_direction = (0, 0, 1); }} }}
    cluster on_c on c {{ link three {{ length = arm; track_offset = (0 m, -radius, 0 m); track_direction = (0, 0, 1); }} }}
    variant Full {{ arm full; tracks linear; }}
}}"
        ))
    };
    let found = arm("133 mm");
    assert!(
        found.contains("`track_offset` is not a finite number"),
        "{found}"
    );
    assert_eq!(found.matches("finite").count(), 1, "{found}");
    assert!(!arm("141 mm").contains("finite"));
}

//! Declarations with an error raise no second one where they are used.

use tau_codes::Code;
use tau_codes::language::{
    DECLARED_TWICE, DRIVEN_TWICE, HASH_COMMENT, NAME_WITH_MEANING, UNKNOWN_CHARACTER, UNKNOWN_TRACK,
};

use super::{codes, model, robot};

/// A description with one mistake.
fn once(text: &str, code: Code) {
    assert_eq!(codes(text), [code], "{text}");
}

/// A name that formulas know, or that is declared twice, may mean either where it is read.
#[test]
fn names_with_two_meanings() {
    let line = |parameters: &str, length: &str| {
        format!(
            "robot Lines {{
    plate point;
    {parameters}
    cluster lines on base {{ link a, b, c actuated length {{ length = {length}; }} }}
    variant Full {{ }}
}}"
        )
    };
    once(
        &line("param q: length = 2 mm;", "q + 1 m"),
        NAME_WITH_MEANING,
    );
    once(&line("param q[3]: angle;", "q[0] + 1 m"), NAME_WITH_MEANING);
    once(&line("param m: length = 2 mm;", "m + q"), NAME_WITH_MEANING);
    once(&line("param m: length = 2 mm;", "m"), NAME_WITH_MEANING);
    once(
        &line("param length: length = 2 mm;", "length + q"),
        NAME_WITH_MEANING,
    );
    let twice = "param arm: length; param arm: angle;";
    once(&line(twice, "arm + q"), DECLARED_TWICE);
    for (parameters, formula, code) in [
        ("param q: angle;", "q", NAME_WITH_MEANING),
        ("param x[3]: length;", "x[0] + 1 N", NAME_WITH_MEANING),
        ("param a: angle; param a: length;", "a", DECLARED_TWICE),
    ] {
        let effect = format!("effect e on cart {{ {parameters} along += {formula}; }}");
        once(&robot(&effect), code);
    }
}

/// A link that its carrier drives already may be meant as one on the base or without a drive.
#[test]
fn drives_of_what_is_driven() {
    let mixed = |link: &str, variant: &str| {
        format!(
            "robot Mixed {{
    plate body in plane;
    param arm: length = 0.3 m;
    crank a, b;
    track t;
    cluster on_a on a {{ link one {{ length = arm; }} }}
    cluster on_b on b {{ link two; }}
    cluster on_t on t {{ link three {link} link four; }}
    reference {{ commands = (10 deg, 20 deg, 0.1 m); position = (0, 0, 0) m; }}
    variant Full {{ {variant} tracks linear; }}
}}"
        )
    };
    model(&mixed(";", "arm full;"));
    for link in [
        "actuated length;",
        "actuated angle;",
        "actuated length { length = arm; }",
        "actuated length { length = arm + q; }",
        "actuated angle { length = 0.3 m; }",
        "actuated length { track_offset = (length, 0 m, 0 m); }",
    ] {
        once(&mixed(link, "arm full;"), DRIVEN_TWICE);
    }
    let reduced = mixed("actuated length;", "arm reduced;").replace("{ length = arm; }", ";");
    let reduced = reduced.replace("param arm: length = 0.3 m;", "");
    once(&reduced, DRIVEN_TWICE);
}

/// Commands are counted where it is known what is driven.
#[test]
fn commands_of_tracks_declared_twice() {
    let text = "robot Slide {
    track one, two, two;
    cluster arm1 on one { link l1; }
    cluster arm2 on two { link l2, l3, l4, l5, l6; }
    reference { commands = (0, 0) m; position = (0, 0, 0) m; }
    variant Full { arm full; tracks linear; }
}";
    once(text, DECLARED_TWICE);
}

/// The carrier of a cluster decides on the values of its links.
#[test]
fn values_on_an_unknown_carrier() {
    let text = robot("cluster more on tow { link m1 { track_direction = (1, 0, 0); } }");
    once(&text, UNKNOWN_TRACK);
}

/// No text is read past a character that begins no token; a `#` before it is what is meant, where it begins no attribute.
#[test]
fn characters_behind_a_hash() {
    for text in ["# 20 °C", "robot R { # \"A\n}", "/* a */ # see (1\n"] {
        once(text, HASH_COMMENT);
    }
    for text in ["/* # */ °", "// #\n °", "#[a] °"] {
        once(text, UNKNOWN_CHARACTER);
    }
}

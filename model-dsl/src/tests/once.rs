//! Declarations with an error raise no second one where they are used.

use insta::assert_snapshot;

use super::{errors, robot};
use crate::check_text;

#[test]
fn what_has_an_error_raises_no_second() {
    // An unknown unit, dimension, track or variant poisons what depends on it, silently.
    assert_snapshot!(errors(&robot(
        "effect e on cart {
        param a: lenght = 1 mm tol 1 mm;
        search p: lenght in 4 mm ..= 50 mm;
        along += a + q + 3 N * a / p;
    }
    variant A = Ful + e(one);
    variant B = A + e(two);"
    )), @r"
    param a: lenght = 1 mm tol 1 mm;
             ^^^^^^
    unknown dimension or unit `lenght`
    help: did you mean `length`?
    search p: lenght in 4 mm ..= 50 mm;
              ^^^^^^
    unknown dimension or unit `lenght`
    help: did you mean `length`?
    variant A = Ful + e(one);
                ^^^
    cannot find variant `Ful`
    help: a variant with a similar name exists: `Full`
    ");
}

/// A description whose only mistake is one message.
fn once(text: &str, message: &str) {
    let found = errors(text);
    assert_eq!(found.matches("help:").count(), 1, "{found}");
    assert!(found.contains(message), "{found}");
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
    let meaning = "cannot be a parameter";
    once(&line("param q: length = 2 mm;", "q + 1 m"), meaning);
    once(&line("param q[3]: angle;", "q[0] + 1 m"), meaning);
    once(&line("param m: length = 2 mm;", "m + q"), meaning);
    once(&line("param m: length = 2 mm;", "m"), meaning);
    once(
        &line("param length: length = 2 mm;", "length + q"),
        "`length` is",
    );
    let twice = "param arm: length; param arm: angle;";
    once(&line(twice, "arm + q"), "`arm` is already declared");
    for (parameters, formula, message) in [
        ("param q: angle;", "q", meaning),
        ("param x[3]: length;", "x[0] + 1 N", meaning),
        ("param a: angle; param a: length;", "a", "already declared"),
    ] {
        let effect = format!("effect e on cart {{ {parameters} along += {formula}; }}");
        once(&robot(&effect), message);
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
    assert_eq!(errors(&mixed(";", "arm full;")), "no errors");
    for link in [
        "actuated length;",
        "actuated angle;",
        "actuated length { length = arm; }",
        "actuated length { length = arm + q; }",
        "actuated angle { length = 0.3 m; }",
        "actuated length { track_offset = (length, 0 m, 0 m); }",
    ] {
        once(&mixed(link, "arm full;"), "driven by its cart already");
    }
    let reduced = mixed("actuated length;", "arm reduced;").replace("{ length = arm; }", ";");
    let reduced = reduced.replace("param arm: length = 0.3 m;", "");
    once(&reduced, "driven by its cart already");
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
    once(text, "`two` is already declared");
}

/// The carrier of a cluster decides on the values of its links.
#[test]
fn values_on_an_unknown_carrier() {
    let text = robot("cluster more on tow { link m1 { track_direction = (1, 0, 0); } }");
    once(&text, "cannot find track `tow`");
}

/// Comments of other languages are told once, and their words are no declarations.
#[test]
fn comments_behind_a_hash() {
    let text = "# a delta: its track, don't read this;
robot R {
    plate point; # = a printer's
    # cluster old on base { link a, b, c; }
    cluster belts on # the base
        base {
        link a, b, # two of
            c actuated length; #!
    }
    /// A doc comment, # as it stands.
    variant Full { } # all
}
#";
    assert_snapshot!(errors(text), @r"
    # a delta: its track, don't read this;
    ^
    `#` begins no comment
    help: comments begin with `//`: `// …`
    ");
    // Other errors are told, too.
    let text = text.replace("plate point;", "plate pont;");
    let found = check_text(&text).unwrap_err();
    assert_eq!(found.diagnostics.len(), 2, "{found}");
    assert!(
        found.to_string().contains("did you mean `point`?"),
        "{found}"
    );
    // No text is read past a character that begins no token.
    for text in ["# 20 °C", "robot R { # \"A\n}", "/* a */ # see (1\n"] {
        once(text, "help: comments begin with `//`");
    }
    for text in ["/* # */ °", "// #\n °", "#[a] °"] {
        let found = errors(text);
        assert!(!found.contains("comments begin"), "{found}");
    }
}

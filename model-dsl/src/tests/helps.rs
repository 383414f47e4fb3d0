//! Helps name what was probably meant.

use super::{errors, robot, with_formula};

/// The mistake is said in the terms of what was probably meant.
#[test]
fn helps_name_the_mend() {
    let in_robot = |link: &str, rest: &str| {
        errors(&format!(
            "robot Slide {{
    track one, two, three;
    cluster arm1 on one {{ link l1, l2 {{ {link} }} }}
    cluster arm2 on two {{ link l3, l4; }}
    cluster arm3 on three {{ link l5, l6; }}
    variant Full {{ arm full; tracks linear; }}
    {rest}
}}"
        ))
    };
    for (link, rest, message, help) in [
        ("length = 41,2 mm;", "", "no decimal comma", "write a point"),
        ("ofset = (0, 0, 0) m;", "", "`ofset`", "`track_offset`"),
        (
            "",
            "variant Play = Full + backlash(one);",
            "`backlash`",
            "declare it with `effect backlash on … { … }`",
        ),
        (
            "",
            "reference { position = (0, 0, 0) m; position = (0, 0, 1) m; }",
            "given twice",
            "leave out one",
        ),
    ] {
        let found = in_robot(link, rest);
        assert!(found.contains(message) && found.contains(help), "{found}");
    }
}

/// A link of a hexapod with a value or what drives it, and what is said about it.
#[test]
fn links_in_words_of_other_tools() {
    for (link, message, help) in [
        (
            "actuated length { base_joint = (0, 0, 0) m; }",
            "expected `length`, `plate_joint`, `track_offset` or `pulled`, found `base_joint`",
            "did you mean `track_offset`?",
        ),
        (
            "actuated length { base_jiont = (0, 0, 0) m; }",
            "found `base_jiont`",
            "did you mean `track_offset`?",
        ),
        (
            "actuated length { plate_jiont = (0, 0, 0) m; }",
            "found `plate_jiont`",
            "did you mean `plate_joint`?",
        ),
        (
            "actuated anlge;",
            "expected `length` or `angle`, found `anlge`",
            "did you mean `angle`?",
        ),
        (
            "actuated force;",
            "expected `length` or `angle`, found `force`",
            "the length is what can be driven",
        ),
        (
            "actuatd length;",
            "expected `actuated`, `{` or `;`, found `actuatd`",
            "did you mean `actuated`?",
        ),
        (
            "actuatd lenght;",
            "found `actuatd`",
            "did you mean `actuated`?",
        ),
        (
            "driven length { length = 2 m + q; }",
            "expected `actuated`, `{` or `;`, found `driven`",
            "did you mean `actuated`?",
        ),
        (
            "motorised angle { length = 2 m + q; }",
            "found `motorised`",
            "did you mean `actuated`?",
        ),
    ] {
        let legs = format!("cluster legs on base {{ link a, b, c, d, e, f {link} }}");
        let found = errors(&format!(
            "robot Legs {{ {legs} variant Full {{ arm full; }} }}"
        ));
        assert!(found.contains(message) && found.contains(help), "{found}");
        assert_eq!(found.matches("help:").count(), 1, "{found}");
    }
    let drum = "effect e on link actuated anlge { param a: length; length += a; }";
    assert!(errors(&robot(drum)).contains("did you mean `angle`?"));
    let axis = robot("crank three { base_joint = (0, 0, 0) m; }");
    assert!(!errors(&axis).contains("track_offset"));
}

/// Signs that mean a component, a tolerance or hundredths elsewhere.
#[test]
fn signs_of_other_texts() {
    let link = |value: &str| robot(&format!("cluster more on one {{ link m1 {{ {value} }} }}"));
    let parameter = |of: &str| robot(&format!("param arm: {of};"));
    for (text, message, help) in [
        (
            with_formula("shift.x * bend * gap"),
            "expected an operator, found `.`",
            "write `shift[0]` for a component",
        ),
        (
            with_formula("gap * shift.z"),
            "found `.`",
            "write `shift[2]` for a component",
        ),
        (
            with_formula("l1.length"),
            "expected an operator, found `.`",
            "other names have no dots",
        ),
        (
            link("track_offset = (shift.y, 0 m, 0 m);"),
            "found `.`",
            "write `shift[1]`",
        ),
        (
            parameter("length = 120 mm +- 1 mm"),
            "expected `tol`, found `+`",
            "is written `tol 1 mm`",
        ),
        (
            parameter("length = 120 mm +/- 1 mm"),
            "expected `tol`, found `+`",
            "is written `tol 1 mm`",
        ),
        (
            link("length = 2 m +- 1 mm;"),
            "expected `tol`, found `+`",
            "is written `tol 1 mm`",
        ),
        (
            link("track_offset = (1, 2, 3) m +-1 mm;"),
            "expected `tol`, found `+`",
            "is written `tol 1 mm`",
        ),
        (
            link("length = 2 m ± 1 mm;"),
            "`±` has no meaning",
            "is written `tol 1 mm`",
        ),
        (
            parameter("length = 120 mm tol 10%"),
            "expected a unit, found `%`",
            "write `10 percent`; a tolerance has the unit of what it is of",
        ),
        (
            with_formula("gap * 0.5 %"),
            "expected a unit, found `%`",
            "write `0.5 percent`",
        ),
    ] {
        let found = errors(&text);
        assert!(found.contains(message) && found.contains(help), "{found}");
        assert_eq!(found.matches("help:").count(), 1, "{found}");
    }
    // A sign behind an operator is one of a formula.
    assert_eq!(errors(&with_formula("gap + -gap")), "no errors");
    let share = "effect e on cart { param a: ratio = 1 percent tol 10 percent; along += a * q; }";
    assert_eq!(errors(&robot(share)), "no errors");
}

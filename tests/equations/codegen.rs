//! Small things of the generator, pinned: programs, counts and expansions, one per construct.

use tau_codegen::emit::{self, Paths};
use tau_codegen::{CompiledVariant, compile, language};

/// A robot of one track and six links with the given lines, and its last variant, compiled.
fn compiled(lines: &str) -> (String, CompiledVariant) {
    let text = format!(
        "robot Slide {{\n    track one;\n    cluster arm on one {{ link l1, l2, l3, l4, l5, l6; }}\n{lines}\n}}\n"
    );
    let model = language::check_text(&text).unwrap_or_else(|errors| panic!("{errors:?}\n{text}"));
    let mut robot = compile(&model, &text);
    let variant = robot.variants.pop().expect("a variant");
    (text, variant)
}

/// Pins the programs of one family, with the description stored beside.
fn check(name: &str, family: &str, lines: &str) {
    let (text, variant) = compiled(lines);
    let family = variant
        .families
        .iter()
        .find(|candidate| candidate.name == family)
        .unwrap_or_else(|| panic!("no family `{family}`"));
    let programs = &family.programs;
    let shown = format!(
        "prepare\n{}\nvalue\n{}\nlinearize\n{}",
        programs.prepare, programs.value, programs.linearize
    );
    let mut settings = insta::Settings::clone_current();
    settings.set_description(text);
    settings.bind(|| insta::assert_snapshot!(name, shown));
}

#[test]
fn closure_of_a_reduced_arm_on_a_linear_track() {
    check(
        "reduced_linear",
        "closure",
        "    variant Nominal { arm reduced; tracks linear; }",
    );
}

#[test]
fn closure_of_a_full_arm_on_a_linear_track() {
    check(
        "full_linear",
        "closure",
        "    variant Full { arm full; tracks linear per link; }",
    );
}

#[test]
fn closure_on_a_piecewise_track() {
    check(
        "reduced_piecewise",
        "closure",
        "    variant P { arm reduced; tracks piecewise; }",
    );
}

#[test]
fn closure_by_pose() {
    check(
        "by_pose",
        "closure_by_pose",
        "    variant Full { arm full; tracks linear per link; }",
    );
}

#[test]
fn cart_position_of_a_linear_track() {
    check(
        "cart_position",
        "cart_position",
        "    variant N { arm reduced; tracks linear; }",
    );
}

#[test]
fn effect_along_the_track() {
    check(
        "effect_along",
        "closure",
        "    effect scale on cart { param gain: 1; along += gain * q; }
    variant N { arm reduced; tracks linear; }
    variant Scaled = N + scale(one);",
    );
}

#[test]
fn effect_with_a_select() {
    check(
        "effect_select",
        "closure",
        "    effect dead_zone on link { param gap: length; length += gap * sign(tension); }
    variant F { arm full; tracks linear; }
    variant Gapped = F + dead_zone(all);",
    );
}

#[test]
fn effect_on_the_measured_position() {
    check(
        "effect_position",
        "closure",
        "    effect drift on tcp { param rate[3]: m/s; position += rate * time; }
    variant N { arm reduced; tracks linear; }
    variant Drifting = N + drift(tcp);",
    );
}

#[test]
fn actuated_length_on_a_fixed_base() {
    let text = "robot Strut {\n    cluster legs on base { link l1, l2, l3, l4, l5, l6 actuated length; }\n    \
                variant Full { arm full; }\n}\n";
    let model = language::check_text(text).unwrap_or_else(|errors| panic!("{errors:?}"));
    let variant = &compile(&model, text).variants[0];
    let mut settings = insta::Settings::clone_current();
    settings.set_description(text);
    settings.bind(|| {
        insta::assert_snapshot!("actuated_length", variant.families[0].programs.linearize);
    });
}

#[test]
fn expansion_of_the_macro() {
    let text = "/// A slide with three rods.\npub robot Slide {\n    track one;\n    \
                cluster arm on one { link l1, l2, l3; }\n    variant Nominal { arm reduced; tracks linear; }\n}\n";
    let model = language::check_text(text).unwrap_or_else(|errors| panic!("{errors:?}"));
    let file = emit::file(
        &compile(&model, text),
        "slide.tau",
        "tau generate slide.tau",
    );
    let mut settings = insta::Settings::clone_current();
    settings.set_description(text);
    settings.bind(|| insta::assert_snapshot!("expansion", file));
}

/// Operations of every family of the standard robot: a change of the generator shows here first.
#[test]
fn operation_counts() {
    let text = tau_generated::gantry_tau::ROBOT.description;
    let model = language::check_text(text).unwrap();
    let robot = compile(&model, text);
    let mut table = String::from("once per sample / per residual / with the Jacobian\n");
    for variant in &robot.variants {
        for family in &variant.families {
            let counts = [
                family.programs.prepare.counts().total(),
                family.programs.value.counts().total(),
                family.programs.linearize.counts().total(),
            ];
            table += &format!(
                "{}.{}: {} / {} / {}\n",
                variant.name, family.name, counts[0], counts[1], counts[2]
            );
        }
    }
    insta::assert_snapshot!(table);
}

#[test]
fn expansion_does_not_depend_on_anything_but_the_text() {
    let text = tau_generated::gantry_tau::ROBOT.description;
    let tokens = || {
        let model = language::check_text(text).unwrap();
        emit::robot(&compile(&model, text), &Paths::facade()).to_string()
    };
    assert_eq!(tokens(), tokens());
}

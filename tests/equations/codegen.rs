//! Size of the generated code, and that it follows from the text alone. The code itself is pinned where it is generated,
//! by that of the standard robots.

use tau_codegen::emit::{self, Paths};
use tau_codegen::{CompiledRobot, compile, language};

fn compiled() -> CompiledRobot {
    let text = tau_generated::gantry_tau::ROBOT.description;
    compile(&language::check_text(text).unwrap(), text)
}

/// Operations of every family of the standard robot: a change of the generator shows here first.
#[test]
fn operation_counts() {
    let mut table = String::from("once per sample / per residual / with the Jacobian\n");
    for variant in &compiled().variants {
        for family in &variant.families {
            let programs = &family.programs;
            let [prepare, value, linearize] =
                [&programs.prepare, &programs.value, &programs.linearize]
                    .map(|program| program.counts().total());
            let name = format!("{}.{}", variant.name, family.name);
            table += &format!("{name}: {prepare} / {value} / {linearize}\n");
        }
    }
    insta::assert_snapshot!(table);
}

#[test]
fn expansion_does_not_depend_on_anything_but_the_text() {
    let tokens = || emit::robot(&compiled(), &Paths::facade()).to_string();
    assert_eq!(tokens(), tokens());
}

//! Sections of the report on a study, from the errors to the last parameter.

use maud::{Markup, PreEscaped, html};
use tau::study::results::{Study, VariantResult};

use super::discovery::section;
use super::elements::{Section, figure, number_markup, table};
use super::figures::Figure;
use super::findings;
use super::measured::{by_kind, kinds};
use super::number::general;
use super::parts;
use super::tables;
use super::trust::tables as verdict_tables;

/// Correlations listed for each variant.
const CORRELATIONS: usize = 10;

/// The evidence, and the appendices.
pub(super) fn of_study(study: &Study, figures: &[Figure]) -> (Vec<Section>, Vec<Section>) {
    let mut evidence = vec![Section::new(
        "errors",
        match &study.setting.rows {
            _ if !study.setting.is_held_out() => "Errors of the fit",
            Some(_) => "Errors of what was held out",
            None => "Errors at the validation poses",
        },
        errors(study, figures),
    )];
    evidence.extend(study.fit().map(|(variant, _)| {
        Section::new(
            "residuals",
            "Residuals against the noise",
            residuals(variant),
        )
    }));
    evidence.push(lacking(study, figures));
    let mut appendices = vec![Section::new(
        "method",
        "How the figures were obtained",
        method(study),
    )];
    if study.setting.rows.is_none() && (turns(study) || study.setting.architecture.carts > 0) {
        appendices.push(Section::new(
            "assumptions",
            "What the models assume",
            assumptions(study, figures),
        ));
    }
    appendices.push(Section::new(
        "geometry",
        "Calibrated geometry",
        geometry(study),
    ));
    if study.sensitivity.is_some() {
        appendices.push(Section::new(
            "sensitivity",
            "Sensitivity",
            sensitivity(study, figures),
        ));
    }
    appendices.extend([
        Section::new("determined", "What the data determine", determined(study)),
        Section::new("parameters", "All parameters", parameters(study)),
    ]);
    (evidence, appendices)
}

fn errors(study: &Study, figures: &[Figure]) -> Markup {
    html! {
        p { (findings::measured(&study.setting)) }
        @if study.variants.is_empty() {
            p { "No variant was calibrated." }
        } @else if study.setting.rows.is_some() {
            p {
                "Each calibrated model, its parameters held, is compared with the measurements that " (findings::compared_rows(&study.setting)) "; poses follow \
                 the drives and these measurements, and so do places of targets, surfaces and balls as far as the robot file \
                 leaves them open. What is expected follows from the noise and from the covariance of the parameters. What \
                 poses and places follow whatever the machine is can't be judged, and is left out."
            }
            @if let Some(comparison) = findings::comparison(study) { p { (comparison) } }
            (table(&tables::errors(study), "wide"))
        } @else {
            p {
                "Each calibrated model predicts the pose of the plate from the commands; the error is predicted minus measured. Position errors are lengths of the three-dimensional difference."
                @if turns(study) && findings::has_reduced(study) { " A reduced arm predicts no orientation." }
            }
            @if let Some(comparison) = findings::comparison(study) { p { (comparison) } }
            (table(&tables::errors(study), "wide"))
            (figure(figures, "position_error_by_variant.svg"))
            (figure(figures, "position_error_by_pose.svg"))
            (figure(figures, "orientation_errors.svg"))
        }
        @if !study.remarks.is_empty() {
            aside.remarks {
                h3 { "Remarks" }
                ul { @for remark in &study.remarks { li { (remark.to_string()) } } }
            }
        }
    }
}

/// The numbers behind the verdict.
fn residuals(variant: &VariantResult) -> Markup {
    let Some(fit) = &variant.fit else {
        return html! {};
    };
    html! {
        p {
            "The fit of " (variant.name) " behind the verdict: χ² is the sum of the squared residuals in units of the stated \
             noise, " (general(fit.chi2, 4)) " where " (general(fit.dof, 4)) " is expected, so that residuals are "
            (general(fit.residual_over_noise, 3)) " times what the noise explains."
            @if fit.widening() > 1.0 {
                " Standard deviations in this report are those of the stated noise; if the misfit is noise, they are up to "
                (general(fit.widening(), 3)) " times as large."
            }
        }
        @if !fit.by_file.is_empty() { (table(&by_kind(&kinds(&fit.by_file)), "")) }
        div.columns {
            @if let Some(worst) = verdict_tables::worst(fit) { (table(&worst, "compact")) }
            @if let Some(pulls) = verdict_tables::pulls(fit) { (table(&pulls, "compact")) }
        }
    }
}

fn lacking(study: &Study, figures: &[Figure]) -> Section {
    let parts = study.discovery.as_ref().map_or_else(Vec::new, |found| {
        section::evidence(found, &study.setting, figures)
    });
    let id = |part: &section::Part| format!("discovery-{}", part.id);
    let body = html! {
        @if let Some(found) = &study.discovery {
            (section::sentences(found))
            @for part in &parts {
                @if part.is_appendix {
                    details {
                        summary { h3.part { (part.title) } }
                        div.folded id=(id(part)) { (part.body) }
                    }
                } @else {
                    h3.part id=(id(part)) { (part.title) }
                    (part.body)
                }
            }
        } @else {
            p {
                "Nothing is known of what the models lack: either it was not searched for, because of " code { "--no-discover" }
                ", or the search failed, and a remark says why."
            }
        }
    };
    Section {
        parts: parts.iter().map(|part| (id(part), part.title)).collect(),
        ..Section::new("discovery", "What the model lacks", body)
    }
}

/// From measurements that tell less than a pose to parameters.
fn method_of_measurements(study: &Study) -> Markup {
    html! {
        p {
            "The pose of the plate behind every reading is unknown. The closure of each link, with the noise of its drive, and each \
             measured quantity are residuals of that pose and of the parameters; poses are eliminated one by one, and the \
             parameters minimise the sum of the squared residuals over their noise plus the sum of "
            span.formula { "((value − nominal) / tolerance)" sup { "2" } }
            ". Where drives are exact, closures hold to a hundredth of the smallest noise of a length. Nominal values and tolerances \
             (one standard deviation) are those of the robot file."
        }
        p { (findings::measured(&study.setting)) }
        @if !study.variants.is_empty() { (table(&tables::solver(study), "")) }
    }
}

/// True if the plate has an orientation.
fn turns(study: &Study) -> bool {
    !study.setting.architecture.plate.turning_axes().is_empty()
}

fn method(study: &Study) -> Markup {
    if study.setting.rows.is_some() {
        return method_of_measurements(study);
    }
    let of = study.setting.architecture;
    let is_carried = of.carts + of.cranks > 0;
    let has_driven = of.driven_lengths > 0;
    let is_point = of.plate.is_point();
    let carrier = parts::carrier(of);
    html! {
        p {
            @if is_carried {
                "Every link has a fixed length between a joint on its " (carrier) " and "
            } @else {
                "Every link reaches from a joint on the fixed base to "
            }
            @if is_point {
                "the TCP. With it at position " var { "T" } " and "
            } @else {
                "a joint on the plate. With the plate at position " var { "T" } " and rotation " var { "R" }
                @if of.plate.is_in_plane() { " (the angle " var { "α" } " about z)" } @else { " (ZYZ Euler angles " (ANGLES) ")" }
                ", the plate joint " var { "P" } " in TCP coordinates and "
            }
            @if is_carried { "the " (carrier) " joint " var { "C" } "(" var { "q" } ") at the command " var { "q" } }
            @else { "the base joint " var { "C" } }
            ", its residual is"
        }
        p.equation {
            @if has_driven {
                var { "r" } " = (" var { "L" } " + " var { "q" } ")" sup { "2" }
            } @else {
                var { "r" } " = " var { "L" } sup { "2" }
            }
            " − ‖" var { "T" } @if !is_point { " + " var { "R P" } } " − " var { "C" } @if is_carried { "(" var { "q" } ")" } "‖" sup { "2" }
        }
        p {
            @if has_driven {
                "The command " var { "q" } " of a driven link is what its length exceeds " var { "L" } " by"
                @if is_carried { "; it is left out of the others. " } @else { ". " }
            }
            @if findings::has_reduced(study) {
                "A reduced arm replaces the links of a cluster by one and carries the plate joint in the joint on the other \
                 side: "
                span.formula {
                    var { "r" } " = " var { "L" } sup { "2" } " − ‖" var { "T" } " − " var { "C" } @if is_carried { "(" var { "q" } ")" } "‖" sup { "2" }
                }
                ". "
            }
            @if of.cranks > 0 {
                "A crank turns the joint by the angle " var { "q" } " about its axis, from " var { "C" } sup { "0" } " at "
                var { "q" } " = 0. "
            }
            @if of.carts > 0 {
                "A linear track moves the joint by "
                span.formula { var { "C" } "(" var { "q" } ") = " var { "C" } sup { "0" } " + " var { "q v" } }
                " with a free direction " var { "v" } ", whose length holds the scale of the actuator."
                @if findings::has_piecewise(study) {
                    " A piecewise track interpolates between the cart poses of set 2, carried into the frame of set 1 by a rigid \
                     transform that is calibrated."
                }
            }
        }
        p {
            "Each link" @if findings::has_reduced(study) { " (each cluster, where the arm is reduced)" }
            " is calibrated by minimising the sum, over the calibration \
             poses, of " span.formula { "(" var { "r" } " / σ" sub { var { "r" } } ")" sup { "2" } } ", plus the sum, over the parameters, of "
            span.formula { "((value − nominal) / tolerance)" sup { "2" } }
            ". The weights follow from the stated noise of position" @if turns(study) { " and rotation" }
            ", carried into each residual at the nominal values: "
            span.formula {
                "σ" sub { var { "r" } } sup { "2" } " = σ" sub { var { "T" } } sup { "2" } " ‖∂" var { "r" } "/∂" var { "T" } "‖" sup { "2" }
                @if turns(study) {
                    " + σ" sub { var { "R" } } sup { "2" } " ‖∂" var { "r" } "/∂" var { "ω" } "‖" sup { "2" }
                }
            }
            ". Nominal values and tolerances (one standard deviation) are those of the robot file."
        }
        p {
            @if study.setting.is_held_out() {
                "Of the poses in range, in the order of the file, the split decides which calibrate and which validate: here "
                (study.setting.poses.calibration) " and " (study.setting.poses.validation)
            } @else {
                "All poses in range calibrate, and none are held out"
            }
            ". Standard deviations and correlations come from the inverse of the normal matrix of \
             data and priors at the optimum."
        }
        @if !study.variants.is_empty() { (table(&tables::solver(study), "")) }
    }
}

const ANGLES: PreEscaped<&str> = PreEscaped("<var>α</var>, <var>β</var>, <var>γ</var>");

fn assumptions(study: &Study, figures: &[Figure]) -> Markup {
    let has_carts = study.setting.architecture.carts > 0;
    html! {
        @for sentence in findings::assumptions(study) { p { (sentence) } }
        @for found in tables::assumptions(study) { (table(&found, "")) }
        @if turns(study) && study.assumptions.orientation.is_empty() {
            p { "No orientation was measured." }
        }
        (figure(figures, "orientation_grid.svg"))
        @if has_carts && study.assumptions.linearity.is_empty() {
            p { "Without cart poses (set 2) the linearity of the tracks cannot be checked." }
        }
        (figure(figures, "linearity_parallel.svg"))
        (figure(figures, "linearity_orthogonal.svg"))
        @if has_carts && study.assumptions.sets.is_empty() {
            p { "Without cart positions at random poses (set 3) and cart poses (set 2) the two cannot be compared." }
        }
        (figure(figures, "set_comparison.svg"))
    }
}

fn geometry(study: &Study) -> Markup {
    html! {
        p {
            "Lengths and coordinates in the measurement frame" @if study.setting.rows.is_none() { " of set 1" } " at " var { "q" }
            " = 0" @if !study.setting.architecture.plate.is_point() { "; the plate joint in TCP coordinates" } "."
            @if study.setting.rows.is_none() {
                " The cost is the sum of squared residuals " var { "r" } " over the calibration poses, without weights or priors."
            }
        }
        @for variant in &study.variants {
            (table(&tables::geometry(variant, study.setting.architecture), "wide compact"))
            @if let Some(machine) = tables::machine(variant) {
                (table(&machine, "compact"))
            }
            p { (findings::brackets(variant)) }
        }
    }
}

fn sensitivity(study: &Study, figures: &[Figure]) -> Markup {
    let Some(found) = &study.sensitivity else {
        return html! { p { "No variant with all links was calibrated, so there is no sensitivity to show." } };
    };
    let Some(letters) = parts::letters(found, study.setting.architecture) else {
        return html! { p { (findings::no_sensitivity(found)) } };
    };
    html! {
        p {
            "Each parameter of each link of " (found.variant) " is changed by ±" (number_markup(&general(found.step, 1)))
            " in its SI unit, and the pose predicted anew at " (found.poses) " poses. The tables hold sums over the poses \
             and both signs. Implicit differentiation of the residuals gives the same within "
            (number_markup(&general(100.0 * found.disagreement, 2))) " %. " (letters)
        }
        @if let Some(remark) = findings::turn(found, study.setting.architecture) { p { (remark) } }
        @for quantity in tables::sensitivity(found, study.setting.architecture) { (table(&quantity, "wide compact even")) }
        (figure(figures, "sensitivity_position.svg"))
        (figure(figures, "sensitivity_orientation.svg"))
    }
}

fn determined(study: &Study) -> Markup {
    let undetermined: Vec<_> = study
        .variants
        .iter()
        .filter_map(tables::undetermined)
        .collect();
    let correlations: Vec<_> = study
        .variants
        .iter()
        .filter_map(|variant| tables::correlations(variant, CORRELATIONS))
        .collect();
    html! {
        ul { @for variant in &study.variants { li { (findings::undetermined(variant)) } } }
        @if !undetermined.is_empty() {
            h3 { "Combinations of which the tolerances say more than the data" }
            p {
                "Shares are in units of the tolerances; the ratio compares the standard deviation from the data alone with that \
                 of the prior. Single values of these parameters must not be read as measured: the pose depends on them only \
                 through other combinations."
            }
            @for found in &undetermined { (table(found, "wide compact long")) }
        }
        @if !correlations.is_empty() {
            h3 { "Largest correlations" }
            div.columns { @for found in &correlations { (table(found, "compact")) } }
        }
    }
}

fn parameters(study: &Study) -> Markup {
    let shown = |variant: &&VariantResult| !variant.parameters.is_empty();
    html! {
        p {
            "Values to the second digit of their standard deviation. A σ of one tolerance means that the data add nothing to \
             the prior; a change of more than three tolerances that nominal value and measurement disagree."
            @if findings::has_piecewise(study) {
                " Rotations of piecewise tracks are given against the registered path, nominally zero."
            }
        }
        @for variant in study.variants.iter().filter(shown) {
            (table(&tables::parameters(&variant.name, &variant.parameters, 1.0), "wide compact long"))
        }
    }
}

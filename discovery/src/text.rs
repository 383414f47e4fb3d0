//! The description with what was found: adding an effect is one line of the model.

use std::ops::Range;

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use tau_codegen::language::model::{Arm, TrackShape, Variant};
use tau_codegen::language::{Errors, Model, check_text, tokens};
use tau_robot::input_error::InputError;
use tau_robot::robot::Robot;

use super::Error;
use super::results::Derived;

/// Name of the variant that discovery writes.
pub const DISCOVERED: &str = "Discovered";

/// The complete description, and what it means: the robot's with a variant, and those effects that it lacks from the
/// catalogues, in order of precedence.
pub(super) fn description(
    robot: &Robot,
    catalogues: &[String],
    variant: &Derived,
) -> Result<(String, Model), Error> {
    let wrong = |errors: Errors| {
        InputError::whole(
            tau_codes::discovery::NOT_SOUND,
            &robot.name,
            errors.to_string(),
        )
    };
    let mut text = String::new();
    let mut known: Vec<Vec<&str>> = Vec::new();
    for effect in &variant.effects {
        let name = effect.name.as_str();
        // Of effects of one name each is copied that is used: they act on places of different kinds.
        let words = ["effect", name, "on"].into_iter();
        let words: Vec<&str> = words.chain(effect.on.written().split(' ')).collect();
        if known.contains(&words) || robot.model.effect(name, effect.on).is_some() {
            continue;
        }
        for catalogue in catalogues {
            let items = tokens(catalogue).map_err(wrong)?;
            if let Some((range, _)) = item(items, &words) {
                text.push_str(&catalogue[range]);
                text.push_str("\n\n");
                break;
            }
        }
        known.push(words);
    }
    text.push_str(&with_lines(
        robot,
        "Found by discovery.",
        &variant.to_string(),
    )?);
    let model = check_text(&text).map_err(wrong)?;
    Ok((text, model))
}

/// The description with further lines at the end of the robot, which may use what it lacks.
pub(super) fn with_lines(robot: &Robot, docs: &str, lines: &str) -> Result<String, Error> {
    let own = &robot.description;
    let items = tokens(own).map_err(|e| {
        InputError::whole(tau_codes::discovery::NOT_SOUND, &robot.name, e.to_string())
    })?;
    let (_, end) = item(items, &["robot", &robot.name]).ok_or_else(|| {
        InputError::whole(
            tau_codes::discovery::NOT_SOUND,
            &robot.name,
            "the description has no `robot { … }`",
        )
    })?;
    let (before, after) = own.split_at(end);
    let mut text = format!(
        "{}\n    /// {docs}\n    {lines}\n{after}",
        before.trim_end()
    );
    if !text.ends_with('\n') {
        text.push('\n');
    }
    Ok(text)
}

/// A variant without effects.
pub(super) fn structure(model: &Model, variant: &Variant) -> String {
    let arm = match variant.arm {
        Arm::Full => "full",
        Arm::Reduced => "reduced",
    };
    let tracks = model
        .tracks
        .iter()
        .zip(&variant.tracks)
        .filter_map(|(track, own)| {
            let shape = match own.shape {
                TrackShape::Linear => "linear",
                TrackShape::Piecewise => "piecewise",
                TrackShape::Crank => return None,
            };
            let per_link = if own.per_link { " per link" } else { "" };
            Some(format!("track {} {shape}{per_link};", track.name))
        });
    let held = variant.holds.iter().map(|held| held.written(model));
    let held: Vec<String> = held.collect();
    let hold = (!held.is_empty()).then(|| format!("hold {};", held.join(", ")));
    let tracks: Vec<String> = tracks.chain(hold).collect();
    format!(
        "variant {} {{ arm {arm}; {} }}",
        variant.name,
        tracks.join(" ")
    )
}

/// Place of an item in a text by the words before its brace, its documentation included, and of its closing brace; of
/// items in others, too.
fn item(tokens: TokenStream, words: &[&str]) -> Option<(Range<usize>, usize)> {
    let mut begun: Vec<TokenTree> = Vec::new();
    for token in tokens {
        match &token {
            TokenTree::Group(body) if body.delimiter() == Delimiter::Brace => {
                let mut last = begun.iter().rev().map(TokenTree::to_string);
                let is_meant = words
                    .iter()
                    .rev()
                    .all(|word| last.next().as_deref() == Some(word));
                let found = is_meant.then(|| {
                    let start = begun[0].span().byte_range().start;
                    let close = body.span_close().byte_range();
                    (start..close.end, close.start)
                });
                if let Some(found) = found.or_else(|| item(body.stream(), words)) {
                    return Some(found);
                }
                begun.clear();
            }
            TokenTree::Punct(punct) if punct.as_char() == ';' => begun.clear(),
            _ => begun.push(token),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use tau_codegen::language::model::Subject;

    use super::super::results::{Place, UsedEffect};
    use super::*;

    const OWN: &str = "// robot Old { }\n/// A slide.\npub robot Slide {\n    track one; // }\n    \
        cluster a on one { link l, m, n; }\n    variant N { arm reduced; tracks linear; }\n}\n// end }\n";

    #[test]
    fn the_line_and_the_effects_stand_where_they_belong() {
        let robot = Robot::from_text(OWN).unwrap();
        let used = |name: &str| UsedEffect {
            name: name.to_owned(),
            on: Subject::Cart,
            place: Place::Cart("one".to_owned()),
            with: vec![],
            tolerance_factor: 10.0,
        };
        let variant = Derived {
            base: "N".to_owned(),
            effects: ["backlash", "rack_pitch"].map(used).into(),
        };
        let catalogues = [tau_robot::effects::CATALOGUE.to_owned()];
        let (text, _) = description(&robot, &catalogues, &variant).unwrap();
        let again = Robot::from_text(&text).unwrap();
        let found = again.variant(DISCOVERED).unwrap();
        let names: Vec<&str> = found
            .effects
            .iter()
            .map(|(name, _)| name.as_str())
            .collect();
        assert_eq!(names, ["backlash", "rack_pitch"]);
        assert!(text.contains("/// Reversal error"), "{text}");
        assert!(!text.contains("effect straightness"));
    }

    /// Effects of one name may have several forms: those that are used are copied.
    #[test]
    fn the_forms_that_are_used_are_copied() {
        let own = "robot Legs {
            track one;
            crank two;
            cluster arm on one { link a; }
            cluster bar on two { link b; }
            cluster legs on base { link c, d, e, f actuated length; }
            variant N { arm full; tracks linear; }
        }";
        let robot = Robot::from_text(own).unwrap();
        let used = |on: Subject, place: Place| UsedEffect {
            name: "backlash".to_owned(),
            on,
            place,
            with: vec![],
            tolerance_factor: 10.0,
        };
        let link = |name: &str| used(Subject::LinkByLength, Place::Link(name.to_owned()));
        let crank = used(Subject::Crank, Place::Crank("two".to_owned()));
        let variant = Derived {
            base: "N".to_owned(),
            effects: vec![link("c"), crank, link("d")],
        };
        let catalogues = [tau_robot::effects::CATALOGUE.to_owned()];
        let (text, model) = description(&robot, &catalogues, &variant).unwrap();
        let subjects = model.effects.iter().map(|own| own.subject);
        assert!(
            subjects.eq([Subject::LinkByLength, Subject::Crank]),
            "{text}"
        );
        // A robot that has a form of its own keeps it.
        let kept =
            format!("effect backlash on crank {{ param own: angle; command += own; }}\n{own}");
        let robot = Robot::from_text(&kept).unwrap();
        let (text, model) = description(&robot, &catalogues, &variant).unwrap();
        let of_crank = model.effect("backlash", Subject::Crank).unwrap();
        assert_eq!(model.effects[of_crank].parameters[0].name, "own", "{text}");
    }
}

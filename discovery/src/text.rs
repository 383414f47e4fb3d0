//! The description with what was found: adding an effect is one line of the model.

use std::ops::Range;

use tau_codegen::language::check_text;
use tau_robot::input_error::InputError;
use tau_robot::robot::Robot;

use super::Error;

/// Name of the variant that discovery writes.
pub const DISCOVERED: &str = "Discovered";

/// The line that derives the discovered variant, such as `variant Discovered = Full + backlash(one);`.
pub(super) fn line(base: &str, effects: &[String]) -> String {
    let terms: Vec<&str> = std::iter::once(base)
        .chain(effects.iter().map(String::as_str))
        .collect();
    format!("variant {DISCOVERED} = {};", terms.join(" + "))
}

/// The complete description: the robot's, with the line, and those effects that it lacks from the
/// catalogues, in order of precedence.
pub(super) fn description(
    robot: &Robot,
    catalogues: &[&str],
    effects: &[&str],
    line: &str,
) -> Result<String, Error> {
    let own = &robot.description;
    let mut text = String::new();
    let mut added: Vec<&str> = Vec::new();
    for &effect in effects {
        if added.contains(&effect) || item(own, effect).is_some() {
            continue;
        }
        if let Some(found) = catalogues
            .iter()
            .find_map(|text| Some(&text[item(text, effect)?]))
        {
            text.push_str(found);
            text.push_str("\n\n");
            added.push(effect);
        }
    }
    text.push_str(&with_lines(robot, "Found by discovery.", line)?);
    check_text(&text).map_err(|errors| InputError::whole(&robot.name, errors.to_string()))?;
    Ok(text)
}

/// The description with further lines at the end of the robot, which may use what it lacks.
pub(super) fn with_lines(robot: &Robot, docs: &str, lines: &str) -> Result<String, Error> {
    let own = &robot.description;
    let end = robot_end(own)
        .ok_or_else(|| InputError::whole(&robot.name, "the description has no `robot { … }`"))?;
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

/// Words and braces of a text with their places, comments and strings skipped.
fn tokens(text: &str) -> Vec<(&str, usize)> {
    let bytes = text.as_bytes();
    let mut tokens = Vec::new();
    let mut at = 0;
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 0x80;
    while at < bytes.len() {
        let rest = &text[at..];
        if rest.starts_with("//") {
            at += rest.find('\n').unwrap_or(rest.len());
        } else if rest.starts_with("/*") {
            at += rest.find("*/").map_or(rest.len(), |end| end + 2);
        } else if let Some(quoted) = rest.strip_prefix('"') {
            at += quoted.find('"').map_or(rest.len(), |end| end + 2);
        } else if is_word(bytes[at]) {
            let length = bytes[at..]
                .iter()
                .take_while(|&&byte| is_word(byte))
                .count();
            tokens.push((&rest[..length], at));
            at += length;
        } else {
            if matches!(bytes[at], b'{' | b'}') {
                tokens.push((&rest[..1], at));
            }
            at += 1;
        }
    }
    tokens
}

/// Place of the brace that closes what opens first from a token on.
fn closing(tokens: &[(&str, usize)]) -> Option<usize> {
    let mut depth = 0_usize;
    for &(token, at) in tokens {
        match token {
            "{" => depth += 1,
            "}" => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return Some(at);
                }
            }
            _ => {}
        }
    }
    None
}

fn robot_end(text: &str) -> Option<usize> {
    let tokens = tokens(text);
    let mut depth = 0_usize;
    let start = tokens.iter().position(|&(token, _)| {
        match token {
            "{" => depth += 1,
            "}" => depth = depth.saturating_sub(1),
            _ => {}
        }
        depth == 0 && token == "robot"
    })?;
    closing(&tokens[start..])
}

/// Place of `effect name … { … }` with the doc comments before it.
fn item(text: &str, name: &str) -> Option<Range<usize>> {
    let tokens = tokens(text);
    let start = tokens
        .windows(2)
        .position(|pair| pair[0].0 == "effect" && pair[1].0 == name)?;
    let end = closing(&tokens[start..])? + 1;
    let mut begin = tokens[start].1;
    while let Some(line_end) = text[..begin]
        .trim_end_matches([' ', '\t'])
        .strip_suffix('\n')
    {
        let line_start = line_end.rfind('\n').map_or(0, |at| at + 1);
        if !line_end[line_start..].trim_start().starts_with("///") {
            break;
        }
        begin = line_start;
    }
    Some(begin..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: &str = "// robot Old { }\n/// A slide.\npub robot Slide {\n    track one; // }\n    \
        cluster a on one { link l; }\n    variant N { arm reduced; tracks linear; }\n}\n// end }\n";

    #[test]
    fn the_line_and_the_effects_stand_where_they_belong() {
        let robot = Robot::from_text(OWN).unwrap();
        let line = line("N", &["backlash(one)".into(), "rack_pitch(one)".into()]);
        let text = description(
            &robot,
            &[tau_robot::effects::CATALOGUE],
            &["backlash", "rack_pitch"],
            &line,
        )
        .unwrap();
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
}

//! Parameters in the block that the firmware saves.

use std::fmt::Write;

use super::TOWERS;
use super::config::{Config, HEADER, SAVED};
use super::printer::Parameters;

/// First lines of the block.
const FIRST_LINES: [&str; 3] = [
    "#*# <---------------------- SAVE_CONFIG ---------------------->",
    "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.",
    "#*#",
];

/// The options of the parameters, by section.
fn options(parameters: &Parameters) -> Vec<(String, Vec<(&'static str, String)>)> {
    let number = |value: f64| format!("{value:.6}");
    let mut sections = vec![(
        "printer".to_owned(),
        vec![("delta_radius", number(parameters.radius_mm))],
    )];
    for (letter, tower) in TOWERS.iter().zip(&parameters.towers) {
        let own = vec![
            ("angle", number(tower.angle_deg)),
            ("arm_length", number(tower.arm_mm)),
            ("position_endstop", number(tower.endstop_mm)),
        ];
        sections.push((format!("stepper_{letter}"), own));
    }
    sections
}

/// The block with the parameters alone, to be put at the end of `printer.cfg`.
pub fn saved_block(parameters: &Parameters) -> String {
    let mut text = String::new();
    for line in FIRST_LINES {
        let _ = writeln!(text, "{line}");
    }
    for (section, own) in options(parameters) {
        let _ = writeln!(text, "{SAVED} [{section}]");
        for (key, value) in own {
            let _ = writeln!(text, "{SAVED} {key} = {value}");
        }
        let _ = writeln!(text, "{SAVED}");
    }
    text
}

/// The text of `printer.cfg` with the parameters in its saved block; options by hand, which would win, become comments,
/// as the firmware does it. All else stays as it is.
pub fn saved_into(parameters: &Parameters, text: &str) -> String {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let config = Config::parse(&[("printer.cfg", text)]);
    let sections = options(parameters);
    let is_ours = |section: &str, key: &str| {
        let of_section = sections.iter().filter(|(name, _)| name == section);
        of_section
            .flat_map(|(_, own)| own)
            .any(|(name, _)| *name == key)
    };
    let entries = config.entries().iter();
    let ours: Vec<_> = entries
        .filter(|own| is_ours(&own.section, &own.key))
        .collect();
    let mut by_hand = String::new();
    let mut saved: Vec<(String, Vec<String>)> = vec![];
    let mut at = 0;
    let mut is_saved = false;
    for line in text.split_inclusive('\n') {
        let start = at;
        at += line.len();
        let own = line.trim_end_matches(['\r', '\n']);
        is_saved |= own.starts_with(SAVED) && own.contains(HEADER);
        let replaced = ours.iter().any(|entry| entry.line == start);
        if !is_saved {
            if replaced {
                by_hand.push('#');
            }
            by_hand.push_str(line);
            continue;
        }
        let own = own.strip_prefix(SAVED).unwrap_or(own);
        let own = own.strip_prefix(' ').unwrap_or(own);
        if let Some(name) = own
            .trim()
            .strip_prefix('[')
            .and_then(|t| t.strip_suffix(']'))
        {
            saved.push((name.trim().to_owned(), vec![]));
        } else if let Some((_, lines)) = saved.last_mut()
            && !replaced
            && !own.trim().is_empty()
        {
            lines.push(own.to_owned());
        }
    }
    for (section, own) in sections {
        let lines = own
            .into_iter()
            .map(|(key, value)| format!("{key} = {value}"));
        match saved.iter_mut().find(|(name, _)| *name == section) {
            Some((_, known)) => known.extend(lines),
            None => saved.push((section, lines.collect())),
        }
    }
    let mut text = by_hand.trim_end().to_owned();
    text.push_str("\n\n");
    for line in FIRST_LINES {
        let _ = writeln!(text, "{line}");
    }
    for (section, lines) in saved {
        let _ = writeln!(text, "{SAVED} [{section}]");
        for line in lines {
            let _ = writeln!(text, "{SAVED} {line}");
        }
        let _ = writeln!(text, "{SAVED}");
    }
    text
}

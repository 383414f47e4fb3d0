//! Parameters in the block that the firmware saves.

use std::fmt::Write;

use super::TOWERS;
use super::config::{Config, Entry};
use super::printer::Parameters;
use super::syntax::{Block, FIRST_LINES, Item, SAVED};
use crate::input_error::{Errors, InputError};
use tau_codes::files;

/// A section: its name, and its lines without their marks.
type Section = (String, Vec<String>);

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

/// The same as lines.
fn sections(parameters: &Parameters) -> impl Iterator<Item = Section> {
    options(parameters).into_iter().map(|(section, own)| {
        let lines = own
            .into_iter()
            .map(|(key, value)| format!("{key} = {value}"));
        (section, lines.collect())
    })
}

/// The block with the parameters alone, to be put at the end of `printer.cfg`.
pub fn saved_block(parameters: &Parameters) -> String {
    block_of(sections(parameters))
}

/// A block of sections.
fn block_of(sections: impl IntoIterator<Item = Section>) -> String {
    let mut text = String::new();
    for line in FIRST_LINES {
        let _ = writeln!(text, "{line}");
    }
    for (section, lines) in sections {
        let _ = writeln!(text, "{SAVED} [{section}]");
        for line in lines {
            let line = format!("{SAVED} {line}");
            let _ = writeln!(text, "{}", line.trim_end());
        }
        let _ = writeln!(text, "{SAVED}");
    }
    text
}

/// The text of a configuration with the parameters in its saved block; options by hand, which would win, become comments,
/// as the firmware does it. All else stays as it is.
///
/// # Errors
/// It is not of a delta printer; a file that it includes states one of these options, which would win.
pub fn saved_into(parameters: &Parameters, config: &Config) -> Result<String, InputError> {
    config.check_delta()?;
    let options = options(parameters);
    let is_ours = |entry: &&Entry| {
        let mut own = options
            .iter()
            .filter(|(name, _)| *name == entry.setting.section);
        own.any(|(_, own)| own.iter().any(|(key, _)| *key == entry.setting.key))
    };
    let ours: Vec<&Entry> = config.entries().iter().filter(is_ours).collect();
    check_included(config, &ours)?;
    let lines = |is_saved: bool| {
        let own = ours.iter().filter(move |entry| entry.is_saved == is_saved);
        own.flat_map(|entry| entry.setting.lines.iter().copied())
    };
    let block = config.block().cloned().unwrap_or_default();
    let saved = without(config.text(), &block, &lines(true).collect::<Vec<_>>());
    let by_hand = match config.block() {
        Some(block) => &config.text()[..block.start],
        None => config.text(),
    };
    let mut text = commented(by_hand, lines(false)).trim_end().to_owned();
    text.push_str("\n\n");
    text.push_str(&block_of(with(saved, parameters)));
    Ok(text)
}

/// No file that is included states one of the options: by hand there, it would win over the block.
fn check_included(config: &Config, ours: &[&Entry]) -> Result<(), InputError> {
    let mut errors = Errors::default();
    for entry in ours.iter().filter(|entry| entry.file != 0) {
        let message = format!(
            "found `{}` of `[{}]` in a file that is included, where it would win over the calibrated value",
            entry.setting.key, entry.setting.section
        );
        let help = "remove it there, or make it a comment";
        errors.add(
            config
                .wrong(files::FIRMWARE_OPTION_VALUE, entry, message)
                .help(help),
        );
    }
    errors.finish()
}

/// A text with lines as comments, given by their first bytes in order.
fn commented(text: &str, lines: impl Iterator<Item = usize>) -> String {
    let mut lines: Vec<usize> = lines.collect();
    lines.sort_unstable();
    let mut changed = String::with_capacity(text.len() + lines.len());
    let mut at = 0;
    for line in lines {
        changed.push_str(&text[at..line]);
        changed.push('#');
        at = line;
    }
    changed + &text[at..]
}

/// The sections of a block without some of its lines, given by their first bytes.
fn without(text: &str, block: &Block, lines: &[usize]) -> Vec<Section> {
    let header = |line: usize| {
        block.items.iter().find_map(|item| match item {
            Item::Section { name, line: own } if *own == line => Some(name.clone()),
            _ => None,
        })
    };
    let mut sections: Vec<Section> = vec![];
    for (line, own) in &block.lines {
        if let Some(name) = header(line.start) {
            sections.push((name, vec![]));
        } else if let Some((_, of_section)) = sections.last_mut()
            && !lines.contains(&line.start)
        {
            of_section.push(text[own.clone()].to_owned());
        }
    }
    for (_, of_section) in &mut sections {
        while of_section.last().is_some_and(|line| line.trim().is_empty()) {
            of_section.pop();
        }
    }
    sections
}

/// Sections and the parameters, each in the first one of its name or in a new one.
fn with(mut saved: Vec<Section>, parameters: &Parameters) -> Vec<Section> {
    for (section, lines) in sections(parameters) {
        match saved.iter_mut().find(|(name, _)| *name == section) {
            Some((_, known)) => known.extend(lines),
            None => saved.push((section, lines)),
        }
    }
    saved
}

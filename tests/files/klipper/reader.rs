//! The firmware's reader of configurations, written from its source (`klippy/configfile.py` and Python's `configparser`).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const HEADER: &str = "\n#*# <---------------------- SAVE_CONFIG ---------------------->\n\
    #*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n#*#\n";

/// Values by section and option.
pub(super) type Options = BTreeMap<(String, String), String>;

/// Settings that the firmware takes from a configuration; `Err` is what it refuses, or a saved block that it passes over.
pub(super) fn as_read(path: &Path) -> Result<Options, String> {
    let data = fs::read_to_string(path).unwrap().replace("\r\n", "\n");
    let (regular, saved) = parts(&data)?;
    let mut options = Options::new();
    with_includes(regular, path, &mut options)?;
    let mut of_block = Options::new();
    section_by_section(&saved, &mut of_block)?;
    for (name, value) in of_block {
        options.entry(name).or_insert(value);
    }
    Ok(options)
}

/// The part that is written by hand, and the saved one.
fn parts(data: &str) -> Result<(&str, String), String> {
    let (regular, saved) = data.split_once(HEADER).unwrap_or((data, ""));
    if regular.contains("\n#*# ") || saved.contains(HEADER) {
        return Err("corrupted".to_owned());
    }
    let saved = saved.trim();
    let mut lines = String::new();
    for line in saved.split('\n').filter(|_| !saved.is_empty()) {
        if line != "#*#" && !line.starts_with("#*# ") {
            return Err(format!("modifications after the header: {line}"));
        }
        lines.push_str(line.get(4..).unwrap_or(""));
        lines.push('\n');
    }
    Ok((regular, lines))
}

fn with_includes(data: &str, path: &Path, options: &mut Options) -> Result<(), String> {
    let mut buffer = String::new();
    for line in data.split('\n') {
        let line = line.split('#').next().unwrap();
        let name = line
            .strip_prefix("[include ")
            .and_then(|rest| rest.split(']').next());
        let Some(name) = name else {
            buffer.push_str(line);
            buffer.push('\n');
            continue;
        };
        section_by_section(&buffer, options)?;
        buffer.clear();
        let folder = path.parent().unwrap();
        for path in files(&folder.join(name.trim()))? {
            let data = fs::read_to_string(&path).unwrap();
            with_includes(&data, &path, options)?;
        }
    }
    section_by_section(&buffer, options)
}

/// One file, or all of `folder/*.cfg` by name.
fn files(pattern: &Path) -> Result<Vec<PathBuf>, String> {
    if pattern.file_name().unwrap() != "*.cfg" {
        let is_there = pattern.exists();
        return is_there
            .then(|| vec![pattern.to_owned()])
            .ok_or_else(|| format!("no {}", pattern.display()));
    }
    let entries = fs::read_dir(pattern.parent().unwrap())
        .into_iter()
        .flatten();
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = paths
        .filter(|path| path.extension().is_some_and(|own| own == "cfg"))
        .collect();
    paths.sort();
    Ok(paths)
}

fn section_by_section(data: &str, options: &mut Options) -> Result<(), String> {
    let (mut section, mut option): (Option<String>, Option<String>) = (None, None);
    let mut level = 0;
    for line in data.lines() {
        let line = line.split('#').next().unwrap();
        let comment = (0..line.len()).find(|&at| {
            line.as_bytes()[at] == b';'
                && (at == 0 || line.as_bytes()[at - 1].is_ascii_whitespace())
        });
        let line = &line[..comment.unwrap_or(line.len())];
        let value = line.trim();
        if value.is_empty() {
            continue;
        }
        let indent = line.len() - line.trim_start().len();
        if let (Some(section), Some(option)) = (&section, &option)
            && indent > level
        {
            let known = options.get_mut(&(section.clone(), option.clone()));
            let known = known.unwrap();
            known.push('\n');
            known.push_str(value);
            continue;
        }
        level = indent;
        if value.starts_with('[') && value.contains(']') {
            section = Some(value[1..value.rfind(']').unwrap()].to_owned());
            option = None;
            continue;
        }
        let own = section.clone().ok_or("no section header")?;
        let (key, value) = value
            .split_once(['=', ':'])
            .ok_or(format!("parse {line}"))?;
        let key = key.trim().to_lowercase();
        options.insert((own, key.clone()), value.trim().to_owned());
        option = Some(key);
    }
    Ok(())
}

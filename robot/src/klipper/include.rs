//! Files that a configuration includes: names and patterns of names, as the firmware expands them (Python's `glob`).

use std::fs;
use std::path::{Path, PathBuf};

/// True if a name is a pattern, to which no file need answer.
pub(super) fn is_pattern(name: &str) -> bool {
    name.contains(['*', '?', '['])
}

/// The files that a name or a pattern means, from the folder of the file that includes them, in order of their paths.
pub(super) fn found(folder: &Path, pattern: &str) -> Vec<PathBuf> {
    let start = if pattern.starts_with('/') {
        Path::new("/")
    } else {
        folder
    };
    let mut paths = vec![start.to_owned()];
    for part in pattern.split('/').filter(|part| !part.is_empty()) {
        paths = if is_pattern(part) {
            paths.iter().flat_map(|path| matching(path, part)).collect()
        } else {
            paths.iter().map(|path| path.join(part)).collect()
        };
    }
    paths.retain(|path| path.exists());
    paths.sort_by_key(|path| path.display().to_string());
    paths
}

/// Entries of a folder with names of a pattern; hidden ones only where the pattern has their dot.
fn matching(folder: &Path, pattern: &str) -> Vec<PathBuf> {
    let here = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let pattern: Vec<char> = pattern.chars().collect();
    let entries = fs::read_dir(here).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let names = names.filter(|name| {
        let is_hidden = name.starts_with('.') && pattern.first() != Some(&'.');
        !is_hidden && is_match(&pattern, &name.chars().collect::<Vec<_>>())
    });
    names.map(|name| folder.join(name)).collect()
}

/// True if a name is one of a pattern: `*` stands for any characters, `?` for one, `[a-z]` or `[!a-z]` for one of a set.
fn is_match(pattern: &[char], name: &[char]) -> bool {
    let Some((&first, rest)) = pattern.split_first() else {
        return name.is_empty();
    };
    if first == '*' {
        return (0..=name.len()).any(|skipped| is_match(rest, &name[skipped..]));
    }
    let Some((&own, after)) = name.split_first() else {
        return false;
    };
    match (first, set(rest)) {
        ('?', _) => is_match(rest, after),
        ('[', Some((of_set, rest))) => is_of_set(of_set, own) && is_match(rest, after),
        _ => first == own && is_match(rest, after),
    }
}

/// The set that a bracket opens and what follows its end; a bracket that is not closed stands for itself.
fn set(pattern: &[char]) -> Option<(&[char], &[char])> {
    // A closing bracket at the beginning belongs to the set.
    let from = usize::from(pattern.first() == Some(&'!')) + 1;
    let length = pattern.iter().skip(from).position(|&own| own == ']')? + from;
    Some((&pattern[..length], &pattern[length + 1..]))
}

fn is_of_set(set: &[char], own: char) -> bool {
    let (is_negated, mut rest) = match set {
        ['!', rest @ ..] => (true, rest),
        _ => (false, set),
    };
    let mut is_in = false;
    while let [first, after @ ..] = rest {
        rest = if let ['-', last, after @ ..] = after {
            is_in |= (*first..=*last).contains(&own);
            after
        } else {
            is_in |= *first == own;
            after
        };
    }
    is_in != is_negated
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_those_of_a_shell() {
        let matches = |pattern: &str, name: &str| {
            let of = |text: &str| text.chars().collect::<Vec<_>>();
            is_match(&of(pattern), &of(name))
        };
        for (pattern, name, expected) in [
            ("*.cfg", "a.cfg", true),
            ("*.cfg", "a.cfg.bak", false),
            ("a?.cfg", "ab.cfg", true),
            ("a?.cfg", "a.cfg", false),
            ("[a-c]x", "bx", true),
            ("[!a-c]x", "bx", false),
            ("[]]x", "]x", true),
            ("[a", "[a", true),
            ("a*b*c", "a1b2c", true),
            ("a*b*c", "a1c2b", false),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} {name}");
        }
    }
}

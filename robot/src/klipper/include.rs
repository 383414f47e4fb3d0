//! Files that a configuration includes: names and patterns of names, as the firmware expands them (Python's `glob`).

use std::path::{Path, PathBuf};

use glob::{MatchOptions, Pattern};

/// As a shell matches: no wildcard stands for a separator, or for the dot of a hidden name.
const AS_A_SHELL: MatchOptions = MatchOptions {
    case_sensitive: true,
    require_literal_separator: true,
    require_literal_leading_dot: true,
};

/// True if a name is a pattern, to which no file need answer.
pub(super) fn is_pattern(name: &str) -> bool {
    name.contains(['*', '?', '['])
}

/// The files that a name or a pattern means, from the folder of the file that includes them, in order of their paths.
pub(super) fn found(folder: &Path, pattern: &str) -> Vec<PathBuf> {
    let plain = folder.join(pattern);
    let folder = Pattern::escape(&folder.display().to_string());
    let whole = Path::new(&folder).join(pattern).display().to_string();
    // A bracket that is not closed stands for itself.
    let found = glob::glob_with(&whole, AS_A_SHELL).map(|paths| paths.flatten().collect());
    let mut paths: Vec<PathBuf> = found.unwrap_or_else(|_| vec![plain]);
    paths.retain(|path| path.exists());
    paths.sort_by_key(|path| path.display().to_string());
    paths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_those_of_a_shell() {
        for (pattern, name, expected) in [
            ("*.cfg", "a.cfg", true),
            ("*.cfg", "a.cfg.bak", false),
            ("*.cfg", ".a.cfg", false),
            ("a?.cfg", "ab.cfg", true),
            ("a?.cfg", "a.cfg", false),
            ("[a-c]x", "bx", true),
            ("[!a-c]x", "bx", false),
            ("[]]x", "]x", true),
            ("[a", "[a", true),
            ("a*b*c", "a1b2c", true),
            ("a*b*c", "a1c2b", false),
        ] {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join(name), "").unwrap();
            let files = found(folder.path(), pattern);
            let meant = expected.then(|| folder.path().join(name));
            assert_eq!(files, Vec::from_iter(meant), "{pattern} {name}");
        }
    }
}

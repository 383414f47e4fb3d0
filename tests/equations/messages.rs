//! Mistakes in descriptions: the cases of `messages/`, each a text whose first line says which codes it gets, and where.
//!
//! Codes and places are checked against that line, words against a snapshot of each folder: who rewords a message
//! changes snapshots alone. Every code of the language has a case.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use tau_model_dsl::{Diagnostic, check_text};

/// Longest underlined text that a snapshot shows in full, in characters.
const LONGEST_SHOWN: usize = 60;

/// The paths in a folder, in order.
fn sorted(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

fn stem(path: &Path) -> &str {
    path.file_stem().unwrap().to_str().unwrap()
}

/// The folders of cases.
fn categories() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("equations/messages");
    sorted(&root)
}

fn diagnostics(text: &str) -> Vec<Diagnostic> {
    check_text(text).map_or_else(|errors| errors.diagnostics, |_| Vec::new())
}

/// `T143 at 8:30, T112 at 9:5`, as the first line of a case says it.
fn codes_and_places(diagnostics: &[Diagnostic]) -> String {
    let each = diagnostics.iter().map(|one| {
        let (line, column) = (one.line(), one.column());
        format!("{} at {line}:{column}", one.code)
    });
    each.collect::<Vec<_>>().join(", ")
}

/// The characters concerned, on one line.
fn underlined(text: &str, diagnostic: &Diagnostic) -> String {
    let words: Vec<&str> = text[diagnostic.byte_range()].split_whitespace().collect();
    let characters: Vec<char> = words.join(" ").chars().collect();
    if characters.len() <= LONGEST_SHOWN {
        return characters.into_iter().collect();
    }
    let (head, tail) = characters.split_at(LONGEST_SHOWN / 2);
    let tail = &tail[tail.len() - LONGEST_SHOWN / 2..];
    format!("{} … {}", String::from_iter(head), String::from_iter(tail))
}

/// What a snapshot shows of a case.
fn section(name: &str, text: &str, diagnostics: &[Diagnostic]) -> String {
    let mut section = format!("{name}\n");
    for one in diagnostics {
        let (line, column, message) = (one.line(), one.column(), &one.message);
        let place = underlined(text, one);
        section += &format!("    {} {line}:{column} `{place}`: {message}\n", one.code);
        section += &format!("        {}\n", one.help.as_deref().unwrap_or("no help"));
    }
    section
}

#[test]
fn every_case_gets_its_codes_at_their_places() {
    let mut wrong = String::new();
    for path in categories().iter().flat_map(|category| sorted(category)) {
        let text = fs::read_to_string(&path).unwrap();
        let found = diagnostics(&text);
        let expected = text.lines().next().unwrap_or("");
        let said = codes_and_places(&found);
        if expected != format!("// {said}") {
            wrong += &format!("{}: says `{expected}`, gets `{said}`\n", path.display());
        }
        if found.iter().any(|one| one.help.is_none()) {
            wrong += &format!("{}: a message without help\n", path.display());
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn words() {
    for category in categories() {
        let sections: Vec<String> = sorted(&category)
            .into_iter()
            .map(|path| {
                let text = fs::read_to_string(&path).unwrap();
                section(stem(&path), &text, &diagnostics(&text))
            })
            .collect();
        insta::assert_snapshot!(stem(&category), sections.join("\n"));
    }
}

#[test]
fn every_code_of_the_language_has_a_case() {
    let shown: BTreeSet<_> = (categories().iter())
        .flat_map(|category| sorted(category))
        .flat_map(|path| diagnostics(&fs::read_to_string(path).unwrap()))
        .map(|one| one.code)
        .collect();
    let of_the_language = tau_codes::all().filter(|code| code.to_string().starts_with("T1"));
    let missing: Vec<_> = of_the_language
        .filter(|code| !shown.contains(code))
        .map(|code| format!("{code}: {}", code.meaning()))
        .collect();
    assert!(missing.is_empty(), "no case of {missing:#?}");
}

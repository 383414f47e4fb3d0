//! Compile errors of `tau_model!` and of uses of what it declares, case by case: what rustc shows, and that a
//! `.tau` file gives the same.

use std::fs;
use std::path::{Path, PathBuf};

use tau_model_dsl::{Errors, check_text};

/// One message with its place.
#[derive(Debug, PartialEq)]
struct Message {
    line: usize,
    column: usize,
    /// First line of the message, and the help.
    lines: Vec<String>,
    /// Characters underlined, where the place lies on one line.
    underlined: Option<usize>,
}

#[test]
fn the_macro_reports() {
    trybuild::TestCases::new().compile_fail("cases/*/*.rs");
}

/// Use and misuse of what the macro declares; the type checker's words are part of these cases.
#[test]
fn handles_are_checked() {
    let cases = trybuild::TestCases::new();
    cases.pass("pass/*.rs");
    cases.compile_fail("handles/*.rs");
}

#[test]
fn a_file_reports_the_same() {
    let cases = cases(Path::new("cases"));
    assert!(cases.len() >= 35, "found {} cases", cases.len());
    for path in cases {
        let source = fs::read_to_string(&path).unwrap();
        let expected =
            messages_of_rustc(&fs::read_to_string(path.with_extension("stderr")).unwrap());
        let description = description(&source);
        let errors =
            check_text(&description).expect_err(&format!("{} has no error", path.display()));
        let empty = description.trim().is_empty();
        for diagnostic in &errors.diagnostics {
            assert!(
                diagnostic.help.is_some(),
                "{}: no help: {diagnostic}",
                path.display()
            );
        }
        assert_eq!(
            messages(&errors, &description, empty),
            strip(expected, empty),
            "{}",
            path.display()
        );
    }
}

/// All cases, in order.
fn cases(root: &Path) -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = fs::read_dir(root)
        .unwrap()
        .flat_map(|category| fs::read_dir(category.unwrap().path()).unwrap())
        .map(|case| case.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "rs"))
        .collect();
    found.sort();
    found
}

/// The text inside the macro's braces, at the same lines and columns.
fn description(source: &str) -> String {
    let start = source.find('{').unwrap() + 1;
    let end = source.find("}\n\nfn main").unwrap();
    let blank = |text: &str| -> String {
        text.chars()
            .map(|character| if character == '\n' { '\n' } else { ' ' })
            .collect()
    };
    format!("{}{}", blank(&source[..start]), &source[start..end])
}

fn messages(errors: &Errors, text: &str, empty: bool) -> Vec<Message> {
    let found = errors
        .diagnostics
        .iter()
        .map(|diagnostic| {
            let place = &text[diagnostic.byte_range()];
            Message {
                line: diagnostic.line(),
                column: diagnostic.column(),
                lines: diagnostic.to_string().lines().map(str::to_owned).collect(),
                underlined: (!place.contains('\n')).then_some(place.chars().count()),
            }
        })
        .collect();
    strip(found, empty)
}

/// An empty macro has no token to point at, and rustc points at the invocation instead.
fn strip(messages: Vec<Message>, empty: bool) -> Vec<Message> {
    if !empty {
        return messages;
    }
    messages
        .into_iter()
        .map(|message| Message {
            line: 0,
            column: 0,
            underlined: None,
            ..message
        })
        .collect()
}

/// Reads what rustc wrote: `error: …`, indented lines, `--> file:line:column`, the excerpt.
fn messages_of_rustc(text: &str) -> Vec<Message> {
    let mut messages = Vec::new();
    for block in text.split("error: ").skip(1) {
        let (message, excerpt) = block
            .split_once("\n --> ")
            .or_else(|| block.split_once("--> "))
            .unwrap();
        let lines = message
            .lines()
            .map(|line| line.trim().to_owned())
            .filter(|line| !line.is_empty());
        let mut place = excerpt.lines().next().unwrap().rsplit(':');
        let column = place.next().unwrap().parse().unwrap();
        let line = place.next().unwrap().parse().unwrap();
        let underline = excerpt
            .lines()
            .find(|line| line.trim_start().starts_with("| ") && line.contains('^'));
        // Over several lines, rustc draws a frame of underscores.
        let underlined = underline
            .filter(|line| !line.contains('_'))
            .map(|line| line.chars().filter(|character| *character == '^').count());
        messages.push(Message {
            line,
            column,
            lines: lines.collect(),
            underlined,
        });
    }
    messages
}

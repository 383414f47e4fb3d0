//! Answers to mistakes, collected under the names of their cases: codes and places are asserted here, texts by the
//! snapshot of all.

use tau::input_error::InputError;
use tau_testkit::{Ran, Work, said};

/// What cases were answered, and where that was not what they expect.
#[derive(Default)]
pub(crate) struct Answers {
    shown: String,
    wrong: Vec<String>,
}

impl Answers {
    /// The answer of a reader. Expected is a list of codes with lines of `file`, such as `T214:1 T217:3`; a code without
    /// line blames the whole file, `T214@other.csv:1` another one, and `-` stands for an input that is taken.
    pub(crate) fn read<T>(
        &mut self,
        case: &str,
        [file, expected]: [&str; 2],
        work: &Work,
        result: Result<T, InputError>,
    ) {
        let folder = work.path().display().to_string();
        let (found, text) = match result {
            Ok(_) => (vec![], "accepted".to_owned()),
            Err(error) => {
                let problems = error.problems().iter().map(|problem| {
                    let line = problem.place.as_ref().map_or(0, |place| place.line);
                    let source = problem.source.replace(&folder, "DIR");
                    (problem.code.to_string(), source, line)
                });
                let text = error.render(false).replace(&folder, "DIR");
                (problems.collect(), text)
            }
        };
        self.add(case, [file, expected], &found, &text);
    }

    /// The answer of a command line: its errors, or codes of its remarks where it is done. An exit code of 1 stands before.
    pub(crate) fn ran(&mut self, case: &str, expected: [&str; 2], ran: &Ran) {
        let problems = ran.problems().into_iter();
        let mut found: Vec<_> = problems
            .map(|problem| (problem.code, problem.file, problem.line))
            .collect();
        match (ran.code, found.is_empty()) {
            (0, true) => {
                let codes = said(&ran.err).into_iter();
                found = codes
                    .map(|code| (code, expected[0].to_owned(), 0))
                    .collect();
            }
            (2, false) => {}
            (code, _) => found.insert(0, (format!("{code}"), expected[0].to_owned(), 0)),
        }
        self.add(case, expected, &found, ran.err.trim_end());
    }

    fn add(
        &mut self,
        case: &str,
        [file, expected]: [&str; 2],
        found: &[(String, String, usize)],
        text: &str,
    ) {
        let written = found.iter().map(|(code, source, line)| {
            let source = source.rsplit('/').next().unwrap_or_default();
            let source = match source {
                _ if source == file || source.is_empty() => String::new(),
                _ => format!("@{source}"),
            };
            match line {
                0 => format!("{code}{source}"),
                _ => format!("{code}{source}:{line}"),
            }
        });
        let found = match found {
            [] => "-".to_owned(),
            _ => written.collect::<Vec<_>>().join(" "),
        };
        if found != expected {
            self.wrong
                .push(format!("{case}: found {found}, expected {expected}"));
        }
        let line = "-".repeat(case.chars().count());
        self.shown.extend([case, "\n", &line, "\n", text, "\n\n"]);
    }

    /// The texts, where all cases were answered as expected.
    #[track_caller]
    pub(crate) fn shown(self) -> String {
        assert!(self.wrong.is_empty(), "{}", self.wrong.join("\n"));
        self.shown
    }
}

/// Rows of a table of cases: cells between `|`, in which `\n` is a line's end.
pub(crate) fn cases<const N: usize>(table: &str) -> Vec<[String; N]> {
    let rows = table.lines().map(str::trim).filter(|line| !line.is_empty());
    rows.map(|line| {
        let cells = line.split('|').map(|cell| cell.trim().replace("\\n", "\n"));
        let cells: Vec<String> = cells.collect();
        let count = cells.len();
        <[String; N]>::try_from(cells).unwrap_or_else(|_| panic!("{count} cells: {line}"))
    })
    .collect()
}

/// The text with a stretch replaced, or with all that are so where it begins with `*`; there must be one.
#[track_caller]
pub(crate) fn replaced(text: &str, old: &str, new: &str) -> String {
    let (old, count) = match old.strip_prefix('*') {
        Some(old) => (old, usize::MAX),
        None => (old, 1),
    };
    assert!(text.contains(old), "`{old}` is not in the text");
    text.replacen(old, new, count)
}

//! What a command line said.

use serde_json::Value;

use crate::Table;

/// Outcome of a command line.
#[derive(Debug, Clone)]
pub struct Ran {
    /// The exit code.
    pub code: u8,
    /// Standard output.
    pub out: String,
    /// Standard error; names of the folder that was worked in stand as `DIR`.
    pub err: String,
}

/// An error as the screen shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// The code, such as `T204`; empty where it has none.
    pub code: String,
    /// The file, without the folder of the test, or the option.
    pub file: String,
    /// The line, from 1; 0 where the file as a whole is at fault.
    pub line: usize,
}

impl Ran {
    /// Its standard output, when it is done.
    ///
    /// # Panics
    /// Its exit code is not 0.
    #[track_caller]
    pub fn done(self) -> String {
        assert_eq!(self.code, 0, "{}{}", self.out, self.err);
        self.out
    }

    /// Its standard output as JSON, when it is done.
    ///
    /// # Panics
    /// Its exit code is not 0, or there is no JSON.
    #[track_caller]
    pub fn json(self) -> Value {
        serde_json::from_str(&self.done()).expect("nothing but JSON")
    }

    /// Its standard output as JSON, whatever its exit code.
    ///
    /// # Panics
    /// There is no JSON.
    #[track_caller]
    pub fn printed(&self) -> Value {
        serde_json::from_str(&self.out)
            .unwrap_or_else(|_| panic!("no JSON: {}{}", self.out, self.err))
    }

    /// Its standard output as a table, when it is done.
    #[track_caller]
    pub fn table(self) -> Table {
        Table::parse(&self.done())
    }

    /// Codes of all that it said on both streams, in order.
    pub fn codes(&self) -> Vec<String> {
        [&self.err, &self.out]
            .into_iter()
            .flat_map(|text| said(text))
            .collect()
    }

    /// True if something of this code was said.
    pub fn says(&self, code: &str) -> bool {
        self.codes().iter().any(|said| said == code)
    }

    /// Compares the lines that end with a code, on either stream, with the snapshot of this code: see [`show`].
    ///
    /// # Panics
    /// There are none, or the words are others.
    #[track_caller]
    pub fn shows(&self, code: &str) {
        let end = format!("[{code}]");
        let lines = [&self.err, &self.out]
            .into_iter()
            .flat_map(|text| text.lines());
        let said: Vec<&str> = lines
            .filter(|line| line.contains(&end))
            .map(str::trim)
            .collect();
        assert!(!said.is_empty(), "{code} in {}{}", self.err, self.out);
        show(code, &said.join("\n"));
    }

    /// The errors that it ends with.
    pub fn problems(&self) -> Vec<Problem> {
        let mut found: Vec<Problem> = Vec::new();
        for line in self.err.lines() {
            if let Some(message) = line.strip_prefix("error: ") {
                found.push(Problem {
                    code: said(message).pop().unwrap_or_default(),
                    file: String::new(),
                    line: 0,
                });
            } else if let Some(problem) = found.last_mut()
                && let Some(place) = line.trim_start().strip_prefix("--> ")
            {
                let mut parts = place.trim_start_matches("DIR/").rsplitn(3, ':');
                let [column, line, file] = [(); 3].map(|()| parts.next());
                match (file, line.and_then(|line| line.parse().ok())) {
                    (Some(file), Some(line)) => {
                        file.clone_into(&mut problem.file);
                        problem.line = line;
                    }
                    _ => {
                        let place = [file, line, column].into_iter().flatten();
                        problem.file = place.collect::<Vec<_>>().join(":");
                    }
                }
            } else if let Some(problem) = found.last_mut()
                && problem.code.is_empty()
            {
                problem.code = said(line).pop().unwrap_or_default();
            }
        }
        found
    }

    /// Fails unless it refused its input, with just these errors: code, file or option, and line (0 for none).
    ///
    /// # Panics
    /// It did not, or with others.
    #[track_caller]
    pub fn refused(&self, expected: &[(&str, &str, usize)]) {
        let found = self.problems();
        let found: Vec<(&str, &str, usize)> = found
            .iter()
            .map(|problem| (problem.code.as_str(), problem.file.as_str(), problem.line))
            .collect();
        assert_eq!(found, expected, "{}", self.err);
        assert_eq!(self.code, 2, "{}", self.err);
    }
}

/// Compares a message with the snapshot of its code in `tests/messages`: the only place that holds its words. One test
/// shows a code; others ask for it.
///
/// # Panics
/// The words are others.
#[track_caller]
pub fn show(code: &str, message: &str) {
    let mut settings = insta::Settings::clone_current();
    settings.set_snapshot_path(concat!(env!("CARGO_MANIFEST_DIR"), "/../messages"));
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.bind(|| insta::assert_snapshot!(code, message));
}

/// Codes in brackets in a text, in order.
pub fn said(text: &str) -> Vec<String> {
    text.split("[T")
        .skip(1)
        .filter_map(|rest| rest.get(..4))
        .filter(|code| code.ends_with(']') && code[..3].bytes().all(|byte| byte.is_ascii_digit()))
        .map(|code| format!("T{}", &code[..3]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_read_from_the_screen() {
        let err = "\
error: the cell is no number [T214]
 --> DIR/measured/tcp_poses.csv:3:7
  |
3 | 1,x
  |   ^
  = help: write a number [m]

error: unknown variant `Fulll` [T231]
 --> --variant
error: it did not converge
";
        let ran = Ran {
            code: 2,
            out: String::new(),
            err: err.to_owned(),
        };
        ran.refused(&[
            ("T214", "measured/tcp_poses.csv", 3),
            ("T231", "--variant", 0),
            ("", "", 0),
        ]);
        assert_eq!(ran.codes(), ["T214", "T231"]);
    }
}

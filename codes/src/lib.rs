//! Codes of all messages: errors, remarks, reasons of verdicts, mistakes and refusals.
//!
//! A program that reads messages asks for the code; the words may change, a code never does. The hundreds tell what a
//! message is about: [`language`] `T1xx`, [`files`] and options `T2xx`, [`fit`] and verdict `T3xx`, [`mistakes`] `T4xx`,
//! [`kinematics`] and prediction `T5xx`, [`discovery`] `T6xx`. A code is never used for a second meaning.
//!
//! ```
//! use tau_codes::{files, find};
//!
//! assert_eq!(files::NO_SUCH_FILE.to_string(), "T201");
//! assert_eq!(find("T201").unwrap().meaning(), "a file does not exist");
//! ```

use std::fmt;

/// Declares codes of one module, with their meanings, in ascending order.
macro_rules! codes {
    ($($name:ident = $number:literal: $meaning:literal;)*) => {
        $(
            #[doc = concat!("`T", stringify!($number), "`: ", $meaning, ".")]
            pub const $name: $crate::Code = $crate::Code::new($number, $meaning);
        )*
        /// All codes of this module.
        pub(crate) const ALL: &[$crate::Code] = &[$($name),*];
    };
}

/// A [`Remark`] of a code with the arguments of [`format!`].
#[macro_export]
macro_rules! remark {
    ($code:expr; $($text:tt)*) => {
        $crate::Remark::new($code, ::std::format!($($text)*))
    };
}

pub mod discovery;
pub mod files;
pub mod fit;
pub mod kinematics;
pub mod language;
pub mod mistakes;

/// The code of a message; displays as `T204`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Code {
    number: u16,
    meaning: &'static str,
}

impl Code {
    const fn new(number: u16, meaning: &'static str) -> Self {
        Self { number, meaning }
    }

    /// What every message of this code says, in one line.
    pub const fn meaning(self) -> &'static str {
        self.meaning
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "T{}", self.number)
    }
}

impl fmt::Debug for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A message for the user with its code.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Remark {
    /// Its code.
    pub code: Code,
    /// The message, without the code.
    pub text: String,
}

impl Remark {
    /// A message with its code.
    pub fn new(code: Code, text: impl Into<String>) -> Self {
        Self {
            code,
            text: text.into(),
        }
    }
}

/// The message, with the code in brackets at the end of its first line.
impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = self.text.find('\n').unwrap_or(self.text.len());
        let (first, rest) = self.text.split_at(end);
        write!(f, "{first} [{}]{rest}", self.code)
    }
}

/// Every code, in ascending order.
pub fn all() -> impl Iterator<Item = Code> {
    [
        language::ALL,
        files::ALL,
        fit::ALL,
        mistakes::ALL,
        kinematics::ALL,
        discovery::ALL,
    ]
    .into_iter()
    .flatten()
    .copied()
}

/// The code that is written so, such as `T204`.
pub fn find(written: &str) -> Option<Code> {
    all().find(|code| code.to_string() == written)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_ascend_in_the_hundred_of_their_module() {
        let all: Vec<Code> = all().collect();
        assert!(all.is_sorted_by(|a, b| a.number < b.number), "{all:?}");
        let modules = [
            language::ALL,
            files::ALL,
            fit::ALL,
            mistakes::ALL,
            kinematics::ALL,
            discovery::ALL,
        ];
        for (own, hundred) in modules.iter().zip(1..) {
            for code in *own {
                assert_eq!(code.number / 100, hundred, "{code}");
            }
        }
    }
}

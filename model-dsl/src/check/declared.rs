//! Names declared so far.

use std::collections::BTreeMap;

use proc_macro2::Ident;

use crate::diagnostics::Diagnostics;
use crate::names::article;

/// Names declared so far, with what they are and on which line.
#[derive(Default)]
pub(super) struct Declared {
    names: BTreeMap<String, (&'static str, usize)>,
}

impl Declared {
    /// Declares a name; a second declaration is an error, of which uses may mean either. True of the first.
    pub(super) fn declare(
        &mut self,
        name: &Ident,
        what: &'static str,
        diagnostics: &mut Diagnostics,
    ) -> bool {
        let here = (what, name.span().start().line);
        let Some((first, line)) = self.names.get(&name.to_string()) else {
            self.names.insert(name.to_string(), here);
            return true;
        };
        let help = if *first == what && what.starts_with("value") {
            "say it once"
        } else {
            "choose another name"
        };
        twice(name, first, *line, help, diagnostics);
        false
    }

    pub(super) fn kind(&self, name: &Ident) -> Option<&'static str> {
        self.names.get(&name.to_string()).map(|(what, _)| *what)
    }
}

/// Reports a name that was declared on a line.
pub(super) fn twice(
    name: &Ident,
    first: &str,
    line: usize,
    help: &str,
    diagnostics: &mut Diagnostics,
) {
    error!(diagnostics, DECLARED_TWICE, name;
        "`{name}` is already declared as {} {first}, on line {line}", article(first); "{help}");
}

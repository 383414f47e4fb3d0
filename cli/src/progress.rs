//! A bar on standard error, where it is a terminal.

use indicatif::{ProgressBar, ProgressStyle};
use tau::study::Progress;

use super::Console;

/// A bar that is removed when the work ends.
pub(super) struct Bar(ProgressBar);

impl Bar {
    /// A bar, or nothing where it would not be seen or is not wanted.
    pub(super) fn new(console: &Console<'_>) -> Self {
        let bar = if console.terminals.err && !console.quiet {
            ProgressBar::new(0)
        } else {
            ProgressBar::hidden()
        };
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        Self(bar)
    }

    pub(super) fn show(&self, progress: Progress<'_>) {
        self.0.set_length(progress.steps as u64);
        self.0.set_message(progress.doing.to_owned());
        self.0.set_position(progress.done as u64);
    }
}

/// Progress of work of unknown length; removed when the work ends.
pub(super) struct Spinner(ProgressBar);

impl Spinner {
    /// A line, or nothing where it would not be seen or is not wanted.
    pub(super) fn new(console: &Console<'_>) -> Self {
        Self(if console.terminals.err && !console.quiet {
            ProgressBar::new_spinner()
        } else {
            ProgressBar::hidden()
        })
    }

    pub(super) fn show(&self, doing: &str) {
        self.0.set_message(doing.to_owned());
        self.0.tick();
    }
}

impl Drop for Spinner {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

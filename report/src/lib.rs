//! Results of a study or a discovery, for people and for programs: terminal tables, JSON, figures, an HTML report.
//!
//! All of it is written from [`Study`](tau::study::results::Study) or
//! [`Discovery`](tau::discovery::Discovery) alone, and nothing here computes more than a mean or a largest
//! value. [`study_files`] makes those of the output folder, [`write_files`] writes them.

mod discovery;
mod elements;
pub mod figures;
mod findings;
mod first_page;
mod gauge;
pub mod html;
pub mod json;
mod machine;
mod measured;
mod number;
mod parts;
mod screen;
mod sections;
mod shell;
mod stale;
mod table;
mod tables;
pub mod terminal;
#[cfg(test)]
mod tests;
pub mod trust;
mod write;

pub use figures::Figure;
pub use shell::shell_word;
pub use stale::stale_figures;
pub use write::{finish_writing, folder_of, study_files, write_files};

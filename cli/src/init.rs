//! `tau init`.

use std::fs;
use tau_robot::input_error;

use tau::robot_file::RobotFile;
use tau_codes::files;

use super::deliver::{Outcome, check_file};
use super::kept::Kept;
use super::resolve::described;
use super::{Failure, arguments};

pub(super) fn run(arguments: &arguments::Init) -> Result<Outcome, Failure> {
    let out = &arguments.out;
    let robot = described(&arguments.description)?;
    Kept::of(None, [&arguments.description]).check("--out", out)?;
    check_file(out)?;
    if fs::symlink_metadata(out).is_ok() && !arguments.force {
        let name = out.display().to_string();
        return Err(
            input_error!(files::ALREADY_THERE, name; "there is a file of this name";
                "name another one with `--out`, or replace it with `--force`")
            .into(),
        );
    }
    let text = RobotFile::template(&robot);
    let blanks = text.lines().filter(|line| !line.starts_with('#'));
    let blanks: usize = blanks.map(|line| line.matches("\"?\"").count()).sum();
    Ok(Outcome {
        summary: format!(
            "written: {}, with {blanks} numbers to fill in\n",
            out.display()
        ),
        files: vec![(out.clone(), text)],
        ..Outcome::default()
    })
}

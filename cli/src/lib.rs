//! The command line `tau`.
//!
//! Arguments as typed ([`arguments`]) are resolved into their meaning ([`resolve`]), so that mistakes are
//! answered before any work is done. A command then computes an [`Outcome`]; only after it has succeeded
//! is anything written ([`deliver`]).

mod arguments;
mod calibrate;
mod check;
mod deliver;
mod discover;
mod errors;
mod evaluate;
mod firmware;
mod generate;
mod init;
mod kept;
mod kinematics;
mod numbers;
mod progress;
mod resolve;
mod robots;
mod sensitivity;
mod simulate;
mod study;
mod trust;

use std::ffi::OsString;
use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use tau_robot::input_error;

use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches};
use tau::calibration;
use tau::input_error::InputError;
use tau_codes::{Remark, files};
use tau_report as report;

use arguments::{Arguments, Command, Kinematics};
use deliver::Outcome;

/// Exit code: a calibration did not converge, a pose could not be found, a check failed.
pub const FAILED: u8 = 1;
/// Exit code: the input or the command line is wrong, or an output can't be written.
pub const BAD_INPUT: u8 = 2;
/// Characters in a line of text that goes to no terminal.
const READABLE: usize = 100;
/// Exit code of a process that is interrupted, as shells have it: 128 and the number of the signal.
const INTERRUPTED: i32 = 130;

/// Runs a command line, of which the first item is the program's name, and returns its exit code: 0 done,
/// 1 failed to converge or check failed, 2 bad input or usage.
///
/// Results go to `out`, errors to `err`, without colours or progress bars.
///
/// ```
/// let (mut out, mut err) = (Vec::new(), Vec::new());
/// let code = tau_cli::run(["tau", "--version"].map(Into::into), &mut out, &mut err);
/// assert_eq!(code, 0);
/// assert!(out.starts_with(b"tau "));
/// ```
pub fn run(
    arguments: impl IntoIterator<Item = OsString>,
    out: &mut dyn Write,
    err: &mut dyn Write,
) -> u8 {
    let terminals = Terminals {
        out: false,
        err: false,
    };
    Console {
        out,
        err,
        terminals,
        width: READABLE,
        quiet: false,
        has_json: false,
    }
    .run(arguments)
}

/// Runs the command line of this process, with colours and progress bars where a terminal shows them.
///
/// An interrupt ends it, though not while files are being written.
pub fn main() -> ExitCode {
    // Without a handler an interrupt still ends the process, only less tidily.
    let _ = ctrlc::set_handler(|| {
        let _until_the_end = report::finish_writing();
        std::process::exit(INTERRUPTED);
    });
    // This thread works with the others, so that none waits for it to hand over the work, nor it for them: not even for
    // their start, as it would for that of the global pool. Where they can't be started, it does without.
    let _pool = rayon::ThreadPoolBuilder::new().use_current_thread().build();
    let terminals = Terminals {
        out: io::stdout().is_terminal(),
        err: io::stderr().is_terminal(),
    };
    let code = Console {
        out: &mut io::stdout().lock(),
        err: &mut io::stderr(),
        terminals,
        width: width(terminals),
        quiet: false,
        has_json: false,
    }
    .run(std::env::args_os());
    ExitCode::from(code)
}

/// Streams that are terminals.
#[derive(Debug, Clone, Copy)]
struct Terminals {
    out: bool,
    err: bool,
}

/// Characters in a line: as the environment asks for, of the terminal, or as many as are well read in a file.
fn width(terminals: Terminals) -> usize {
    let asked = std::env::var("COLUMNS").ok();
    if let Some(columns) = asked.and_then(|columns| columns.parse().ok())
        && columns > 0
    {
        return columns;
    }
    let is_shown = terminals.out || terminals.err;
    let size = is_shown.then(terminal_size::terminal_size).flatten();
    size.map_or(READABLE, |(width, _)| usize::from(width.0))
}

/// Output streams of a command.
struct Console<'a> {
    out: &'a mut dyn Write,
    err: &'a mut dyn Write,
    terminals: Terminals,
    /// Characters in a line of what is printed.
    width: usize,
    /// True if only errors and data are printed.
    quiet: bool,
    /// True once the JSON that was asked for is handed over.
    has_json: bool,
}

/// Why a command failed.
#[derive(Debug)]
enum Failure {
    /// The input is wrong, or an output can't be written.
    Input(InputError),
    /// The result can't be computed, or a check failed.
    Failed(Remark),
    /// A mistake of the input explains why there is no result: what is said of it.
    Explained(Box<Outcome>),
    /// Nobody reads standard output any more.
    ReaderGone,
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::Input(error)
    }
}

impl From<calibration::Error> for Failure {
    fn from(error: calibration::Error) -> Self {
        match error {
            calibration::Error::Input(error) => Self::Input(error),
            error => Self::Failed(Remark::new(error.code(), error.text())),
        }
    }
}

impl Console<'_> {
    fn run(mut self, arguments: impl IntoIterator<Item = OsString>) -> u8 {
        // Help is in lines of the terminal's width, none longer than is well read.
        let command = Arguments::command().term_width(self.width.min(READABLE));
        let parsed = command
            .try_get_matches_from(arguments)
            .and_then(|found| Arguments::from_arg_matches(&found));
        let arguments = match parsed {
            Ok(arguments) => arguments,
            Err(error) => return self.usage(&error),
        };
        self.quiet = arguments.quiet;
        let command =
            (arguments.command).unwrap_or_else(|| Command::Study(arguments::Study::default()));
        let result = self.execute(&command);
        if let Err(failure) = &result
            && !self.has_json
        {
            errors::deliver(failure, &command, &mut self);
        }
        match result {
            Ok(()) | Err(Failure::ReaderGone) => 0,
            Err(Failure::Failed(message)) => {
                self.complain(&format_args!("error: {message}"));
                FAILED
            }
            Err(Failure::Input(error)) => {
                self.complain(&error.render(self.terminals.err));
                BAD_INPUT
            }
            // Delivered as an outcome before.
            Err(Failure::Explained(_)) => FAILED,
        }
    }

    fn execute(&mut self, command: &Command) -> Result<(), Failure> {
        let found = match command {
            Command::Study(arguments) => study::run(arguments, self),
            Command::Check(arguments) => check::run(arguments, self),
            Command::Calibrate(arguments) => calibrate::run(arguments, self),
            Command::Evaluate(arguments) => evaluate::run(arguments, self),
            Command::Sensitivity(arguments) => sensitivity::run(arguments, self),
            Command::Discover(arguments) => discover::run(arguments, self),
            Command::Init(arguments) => init::run(arguments),
            Command::Import(arguments) => firmware::import(arguments),
            Command::Export(arguments) => firmware::export(arguments),
            Command::Robots => Ok(robots::run(self.width)),
            Command::Simulate(arguments) => simulate::run(arguments),
            Command::Generate(arguments) => generate::run(arguments),
            Command::Kinematics(Kinematics::Forward(arguments)) => kinematics::forward(arguments),
            Command::Kinematics(Kinematics::Inverse(arguments)) => kinematics::inverse(arguments),
            Command::Completions(arguments) => Ok(completions(arguments)),
        };
        match found {
            Err(Failure::Explained(outcome)) => outcome.deliver(self),
            found => found?.deliver(self),
        }
    }

    /// Prints help, version or a mistake of usage.
    fn usage(&mut self, error: &clap::Error) -> u8 {
        let (stream, is_terminal): (&mut dyn Write, bool) = if error.use_stderr() {
            (self.err, self.terminals.err)
        } else {
            (self.out, self.terminals.out)
        };
        let text = error.render();
        let mut text = if is_terminal {
            text.ansi().to_string()
        } else {
            text.to_string()
        };
        if error.use_stderr() && error.kind() != ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
        {
            text = Remark::new(files::USAGE, text).to_string();
        }
        // There is no one left to tell that the message could not be shown.
        let _ = write!(stream, "{text}");
        u8::try_from(error.exit_code()).unwrap_or(BAD_INPUT)
    }

    fn complain(&mut self, message: &dyn fmt::Display) {
        let _ = writeln!(self.err, "{message}");
    }

    /// Prints a remark on standard error: in lines of its width where that is a terminal, as one line for programs.
    fn remark(&mut self, remark: &Remark) {
        let note = format!("note: {remark}");
        if self.terminals.err {
            let note = report::terminal::sentence(&note, self.width);
            self.complain(&note.trim_end());
        } else {
            self.complain(&note);
        }
    }

    /// Prints on standard output.
    fn print(&mut self, text: &str) -> Result<(), Failure> {
        let written = self
            .out
            .write_all(text.as_bytes())
            .and_then(|()| self.out.flush());
        written.map_err(|error| match error.kind() {
            io::ErrorKind::BrokenPipe => Failure::ReaderGone,
            _ => {
                input_error!(files::CANNOT_WRITE, "standard output"; "cannot write: {error}").into()
            }
        })
    }
}

fn completions(arguments: &arguments::Completions) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(
        arguments.shell,
        &mut Arguments::command(),
        "tau",
        &mut script,
    );
    Outcome {
        data: String::from_utf8_lossy(&script).into_owned(),
        ..Outcome::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use tau::prototype;
    use tau::simulation::Simulation;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn a_simulation_is_by_default_that_of_the_prototype() {
        let arguments = Arguments::try_parse_from(["tau", "simulate", "--out", "folder"]).unwrap();
        let Some(Command::Simulate(typed)) = arguments.command else {
            panic!("{arguments:?}");
        };
        let robot = tau::Robot::from(&tau_generated::gantry_tau::ROBOT);
        let found = simulate::simulation(&typed, &robot).unwrap();
        let usual = Simulation::new(robot.clone(), prototype::parameters_of(&robot).unwrap());
        assert_eq!(format!("{found:?}"), format!("{usual:?}"));
    }
}

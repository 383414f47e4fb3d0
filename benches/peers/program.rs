//! Programs of peers, which run beside this one and take turns with it.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A program's report on one of its contenders after a turn.
pub(crate) struct Turn {
    pub(crate) name: String,
    /// Seconds per call.
    pub(crate) seconds: f64,
    /// Its own account of what it computed: a difference from the reference, or a cost.
    pub(crate) result: f64,
}

/// A running peer. It answers each line on its standard input by a line for each of its contenders,
/// `name TAB seconds TAB result`, and an empty line.
pub(crate) struct Program {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Program {
    /// Starts a program on a file of data.
    pub(crate) fn start(program: &Path, arguments: &[&str], data: &Path) -> Option<Self> {
        let mut child = Command::new(program)
            .args(arguments)
            .arg(data)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .ok()?;
        let (input, output) = (child.stdin.take()?, child.stdout.take()?);
        Some(Self {
            child,
            input,
            output: BufReader::new(output),
        })
    }

    /// Lets it run each of its contenders once.
    pub(crate) fn turn(&mut self) -> Vec<Turn> {
        let mut turns = Vec::new();
        if writeln!(self.input)
            .and_then(|()| self.input.flush())
            .is_err()
        {
            return turns;
        }
        for line in (&mut self.output).lines().map_while(Result::ok) {
            let mut fields = line.split('\t');
            let (Some(name), Some(seconds), Some(result)) =
                (fields.next(), fields.next(), fields.next())
            else {
                break;
            };
            if let (Ok(seconds), Ok(result)) = (seconds.parse(), result.parse()) {
                let name = name.to_owned();
                turns.push(Turn {
                    name,
                    seconds,
                    result,
                });
            }
        }
        turns
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

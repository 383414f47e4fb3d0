//! Streams, help and completions.

use std::io::{self, Write};

use tau_testkit::{Work, said};

#[test]
fn quiet_commands_print_only_what_was_asked_for() {
    let work = Work::empty();
    for line in [
        "-q study --no-discover --out DIR/study",
        "calibrate --quiet --variant Nominal --out DIR/nominal",
        "generate -q GANTRY --out DIR/code",
        "evaluate -q --variant Nominal",
    ] {
        let ran = work.run(line);
        assert_eq!((ran.code, ran.out.as_str()), (0, ""), "{line}");
        // A verdict is not hidden: the measurements that ship hold more than these variants know.
        let verdicts = usize::from(!line.contains("generate"));
        assert_eq!(ran.err.lines().count(), verdicts, "{line}: {}", ran.err);
        assert_eq!(ran.says("T302"), verdicts == 1, "{line}: {}", ran.err);
    }
}

#[test]
fn remarks_go_to_standard_error_and_results_to_standard_output() {
    let ran = Work::empty().run("evaluate --variant Nominal --json -");
    let first = ran.err.lines().next().unwrap();
    assert_eq!(said(first), ["T356"]);
    ran.shows("T356");
    assert_eq!(ran.json()["variant"], "Nominal");
}

/// A stream that can't be written.
struct Closed(io::ErrorKind);

impl Write for Closed {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(self.0.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_reader_that_leaves_is_no_error_and_a_full_disk_is_one() {
    let run = |kind| {
        let mut err = Vec::new();
        let line = ["tau", "evaluate", "--variant", "Nominal", "--json", "-"];
        let code = tau_cli::run(line.map(Into::into), &mut Closed(kind), &mut err);
        (
            code,
            said(&String::from_utf8(err).unwrap()).contains(&"T280".to_owned()),
        )
    };
    assert_eq!(run(io::ErrorKind::BrokenPipe), (0, false));
    assert_eq!(run(io::ErrorKind::StorageFull), (2, true));
}

#[test]
fn completions_know_every_command() {
    let work = Work::empty();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = work.run(&format!("completions {shell}")).done();
        for command in ["study", "calibrate", "discover", "import", "kinematics"] {
            assert!(script.contains(command), "{command} in {shell}");
        }
    }
}

#[test]
fn help_teaches() {
    let work = Work::empty();
    for command in [
        "",
        "study",
        "check",
        "calibrate",
        "evaluate",
        "sensitivity",
        "discover",
        "import",
        "export",
        "simulate",
        "generate",
        "kinematics",
        "kinematics forward",
        "kinematics inverse",
        "completions",
    ] {
        let ran = work.run(&format!("{command} --help"));
        assert_eq!(ran.err, "");
        let help = ran.done();
        let width =
            |lines: &mut dyn Iterator<Item = &str>| lines.map(|line| line.chars().count()).max();
        assert!(width(&mut help.lines()) <= Some(110), "{command}");
        // Usage is wrapped by hand.
        let usage = help.lines().skip_while(|line| !line.starts_with("Usage:"));
        let mut usage = usage.take_while(|line| !line.is_empty());
        assert!(width(&mut usage) <= Some(80), "{command}");
        let name = format!("help_{}", command.replace(' ', "_"));
        insta::assert_snapshot!(name.trim_end_matches('_'), help);
    }
}

//! Errors for programs: what a failed command writes where its JSON would have gone.

use std::path::Path;

use serde_json::{Value, json};
use tau::input_error::Problem;
use tau_report as report;

use super::arguments::{
    Calibrate, Check, Command, Evaluate, Forward, Inverse, Json, Kinematics, Sensitivity, Study,
};
use super::kept::Kept;
use super::{Console, Failure, simulate};

/// Writes why a command failed to the target of its `--json`; a file that the command reads stays as it is.
pub(super) fn deliver(failure: &Failure, command: &Command, console: &mut Console<'_>) {
    let Some((json, kept)) = asked(command) else {
        return;
    };
    let Some(target) = json.target.as_deref() else {
        return;
    };
    let errors: Vec<Value> = match failure {
        Failure::Input(error) => error.problems().iter().map(of_input).collect(),
        Failure::Failed(why) => vec![json!({
            "code": why.code.to_string(),
            "file": null,
            "line": null,
            "column": null,
            "text": why.text,
            "help": null,
        })],
        Failure::Explained(_) | Failure::ReaderGone => return,
    };
    let text = report::json::document(json!({ "errors": errors }));
    // The errors themselves stand on standard error, whatever becomes of these.
    if target == Path::new("-") {
        let _ = console.print(&text);
    } else if !target.is_dir() && kept.check("--json", target).is_ok() {
        let _ = report::write_files(&[(target.to_owned(), text)]);
    }
}

fn of_input(problem: &Problem) -> Value {
    let source = problem.source.as_str();
    // Rows are named by their file and line where the text is not at hand.
    let row = || {
        let (file, line) = source.rsplit_once(':')?;
        Some((file, Some(line.parse().ok()?)))
    };
    let (file, line, column) = match &problem.place {
        Some(place) => (source, Some(place.line), Some(place.column)),
        None => {
            let (file, line) = row().unwrap_or((source, None));
            (file, line, None)
        }
    };
    json!({
        "code": problem.code.to_string(),
        "file": file,
        "line": line,
        "column": column,
        "text": problem.message,
        "help": problem.help,
    })
}

/// The JSON that was asked for, and the files that the command reads, or finds where it would write measurements. `None` where
/// the JSON has the name of a file of measurements that the command would write.
fn asked(command: &Command) -> Option<(&Json, Kept)> {
    Some(match command {
        Command::Study(Study { input, .. })
        | Command::Check(Check { input, .. })
        | Command::Calibrate(Calibrate { input, .. })
        | Command::Evaluate(Evaluate { input, .. })
        | Command::Sensitivity(Sensitivity { input, .. }) => (&input.json, Kept::from(input)),
        Command::Discover(arguments) => (&arguments.input.json, Kept::from(arguments)),
        Command::Simulate(arguments) => {
            let target = arguments.json.target.as_deref();
            if target.is_some_and(|target| simulate::apart(target, &arguments.out).is_err()) {
                return None;
            }
            let truth = arguments.out.join("truth.json");
            let named = arguments.model.iter().chain(&arguments.robot);
            let kept = Kept::of(Some(&arguments.out), named.chain([&truth]));
            (&arguments.json, kept)
        }
        Command::Kinematics(
            Kinematics::Forward(Forward { with, poses, .. })
            | Kinematics::Inverse(Inverse { with, poses, .. }),
        ) => {
            let named = with.robot.files().chain(poses);
            (&with.json, Kept::of(with.folder.as_ref(), named))
        }
        Command::Init(_)
        | Command::Import(_)
        | Command::Export(_)
        | Command::Robots
        | Command::Generate(_)
        | Command::Completions(_) => return None,
    })
}

#[cfg(test)]
mod tests {
    use tau_codes::{Code, files};

    use super::*;

    /// Exit code of a command line, its standard output and its standard error.
    fn run(arguments: &[&str]) -> (u8, String, String) {
        let (mut out, mut err) = (Vec::new(), Vec::new());
        let arguments = ["tau"].iter().chain(arguments).map(Into::into);
        let code = crate::run(arguments, &mut out, &mut err);
        let [out, err] = [out, err].map(|text| String::from_utf8(text).unwrap());
        (code, out, err)
    }

    fn first(text: &str) -> Value {
        let value: Value = serde_json::from_str(text).unwrap();
        value["errors"][0].clone()
    }

    /// Code and place where only the file is known.
    fn of_file(code: Code, file: &str) -> [Value; 4] {
        [
            json!(code.to_string()),
            json!(file),
            json!(null),
            json!(null),
        ]
    }

    #[test]
    fn bad_input_is_written_where_the_results_would_be() {
        let (code, out, err) = run(&["check", "no-such-folder", "--json", "-"]);
        assert_eq!(code, crate::BAD_INPUT);
        let error = first(&out);
        let found = ["code", "file", "line", "column"].map(|key| error[key].clone());
        assert_eq!(found, of_file(files::NO_SUCH_FOLDER, "no-such-folder"));
        assert!(
            err.contains(&format!("[{}]", files::NO_SUCH_FOLDER)),
            "{err}"
        );
    }

    #[test]
    fn rows_without_their_text_have_a_line() {
        let error = tau::input_error::InputError::whole(files::UNKNOWN_POSE, "a/b.csv:7", "wrong");
        let value = of_input(&error.problems()[0]);
        assert_eq!(
            (&value["file"], &value["line"]),
            (&json!("a/b.csv"), &json!(7))
        );
    }

    #[test]
    fn usage_has_a_code_at_the_end_of_its_first_line() {
        let (code, _, err) = run(&["check", "--no-such-option"]);
        assert_eq!(code, crate::BAD_INPUT);
        let line = err.lines().next().unwrap();
        assert!(line.ends_with(&format!("[{}]", files::USAGE)), "{err}");
        let (code, out, _) = run(&["--help"]);
        assert_eq!(code, 0);
        assert!(!out.contains(&files::USAGE.to_string()), "{out}");
    }

    /// A robot file that holds errors would be read as the machine's.
    #[test]
    fn errors_take_no_name_of_a_measurement() {
        let folder = std::env::temp_dir().join(format!("tau-simulated-{}", std::process::id()));
        let json = folder.join("robot.toml");
        let [out, json] = [&folder, &json].map(|path| path.to_str().unwrap());
        let (code, _, err) = run(&["simulate", "--out", out, "--json", json]);
        assert_eq!(code, crate::BAD_INPUT);
        assert!(
            err.contains(&format!("[{}]", files::REPLACES_INPUT)),
            "{err}"
        );
        assert!(!folder.exists());
    }

    #[test]
    fn a_file_that_is_read_stays() {
        let folder = std::env::temp_dir().join(format!("tau-errors-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let [table, target] = ["tcp_poses.csv", "out.json"].map(|name| folder.join(name));
        std::fs::write(&table, "nothing\n").unwrap();
        let check = |json: &Path| {
            let [folder, json] = [&*folder, json].map(|path| path.to_str().unwrap());
            run(&["check", folder, "--json", json]).0
        };
        let codes = [check(&table), check(&target)];
        let texts = [&table, &target].map(|path| std::fs::read_to_string(path).unwrap());
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(codes, [crate::BAD_INPUT; 2]);
        assert_eq!(texts[0], "nothing\n");
        assert!(first(&texts[1])["code"].is_string(), "{}", texts[1]);
    }
}

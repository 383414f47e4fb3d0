//! `tau generate`.

use std::fs;
use std::path::Path;

use tau::input_error::InputError;
use tau_codegen::emit;
use tau_codegen::language;
use tau_codes::{files, remark};
use tau_report::shell_word;
use tau_robot::input_error::read;

use super::Failure;
use super::arguments;
use super::deliver::{Outcome, check_file};

pub(super) fn run(arguments: &arguments::Generate) -> Result<Outcome, Failure> {
    let source = &arguments.description;
    let name = source.display().to_string();
    let text = read(source, "the description of a robot (.tau)")?;
    let located = |errors| InputError::of_description(&name, &text, &errors);
    let tokens = language::tokens(&text).map_err(located)?;
    let model = language::check_tokens(tokens.clone()).map_err(located)?;
    let compiled = tau_codegen::compile(&model, &text);
    tau_codegen::check_names(&compiled, &tokens).map_err(located)?;
    let path = arguments
        .out
        .join(emit::snake_case(&model.name))
        .with_extension("rs");
    if !arguments.check {
        check_file(&path)?;
    }

    let [from, out] = [source, &arguments.out].map(|path| slashed(path));
    let command = format!(
        "tau generate {} --out {}",
        shell_word(&from),
        shell_word(&out)
    );
    let code = emit::file(&compiled, &one_line(&from), &one_line(&command));
    let current = fs::read_to_string(&path).ok();
    let is_fresh = current
        .as_deref()
        .is_some_and(|current| body(current) == body(&code));
    let path_name = path.display();
    match (is_fresh, arguments.check) {
        (true, _) => Ok(Outcome {
            summary: format!("{path_name} is what {name} gives\n"),
            ..Outcome::default()
        }),
        (false, true) => {
            let how = current.map_or("does not exist".to_owned(), |current| {
                format!("is stale from line {}", first_difference(&current, &code))
            });
            Err(Failure::Failed(remark!(files::STALE;
                "{path_name} {how}: run `{command}`")))
        }
        (false, false) => Ok(Outcome {
            summary: format!("written: {path_name}\n"),
            files: vec![(path, code)],
            ..Outcome::default()
        }),
    }
}

/// A path as it is typed on any system.
fn slashed(path: &Path) -> String {
    path.display().to_string().replace('\\', "/")
}

/// For a comment, which ends where the line does.
fn one_line(text: &str) -> String {
    text.replace(char::is_control, "?")
}

/// A file without its first line, which names the command that wrote it: another one, such as the same
/// from another folder, writes the same code.
fn body(text: &str) -> &str {
    text.split_once('\n').map_or("", |(_, body)| body)
}

/// Line, from 1, of the first difference after the first line.
fn first_difference(current: &str, expected: &str) -> usize {
    let same = |(a, b): &(&str, &str)| a == b;
    let equal = body(current).lines().zip(body(expected).lines());
    equal.take_while(same).count() + 2
}

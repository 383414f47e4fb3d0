//! Statements of the documentation, checked.

use std::fs;
use std::path::Path;

use tau::robot_file::RobotFile;
use tau_testkit::{Work, list, number};

use crate::codes::root;

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Blocks of code with their language, in order.
fn blocks(page: &str) -> Vec<(String, String)> {
    let text = read(page);
    let fenced = text.split("```").skip(1).step_by(2);
    let blocks = fenced.filter_map(|block| block.split_once('\n'));
    blocks
        .map(|(language, code)| (language.to_owned(), code.to_owned()))
        .collect()
}

fn blocks_in(page: &str, language: &str) -> Vec<String> {
    let all = blocks(page).into_iter();
    all.filter_map(|(own, code)| (own == language).then_some(code))
        .collect()
}

/// Pages in some folders.
fn pages(folders: &[&str]) -> Vec<String> {
    let entries = folders.iter().flat_map(|folder| {
        let entries = fs::read_dir(root().join(folder)).unwrap();
        entries.map(|entry| Path::new(folder).join(entry.unwrap().file_name()))
    });
    let pages = entries.filter(|page| page.extension().is_some_and(|end| end == "md"));
    pages.map(|page| page.display().to_string()).collect()
}

#[test]
fn descriptions_in_the_readme_compile() {
    let blocks = blocks_in("README.md", "tau");
    assert!(!blocks.is_empty());
    for block in blocks {
        tau::Robot::from_text(&block).unwrap_or_else(|errors| panic!("{errors:?}\n{block}"));
    }
}

#[test]
fn table_of_the_readme_is_what_the_study_prints() {
    let work = Work::empty();
    let printed = work.run("study --no-discover --out DIR/study").done();
    let table = &blocks_in("README.md", "text")[0];
    assert!(
        printed.contains(table),
        "README shows\n{table}\nprinted\n{printed}"
    );
}

#[test]
fn constants_of_discovery_are_those_of_the_page() {
    let page = read("docs/discovery-benchmark.md");
    let (_, page) = page.split_once("## Constants").unwrap();
    let table = tau::discovery::Constants::default().table();
    let row = |(name, value, reason): &(&str, f64, &str)| {
        format!("| `{name}` | {value:?} | {} |", reason.trim())
    };
    let rows: Vec<String> = table.iter().map(row).collect();
    let shown: Vec<&str> = page
        .lines()
        .filter(|line| line.starts_with("| `"))
        .collect();
    assert_eq!(shown, rows);
}

#[test]
fn links_lead_somewhere() {
    for page in pages(&["", "docs", "benches/results"]) {
        let text = read(&page);
        let targets = text
            .split("](")
            .skip(1)
            .filter_map(|rest| rest.split([')', '#']).next());
        for target in targets.filter(|target| !target.is_empty() && !target.starts_with("http")) {
            let file = root().join(&page).parent().unwrap().join(target);
            assert!(file.exists(), "{page} links to {target}");
        }
    }
}

/// What `.ci/run` tests is what the README and the page for contributors name, beside the plain tier alone.
#[test]
fn test_commands_of_the_pages_are_those_that_must_pass() {
    let script = read(".ci/run");
    let run: Vec<&str> = script
        .lines()
        .filter(|line| line.starts_with("cargo test"))
        .collect();
    assert!(run.iter().any(|line| line.contains("slow")), "{run:?}");
    for page in ["README.md", "CONTRIBUTING.md"] {
        let shown: String = blocks_in(page, "sh").concat();
        let is_shown = |line: &&str| {
            shown
                .lines()
                .any(|own| own.split('#').next().unwrap().trim() == *line)
        };
        assert!(run.iter().all(is_shown), "{page}: {run:?}");
        assert!(is_shown(&"cargo test"), "{page}");
    }
}

/// Options and arguments of every command exist: with `--help` behind them they are read, and not obeyed.
#[test]
fn commands_of_the_pages_are_read() {
    let mut commands = 0;
    for page in pages(&["", "docs"]) {
        for text in blocks_in(&page, "sh") {
            for line in text.lines() {
                let line = line.split(" #").next().unwrap();
                let line = ["tau ", "cargo run --release -- "]
                    .iter()
                    .find_map(|start| line.strip_prefix(start));
                let Some(line) = line else { continue };
                let (code, _, err) = run(&format!("tau {line} --help"), |word| word);
                assert_eq!(code, 0, "{page}: {line}: {err}");
                commands += 1;
            }
        }
    }
    assert!(commands > 20, "{commands}");
}

#[test]
fn robot_file_of_the_documentation_is_read() {
    let texts = blocks_in("docs/files.md", "toml");
    let [measuring, text] = &texts[..] else {
        panic!("{} blocks", texts.len());
    };
    let file = RobotFile::parse(text, "robot.toml").unwrap();
    assert_eq!(file.links["l1"].length.as_ref().unwrap().value, [2.04399]);
    // Sections of other measurements may stand in the same file.
    let with_more = format!("robot = \"GantryTau\"\n{measuring}");
    let file = RobotFile::parse(&with_more, "robot.toml").unwrap();
    assert_eq!(file.measuring.balls["first"].value, [0.1, 0.0, -0.7]);
}

/// Runs a line, of which words in quotes are whole.
fn run(line: &str, place: impl Fn(String) -> String) -> (u8, String, String) {
    let words = line
        .split('\'')
        .enumerate()
        .flat_map(|(index, piece)| match index % 2 {
            0 => piece.split_whitespace().map(str::to_owned).collect(),
            _ => vec![piece.to_owned()],
        });
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let code = tau_cli::run(words.map(|word| place(word).into()), &mut out, &mut err);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (code, text(out), text(err))
}

/// Text as one line, so that it does not matter where lines are broken.
fn flowing(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The tutorial from its first to its last command, in an empty folder; what it says is printed.
#[test]
fn the_tutorial_does_what_it_says() {
    let work = Work::empty();
    let folder = format!("{}/", work.path().display());
    let names = [
        "delta.tau",
        "robot.toml",
        "measured",
        "calibrated",
        "found",
        "path.csv",
        "commands.csv",
    ];
    let place = |word: String| {
        let is_file = names.contains(&word.split('/').next().unwrap());
        if is_file {
            format!("{folder}{word}")
        } else {
            word
        }
    };
    let mut said = None;
    let mut commands = 0;
    for (language, text) in blocks("docs/tutorial.md") {
        match language.as_str() {
            "tau" => _ = work.write("delta.tau", text),
            "csv" => _ = work.write("path.csv", text),
            // For the Cargo.toml of a program.
            "toml" if text.starts_with("[profile") => {}
            "toml" => {
                let mut file = work.read("robot.toml");
                for line in text.lines() {
                    let (key, _) = line.split_once(" = ").unwrap();
                    let blank = format!("{key} = \"?\"");
                    assert!(file.contains(&blank), "{blank} in {file}");
                    file = file.replace(&blank, line);
                }
                work.write("robot.toml", file);
            }
            "sh" => {
                let out = if text.starts_with("tau init") {
                    " --out robot.toml"
                } else {
                    ""
                };
                let (code, out, err) = run(&format!("{}{out}", text.trim()), place);
                assert_eq!(code, 0, "{text}{err}");
                said = Some(flowing(&out.replace(&folder, "")));
                commands += 1;
            }
            // The sketch comes before the first command.
            "text" => {
                let Some(said) = &said else { continue };
                for line in text.lines().map(flowing) {
                    assert!(said.contains(&line), "`{line}` in {said}");
                }
            }
            other => panic!("{other}"),
        }
    }
    assert_eq!(commands, 9);
    let commands = work.table("commands.csv");
    let q = commands.numbers("q2_m");
    assert!((1e6 * (q[1] - q[0]).abs() - 80.0).abs() < 1.0, "{q:?}");
    assert_eq!(commands.numbers("inside"), [1.0, 1.0, 0.0]);
    let sigma = commands.numbers("sigma_x_m");
    assert!(sigma[0] < 3e-6 && sigma[2] > 3.0 * sigma[0], "{sigma:?}");
}

/// The printer can be simulated as it stands, about its reference.
#[test]
fn the_printer_of_the_language_stands_where_it_says() {
    let all = blocks_in("docs/language.md", "tau");
    let printer = all.iter().find(|block| block.contains("robot Printer"));
    let work = Work::empty();
    work.write("printer.tau", printer.unwrap());
    let line = "simulate --model DIR/printer.tau --poses 20 --out MEASURED";
    work.run(line).done();
    // Carriages stand at endstop + √(arm² − radius²) − q, and the tool below them by that root.
    let found = work
        .json("kinematics forward --model DIR/printer.tau --variant Full --commands 0.2,0.2,0.2");
    let position = list(&found["poses"][0]["position_m"]).iter().map(number);
    for (value, expected) in position.zip([0.0, 0.0, 0.3 - 0.2]) {
        assert!((value - expected).abs() < 1e-9, "{value} {expected}");
    }
}

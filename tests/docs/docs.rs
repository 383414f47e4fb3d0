//! Statements of the documentation, checked.

use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("the workspace's root")
}

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Blocks of code in a language, without their fences.
fn blocks(text: &str, language: &str) -> Vec<String> {
    let fence = format!("```{language}\n");
    text.split(&fence)
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap_or("").to_owned())
        .collect()
}

#[test]
fn descriptions_in_the_readme_compile() {
    let blocks = blocks(&read("README.md"), "tau");
    assert!(!blocks.is_empty());
    for block in blocks {
        tau::Robot::from_text(&block).unwrap_or_else(|errors| panic!("{errors:?}\n{block}"));
    }
}

#[test]
fn table_of_the_readme_is_what_the_study_prints() {
    let robot = tau::Robot::from(&tau_generated::gantry_tau::ROBOT);
    let session = tau::Session::open_with_robot(robot, tau::Files::prototype()).unwrap();
    let study = tau::study::run(&session, &mut |_| {}).unwrap();
    let printed = tau_report::terminal::study(&study, 100);
    let table = &blocks(&read("README.md"), "text")[0];
    assert!(
        printed.contains(table.as_str()),
        "README shows\n{table}\nprinted\n{printed}"
    );
}

#[test]
fn operation_counts_of_the_readme_are_those_of_the_generated_code() {
    let generated = read("generated/src/models/gantry_tau.rs");
    assert!(generated.contains("//   full::closure: 25 / 34 / 56\n"));
    assert!(read("README.md").contains("takes 56 operations per iteration, after 25 that"));
}

/// The page of the benchmark shows the table of constants, and there are few.
#[test]
fn constants_of_discovery_are_those_of_the_page() {
    let page = read("docs/discovery-benchmark.md");
    let (_, page) = page.split_once("## Constants").unwrap();
    let table = tau::discovery::Constants::default().table();
    let rows: Vec<String> = (table.iter())
        .map(|(name, value, reason)| format!("| `{name}` | {value:?} | {} |", reason.trim()))
        .collect();
    let shown: Vec<&str> = page
        .lines()
        .filter(|line| line.starts_with("| `"))
        .collect();
    assert_eq!(shown, rows);
    assert!(rows.len() <= 25, "{}", rows.len());
}

#[test]
fn links_lead_somewhere() {
    let pages: Vec<PathBuf> = ["", "docs", "benches/results"]
        .iter()
        .flat_map(|folder| {
            let entries = std::fs::read_dir(root().join(folder)).unwrap();
            entries.map(|entry| Path::new(folder).join(entry.unwrap().file_name()))
        })
        .filter(|page| page.extension().is_some_and(|end| end == "md"))
        .collect();
    assert!(pages.len() > 16, "{pages:?}");
    for page in &pages {
        let text = read(page);
        let folder = page.parent().unwrap();
        for target in text
            .split("](")
            .skip(1)
            .filter_map(|rest| rest.split(')').next())
        {
            if target.starts_with("http") || target.starts_with('#') {
                continue;
            }
            let file = target.split('#').next().unwrap();
            assert!(
                root().join(folder).join(file).exists(),
                "{} links to {target}",
                page.display()
            );
        }
    }
}

#[test]
fn robot_file_of_the_documentation_is_read() {
    let texts = blocks(&read("docs/files.md"), "toml");
    let [measuring, text] = &texts[..] else {
        panic!("{} blocks", texts.len());
    };
    let file = tau::robot_file::RobotFile::parse(text, "robot.toml").unwrap();
    assert_eq!(file.links["l1"].length.as_ref().unwrap().value, [2.04399]);
    // Sections of other measurements may stand in the same file.
    let with_more = format!("robot = \"GantryTau\"\n{measuring}");
    let file = tau::robot_file::RobotFile::parse(&with_more, "robot.toml").unwrap();
    assert_eq!(file.measuring.balls["first"].value, [0.1, 0.0, -0.7]);
}

/// Blocks of code with their language, in order.
fn all_blocks(text: &str) -> Vec<(&str, &str)> {
    let fenced = text.split("```").skip(1).step_by(2);
    fenced.filter_map(|block| block.split_once('\n')).collect()
}

/// Words of a line, quoted ones whole.
fn words(line: &str) -> Vec<String> {
    let pieces = line.split('\'').enumerate();
    let split = pieces.flat_map(|(index, piece)| match index % 2 {
        0 => piece.split_whitespace().map(str::to_owned).collect(),
        _ => vec![piece.to_owned()],
    });
    split.collect()
}

/// Text as one line, so that it does not matter where lines are broken.
fn flowing(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The tutorial from its first to its last command, in an empty folder; what it says is printed.
#[test]
fn the_tutorial_does_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let page = read("docs/tutorial.md");
    let mut said = None;
    let mut commands = 0;
    for (language, text) in all_blocks(&page) {
        match language {
            "tau" => fs::write(path("delta.tau"), text).unwrap(),
            "csv" => fs::write(path("path.csv"), text).unwrap(),
            "toml" => {
                let mut file = fs::read_to_string(path("robot.toml")).unwrap();
                for line in text.lines() {
                    let (key, _) = line.split_once(" = ").unwrap();
                    let blank = format!("{key} = \"?\"");
                    assert!(file.contains(&blank), "{blank} in {file}");
                    file = file.replace(&blank, line);
                }
                fs::write(path("robot.toml"), file).unwrap();
            }
            "sh" => {
                let names = [
                    "delta.tau",
                    "robot.toml",
                    "measured",
                    "calibrated",
                    "found",
                    "path.csv",
                    "commands.csv",
                ];
                let mut line = words(text);
                for word in line.iter_mut().skip(1) {
                    if names.contains(&word.split('/').next().unwrap()) {
                        *word = path(word);
                    }
                }
                if line[1] == "init" {
                    line.extend(["--out".to_owned(), path("robot.toml")]);
                }
                let (mut out, mut err) = (Vec::new(), Vec::new());
                let code = tau_cli::run(line.into_iter().map(Into::into), &mut out, &mut err);
                let err = String::from_utf8(err).unwrap();
                assert_eq!(code, 0, "{text}{err}");
                let out = String::from_utf8(out).unwrap();
                said = Some(flowing(
                    &out.replace(&format!("{}/", folder.path().display()), ""),
                ));
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
    let csv = fs::read_to_string(path("commands.csv")).unwrap();
    let column = |name: &str| -> Vec<f64> {
        let mut rows = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let place = rows
            .next()
            .unwrap()
            .iter()
            .position(|own| *own == name)
            .unwrap();
        rows.map(|row| row[place].parse().unwrap()).collect()
    };
    let q = column("q2_m");
    assert!((1e6 * (q[1] - q[0]).abs() - 80.0).abs() < 0.1, "{q:?}");
    assert_eq!(column("inside"), [1.0, 1.0, 0.0]);
    let sigma = column("sigma_x_m");
    assert!(sigma[0] < 3e-6 && sigma[2] > 3.0 * sigma[0], "{sigma:?}");
}

/// The printer can be simulated as it stands, about its reference.
#[test]
fn the_printer_of_the_language_stands_where_it_says() {
    let all = blocks(&read("docs/language.md"), "tau");
    let printer = all.iter().find(|block| block.contains("robot Printer"));
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("printer.tau"), printer.unwrap()).unwrap();
    let line = "tau simulate --model DIR/printer.tau --poses 20 --out DIR/m";
    crate::support::tau_in(folder.path(), line).done();
    // Carriages stand at endstop + √(arm² − radius²) − q, and the tool below them by that root.
    let line = "tau kinematics forward --model DIR/printer.tau --variant Full --commands 0.2,0.2,0.2 --json -";
    let found = crate::support::tau_in(folder.path(), line).json();
    for (axis, expected) in [0.0, 0.0, 0.3 - 0.2].into_iter().enumerate() {
        let value = found["poses"][0]["position_m"][axis].as_f64().unwrap();
        assert!((value - expected).abs() < 1e-9, "{axis}: {value}");
    }
}

//! Statements of the documentation, checked.

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
    let printed = tau_report::terminal::study(&study);
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
    let text = &blocks(&read("docs/files.md"), "toml")[0];
    let file = tau::robot_file::RobotFile::parse(text, "robot.toml").unwrap();
    assert_eq!(file.links["l1"].length.as_ref().unwrap().value, [2.04399]);
}

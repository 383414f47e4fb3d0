//! Commands agree: `check`, `calibrate`, `study`, `discover` and `evaluate` of the calibrated file, on one clean folder of each
//! standard robot, with one variant and `--split all`.
//!
//! Where they differ today, [`DIFFERENCES`] lists it with its reason; the test fails where another difference comes, and
//! where a listed one is gone.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use tau_testkit::{Table, Work, list};

/// The fit that all others are compared with.
const REFERENCE: &str = "calibrate";
/// Differences below this share of χ² and of degrees of freedom, and below this share of the standard deviation of a
/// parameter, are rounding: other orders of the same sums, and minima that iterations reach from other starts.
const ROUNDING: f64 = 1e-3;
/// Differences that a single fit for all commands would end.
const DIFFERENCES: &[Difference] = &[
    Difference {
        command: "check",
        quantities: &["χ²", "degrees of freedom", "parameters", "outliers"],
        of: |_| true,
        reason: "a first fit is judged by its misfit alone, and none of its figures are stated",
    },
    Difference {
        command: "evaluate",
        quantities: &["χ²"],
        of: |robot| robot == "servo_hexapod",
        reason: "closures are whitened where the file puts the machine, those of calibrate near there",
    },
];

/// A difference that is known: the command, what differs, of which robots, and why.
struct Difference {
    command: &'static str,
    quantities: &'static [&'static str],
    of: fn(&str) -> bool,
    reason: &'static str,
}

/// What a command says of a folder. What it does not say is absent.
#[derive(Debug, Default)]
struct Answer {
    status: Option<String>,
    chi2: Option<f64>,
    dof: Option<f64>,
    /// Values and standard deviations; these are not a number where only the values are known.
    parameters: Option<BTreeMap<String, (f64, f64)>>,
    /// What is left out or far off: file and pose.
    outliers: Option<BTreeSet<String>>,
}

impl Answer {
    /// What `fit` and the parameters beside it say.
    fn of_fit(of: &Value) -> Self {
        let fit = &of["fit"];
        let outlier = |own: &Value| format!("{} {}", own["file"], own["pose"]);
        let far = ["gross_rows", "gross_poses"].map(|key| &of[key]);
        let far = far.into_iter().filter_map(Value::as_array).flatten();
        Self {
            status: fit["status"].as_str().map(str::to_owned),
            chi2: fit["chi2"].as_f64(),
            dof: fit["dof"].as_f64(),
            parameters: of["parameters"].as_array().map(|all| values(all)),
            outliers: fit["outliers"]
                .as_array()
                .map(|all| all.iter().chain(far).map(outlier).collect()),
        }
    }

    /// What differs from the reference.
    fn differences(&self, reference: &Self) -> Vec<&'static str> {
        let differ = |one: Option<f64>, other: Option<f64>| match (one, other) {
            (Some(one), Some(other)) => (one - other).abs() > ROUNDING * other.abs(),
            (one, other) => one.is_some() != other.is_some(),
        };
        let names = |of: &Self| -> Option<Vec<String>> {
            let all = of.parameters.as_ref()?;
            Some(all.keys().cloned().collect())
        };
        let all = reference.parameters.iter().flatten();
        let values_differ = names(self) != names(reference)
            || all.into_iter().any(|(name, (value, sigma))| {
                let own = self.parameters.as_ref().map_or(f64::NAN, |own| own[name].0);
                (own - value).abs() > ROUNDING * sigma
            });
        let found = [
            ("verdict", self.status != reference.status),
            ("χ²", differ(self.chi2, reference.chi2)),
            ("degrees of freedom", differ(self.dof, reference.dof)),
            ("parameters", values_differ),
            ("outliers", self.outliers != reference.outliers),
        ];
        found
            .into_iter()
            .filter_map(|(quantity, differs)| differs.then_some(quantity))
            .collect()
    }
}

fn values(parameters: &[Value]) -> BTreeMap<String, (f64, f64)> {
    let value = |own: &Value| {
        let name = own["name"].as_str()?.to_owned();
        Some((name, (own["value"].as_f64()?, own["sigma"].as_f64()?)))
    };
    parameters.iter().filter_map(value).collect()
}

/// Answers of a study and of a calibration of the same files: where carts were measured, of poses alone, as in the paper.
fn answers_of_study(work: &Work, robot: &str) -> [Answer; 2] {
    let has_carts = work.path().join("measured/cart_poses.csv").exists();
    let files = if has_carts {
        "--files tcp_poses.csv"
    } else {
        ""
    };
    let with = format!("--model {robot} --split all {files} --json -");
    let json = |line: &str| work.run(&format!("{line} {with}")).printed();
    let calibrated = json("calibrate MEASURED --variant Full --out DIR/of-study");
    let study = json("study MEASURED --no-discover --out DIR/study");
    [&calibrated, &study["variants"]["Full"]].map(Answer::of_fit)
}

/// What each command says of a clean folder of a robot.
fn answers(work: &Work, robot: &str) -> Vec<(&'static str, Answer)> {
    let with = format!("--model {robot} --split all --json -");
    let json = |line: &str| work.run(&format!("{line} {with}")).printed();
    let calibrated = Answer::of_fit(&json(
        "calibrate MEASURED --variant Full --out DIR/calibrated",
    ));
    let checked = json("check MEASURED --variant Full");
    let is_fine = list(&checked["mistakes"]).is_empty() && checked["misfit"].is_null();
    let of_check = Answer {
        status: is_fine.then(|| "consistent".to_owned()),
        ..Answer::default()
    };
    let found = json("discover MEASURED --base Full --out DIR/discovered");
    let table = Table::parse(&work.read("discovered/parameters.csv"));
    let names = table.cells("parameter").into_iter().map(str::to_owned);
    let values = ["value", "sigma"].map(|column| table.numbers(column));
    let values = values[0].iter().copied().zip(values[1].iter().copied());
    let of_discovery = Answer {
        status: (found["status"] == "nothing_missing").then(|| "consistent".to_owned()),
        parameters: Some(names.zip(values).collect()),
        ..Answer::of_fit(&found)
    };
    let line = "evaluate MEASURED --variant Full --robot DIR/calibrated/robot.toml";
    let evaluated = Answer {
        parameters: calibrated.parameters.clone(),
        ..Answer::of_fit(&json(line))
    };
    vec![
        (REFERENCE, calibrated),
        ("check", of_check),
        ("discover", of_discovery),
        ("evaluate", evaluated),
    ]
}

#[test]
fn commands_agree_on_clean_folders() {
    let mut found: BTreeMap<(&str, &str), BTreeSet<&str>> = BTreeMap::new();
    for (robot, _) in tau_generated::ROBOTS {
        let work = Work::simulated(&format!("--model {robot} --variant Full --seed 1"));
        let all = answers(&work, robot);
        let (_, reference) = &all[0];
        assert_eq!(reference.status.as_deref(), Some("consistent"), "{robot}");
        for (command, answer) in &all[1..] {
            for quantity in answer.differences(reference) {
                found.entry((command, quantity)).or_default().insert(robot);
            }
        }
        let [reference, study] = answers_of_study(&work, robot);
        for quantity in study.differences(&reference) {
            found.entry(("study", quantity)).or_default().insert(robot);
        }
    }
    let mut listed: BTreeMap<_, BTreeSet<_>> = BTreeMap::new();
    for known in DIFFERENCES {
        assert!(!known.reason.is_empty());
        for quantity in known.quantities {
            let robots = listed.entry((known.command, *quantity)).or_default();
            let names = tau_generated::ROBOTS.iter().map(|(robot, _)| *robot);
            robots.extend(names.filter(|robot| (known.of)(robot)));
        }
    }
    assert_eq!(found, listed);
}

//! A session answers as the commands do, and looks at what is handed to it in memory.

use std::fmt::Debug;

use tau::measurements::{Folder, Split};
use tau::robot_file::RobotFile;
use tau::{Calibrated, Error, Files, InputError, Robot, Session};
use tau_codes::{Code, fit};
use tau_generated::gantry_tau::GantryTau;
use tau_generated::hexapod::Hexapod;
use tau_testkit::{GANTRY, Work, estimate, number, show};

/// The session's answer must be a mistake, and the command must print the same.
#[track_caller]
fn same_answer<T>(work: &Work, command: &str, opened: Result<T, InputError>) {
    let error = opened.err().expect("a mistake").render(false);
    let ran = work.run(command);
    assert_eq!(ran.code, 2, "{command}");
    let error = error.replace(&work.path().display().to_string(), "DIR");
    assert_eq!(ran.err.trim_end(), error, "{command}");
}

#[test]
fn mistakes_in_measurements_and_parameters() {
    let work = Work::prototype();
    work.edit("tcp_poses.csv", |table| table.set(1, "x_m", "abc"));
    work.replace("length_m", "lenght_m");
    let open = || Session::<GantryTau>::open(work.measured());
    let found = open().unwrap_err();
    let files = ["tcp_poses.csv", "robot.toml"];
    let is_named = |file: &&str| {
        found
            .problems()
            .iter()
            .any(|own| own.source.ends_with(*file))
    };
    assert!(files.iter().all(is_named), "{found}");
    let evaluate = "--model gantry_tau --variant Full";
    same_answer(&work, &format!("evaluate MEASURED {evaluate}"), open());
    work.remove("measured/robot.toml");
    same_answer(&work, &format!("evaluate MEASURED {evaluate}"), open());
    same_answer(
        &work,
        &format!("evaluate --robot MEASURED/robot.toml {evaluate}"),
        Session::<GantryTau>::open(
            Files::prototype().robot_file(work.measured().join("robot.toml")),
        ),
    );
    same_answer(
        &work,
        &format!("evaluate DIR/nowhere {evaluate}"),
        Session::<GantryTau>::open(work.path().join("nowhere")),
    );
}

#[test]
fn mistakes_in_descriptions_catalogues_and_splits() {
    let work = Work::empty();
    let [description, own] = ["robot.tau", "own.tau"].map(|name| work.path().join(name));
    let text = std::fs::read_to_string(GANTRY).unwrap();
    let read = || Robot::read(&description);
    let evaluate = "evaluate --model DIR/robot.tau --variant Full";
    same_answer(&work, evaluate, read());
    work.write("robot.tau", text.replacen("arm full", "arm fall", 1));
    same_answer(&work, evaluate, read());

    let session = Session::<GantryTau>::open(Files::prototype()).unwrap();
    for mistaken in [
        "effect dent on cart { param }",
        "effect unnamed_1 on cart {",
    ] {
        work.write("own.tau", mistaken);
        let line = "discover --effects DIR/own.tau --out DIR/out";
        same_answer(&work, line, session.catalogues(&[&own]));
    }
    let session = session.split("first:500".parse().unwrap());
    let line = "evaluate --split first:500 --variant Full";
    same_answer(&work, line, session.poses());
}

/// The code of a refusal, and what it says.
#[track_caller]
fn refusal<T>(answer: Result<T, impl Into<Error> + Debug>) -> (String, String) {
    let error = answer.err().expect("a refusal").into();
    (error.code().to_string(), error.to_string())
}

#[track_caller]
fn refused<T>(code: Code, answer: Result<T, impl Into<Error> + Debug>) -> String {
    let (found, said) = refusal(answer);
    assert_eq!(found, code.to_string(), "{said}");
    said
}

/// A verdict is of the measurements that were fitted, and of poses that there are.
#[test]
fn verdicts_are_of_what_was_fitted() {
    let session = Session::<GantryTau>::open(Files::prototype()).unwrap();
    let found = session.calibrate(GantryTau::NOMINAL).unwrap();
    session.verdict(&found).unwrap();
    for split in [Split::All, Split::First(60)] {
        let other = session.clone().split(split);
        refused(fit::OTHER_CALIBRATION, other.verdict(&found));
    }
    let mut folder = session.folder().clone();
    for pose in &mut folder.tcp_poses {
        pose.position_m[0] += 1e-6;
    }
    let moved = Session::<GantryTau>::of(folder, session.robot_file().clone());
    let said = refused(fit::OTHER_CALIBRATION, moved.verdict(&found));
    show("T338", &said);

    let machine = session.machine(GantryTau::NOMINAL).unwrap();
    let said = [vec![], vec![0, 100_000]].map(|poses| {
        let answer = session.verdict_on_prediction(&machine, poses);
        refused(fit::NO_POSES, answer)
    });
    show("T331", &said.join("\n"));
}

/// Numbers that no file can hold are refused in memory, too.
#[test]
fn measurements_in_memory_are_looked_at() {
    let session = Session::<GantryTau>::open(Files::prototype()).unwrap();
    let spoilt = |spoil: &dyn Fn(&mut Folder, &mut RobotFile)| {
        let (mut folder, mut file) = (session.folder().clone(), session.robot_file().clone());
        spoil(&mut folder, &mut file);
        let session = Session::<GantryTau>::of(folder, file);
        let told = refusal(session.calibrate(GantryTau::NOMINAL));
        assert_eq!(refusal(session.check(None)), told);
        told
    };
    let short = spoilt(&|folder, _| folder.tcp_poses[3].commands_m.clear());
    let endless = spoilt(&|folder, _| folder.tcp_poses[3].position_m[1] = f64::INFINITY);
    let turned = spoilt(&|folder, _| folder.tcp_poses[3].directions = Some(vec![1.0, 7.0, -1.0]));
    let negative = spoilt(&|_, file| file.noise.position_m = -1e-5);
    let tolerance = |tol: f64| {
        spoilt(&|_, file| {
            let length = file.links.get_mut("l1").and_then(|own| own.length.as_mut());
            length.unwrap().tol = tol;
        })
    };
    let [none, less, unknown] = [0.0, -3e-4, f64::NAN].map(tolerance);
    let link = spoilt(&|_, file| {
        let values = file.links["l1"].clone();
        file.links.insert("l7".to_owned(), values);
    });
    let all = [
        &short, &endless, &turned, &negative, &none, &less, &unknown, &link,
    ];
    let codes = all.map(|told| told.0.as_str());
    let expected = [
        "T355", "T355", "T223", "T223", "T223", "T223", "T217", "T248",
    ];
    assert_eq!(codes, expected);
    show("T355", &[short.1, endless.1].join("\n"));
}

/// The file of a calibration is the one that the command writes, and the record in it is of this calibration, also where the
/// file that it started from has one.
#[test]
fn files_of_a_session_are_those_of_the_command() {
    let work = Work::prototype();
    let session = Session::<GantryTau>::open(work.measured()).unwrap();
    let options = session.options();
    let with_options = session.calibrate_with(GantryTau::BEST_PER_LINK, &options);
    let written = |out: &str, more: &str, found: Calibrated<GantryTau>| {
        work.run(&format!("calibrate MEASURED --out DIR/{out} {more}"))
            .done();
        let written = work.read(&format!("{out}/robot.toml"));
        assert_eq!(written, found.file.to_toml(), "{more}");
        let record = found.file.calibration.clone().unwrap();
        let verdict = found.verdict().unwrap();
        assert_eq!(record.widening.to_bits(), verdict.widening().to_bits());
        (record.variant, record.split)
    };
    written("best", "--variant BestPerLink", with_options.unwrap());
    let found = session.calibrate(GantryTau::FULL).unwrap();
    written("out", "--variant Full", found);
    let again = Files::from(&work.measured()).robot_file(work.path().join("out/robot.toml"));
    let again = Session::<GantryTau>::open(again).unwrap();
    let again = again.split(Split::First(60)).calibrate("Nominal").unwrap();
    let line = "--robot DIR/out/robot.toml --split first:60 --variant Nominal";
    let record = written("again", line, again);
    assert_eq!(record, ("Nominal".to_owned(), Split::First(60)));
}

/// Noise of the drives is in a calibration, whichever way it is asked for.
#[test]
fn drives_with_noise_calibrate_with_it() {
    let work = Work::simulated("--model hexapod --random --poses 40 --seed 5 --noise-drives 2e-4");
    let session = Session::<Hexapod>::open(work.measured()).unwrap();
    let found = session.calibrate(Hexapod::FULL).unwrap();
    let told = work.calibrated("--model hexapod --variant Full");
    assert_eq!(work.read("out/robot.toml"), found.file.to_toml());
    for own in &found.parameters {
        let sigma = number(&estimate(&told, &own.name)["sigma"]);
        assert!((sigma / own.sigma - 1.0).abs() < 1e-12, "{}", own.name);
    }
    let said = refused(fit::NEEDS_MEASURED_POSES, session.verdict(&found));
    show("T352", said.rsplit('/').next().unwrap());
}

//! Outliers, robust losses and repeated readings: standard deviations that hold the truth, on machines of which it is known.

use std::fs;

use serde_json::Value;
use tau::Robot;
use tau::calibration::{Calibration, Options, calibrate};
use tau::measurements::{Folder, Poses, Split};
use tau::robot::Owner;
use tau::robot_file::RobotFile;
use tau::simulation::{Noise, Poses as Planned, SimulatedFolder, Simulation, simulate};
use tau::weighing::{Loss, Treatment};

use crate::support::{ROBOTS, gantry_tau, number, prototype, spoil, tau_in};
use tau::Setup;

/// Machines of each case.
const MACHINES: u64 = 16;

/// A linear delta of rods, with a tracker's noise.
fn delta() -> (Robot, RobotFile) {
    let text = fs::read_to_string(format!("{ROBOTS}/linear_delta.tau")).unwrap();
    let robot = Robot::from_text(&text).unwrap();
    let file = "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    let file = RobotFile::parse_for(file, "robot.toml", &robot).unwrap();
    (robot, file)
}

fn measured(seed: u64, change: impl FnOnce(&mut Simulation)) -> SimulatedFolder {
    let (robot, file) = delta();
    let mut simulation = Simulation {
        seed,
        random_poses: 0,
        poses: Planned::Random { count: 60 },
        ..Simulation::new(robot, file)
    };
    change(&mut simulation);
    simulate(&simulation).unwrap()
}

fn calibrated(folder: &Folder, poses: &[usize], treatment: Treatment) -> Calibration {
    let (robot, file) = delta();
    let options = Options {
        treatment,
        ..Options::default()
    };
    let variant = robot.variant("Full").unwrap();
    calibrate(Setup::new(&robot, variant, &file, folder), poses, &options).unwrap()
}

fn all(folder: &Folder) -> Vec<usize> {
    (0..folder.tcp_poses.len()).collect()
}

fn under(loss: Loss) -> Treatment {
    Treatment {
        loss: Some(loss),
        keep_outliers: false,
    }
}

const KEPT: Treatment = Treatment {
    loss: None,
    keep_outliers: true,
};

/// Errors of the calibrated lengths in standard deviations.
fn errors(found: &Calibration, simulated: &SimulatedFolder) -> Vec<f64> {
    let estimates = found.parameters.iter().zip(&found.used);
    estimates
        .filter_map(|(estimate, &index)| {
            let parameter = &found.machine.variant.parameters[index];
            let Owner::Link(link) = parameter.owner else {
                return None;
            };
            let truth = simulated.truth.machine.rods[link].length_m;
            (parameter.quantity == "length").then(|| (estimate.value - truth) / estimate.sigma)
        })
        .collect()
}

/// Number of lengths inside of their 95 % intervals, and of all, over machines.
fn inside(treatment: Treatment, change: impl Fn(&mut Simulation)) -> (usize, usize) {
    let of_machine = |seed: u64| {
        let simulated = measured(900 + seed, &change);
        let found = calibrated(&simulated.folder, &all(&simulated.folder), treatment);
        errors(&found, &simulated)
    };
    let errors: Vec<f64> = (0..MACHINES).flat_map(of_machine).collect();
    let inside = errors.iter().filter(|error| error.abs() < 1.96).count();
    (inside, errors.len())
}

/// Smallest count that so many intervals of 95 % show with a chance of a thousandth.
fn least(count: usize) -> usize {
    let (mut chance, mut sum) = (0.05_f64.powi(i32::try_from(count).unwrap()), 0.0);
    for inside in 0..count {
        sum += chance;
        if sum > 1e-3 {
            return inside;
        }
        chance *= 19.0 * (count - inside) as f64 / (inside + 1) as f64;
    }
    count
}

fn one_in_twenty(simulation: &mut Simulation) {
    simulation.noise.outliers = 0.05;
}

/// One command of a pose read wrongly moves other closures than a pose that was measured wrongly.
#[test]
fn a_misread_command_is_told_from_a_pose_far_off() {
    let off = |seed: u64| 3e-4 * if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut errors = vec![];
    let mut told = 0;
    for seed in 0..MACHINES {
        let mut simulated = measured(700 + seed, |_| {});
        let (pose, command) = (7 + seed as usize, seed as usize % 3);
        simulated.folder.tcp_poses[pose].commands_m[command] += off(seed);
        let found = calibrated(
            &simulated.folder,
            &all(&simulated.folder),
            Treatment::default(),
        );
        let number = simulated.folder.tcp_poses[pose].pose;
        let mut outliers = found.weighing.outliers.iter();
        let outlier = outliers.find(|outlier| outlier.pose == number).unwrap();
        if let Some(misread) = &outlier.misread {
            assert_eq!(misread.column, format!("q{}_m", command + 1), "{seed}");
            errors.push(misread.off - off(seed));
            told += 1;
        }
    }
    // Three closures are as near to one of three commands by chance in one pose of a hundred.
    assert!(told >= MACHINES - 4, "{told}");
    assert!(errors.iter().all(|error| error.abs() < 6e-5), "{errors:?}");

    let mut wrongly = 0;
    for seed in 0..MACHINES / 2 {
        let simulated = measured(800 + seed, one_in_twenty);
        let found = calibrated(
            &simulated.folder,
            &all(&simulated.folder),
            Treatment::default(),
        );
        let outliers = found.weighing.outliers.iter();
        wrongly += outliers.filter(|outlier| outlier.misread.is_some()).count();
    }
    // Of some 24 outliers a quarter of one is expected.
    assert!(wrongly <= 3, "{wrongly}");
}

#[test]
fn outliers_are_listed_and_left_out() {
    let simulated = measured(31, one_in_twenty);
    let folder = &simulated.folder;
    let found = calibrated(folder, &all(folder), Treatment::default());
    let listed: Vec<u32> = found.weighing.outliers.iter().map(|o| o.pose).collect();
    assert_eq!(listed, simulated.truth.outliers);
    assert!(
        found
            .weighing
            .outliers
            .iter()
            .all(tau::weighing::Outlier::is_left_out)
    );
    assert_eq!(found.poses, folder.tcp_poses.len() - listed.len());

    // The fit is that of the other poses.
    let others: Vec<usize> = all(folder)
        .into_iter()
        .filter(|&pose| !listed.contains(&folder.tcp_poses[pose].pose))
        .collect();
    let without = calibrated(folder, &others, KEPT);
    for (a, b) in found.parameters.iter().zip(&without.parameters) {
        assert!((a.value - b.value).abs() < 1e-3 * b.sigma, "{}", a.name);
        assert!((a.sigma / b.sigma - 1.0).abs() < 1e-3, "{}", a.name);
    }
    let kept = calibrated(folder, &all(folder), KEPT);
    let same = |a: &Calibration| {
        a.weighing
            .outliers
            .iter()
            .map(|o| o.pose)
            .collect::<Vec<_>>()
    };
    assert_eq!(same(&kept), listed);
    assert_eq!(kept.poses, folder.tcp_poses.len());
}

/// Kept, outliers make standard deviations lie; left out or under a loss, they hold the truth.
#[test]
fn intervals_hold_the_truth_among_outliers() {
    let (kept, count) = inside(KEPT, one_in_twenty);
    let least = least(count);
    assert!(
        kept < least,
        "{kept} of {count} where {least} are the least"
    );
    for treatment in [
        Treatment::default(),
        under(Loss::Huber),
        under(Loss::Cauchy),
        under(Loss::Tukey),
    ] {
        let (inside, count) = inside(treatment, one_in_twenty);
        assert!(inside >= least, "{inside} of {count} under {treatment:?}");
    }
}

/// At a hundredth a folder, four in this many would be a chance of a hundred-thousandth.
#[test]
fn clean_folders_lose_next_to_no_pose() {
    let lost = |seed: u64| {
        let folder = measured(1200 + seed, |_| ()).folder;
        let found = calibrated(&folder, &all(&folder), Treatment::default());
        found.weighing.outliers.len()
    };
    assert!((0..MACHINES).map(lost).sum::<usize>() < 4);
}

/// Larger noise and effects that the model lacks are no outliers.
#[test]
fn what_all_poses_share_is_no_outlier() {
    let simulated = measured(17, |simulation| simulation.noise.scale = [3.0; 3]);
    let found = calibrated(
        &simulated.folder,
        &all(&simulated.folder),
        Treatment::default(),
    );
    assert_eq!(found.weighing.outliers, []);
    let (robot, (folder, file)) = (gantry_tau(), prototype());
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
    for name in [
        "Nominal",
        "Piecewise",
        "Full",
        "FullPiecewise",
        "BestPerLink",
    ] {
        let (variant, options) = (robot.variant(name).unwrap(), Options::default());
        let poses = &poses.division.calibration;
        let found =
            calibrate(Setup::new(&robot, variant, &file, &folder), poses, &options).unwrap();
        assert_eq!(found.weighing.outliers, [], "{name}");
    }
}

/// Four readings at each of 25 poses: what they share has to count once.
#[test]
fn readings_of_a_pose_count_by_what_they_do_not_share() {
    let again = |visit: f64| {
        move |simulation: &mut Simulation| {
            simulation.poses = Planned::Random { count: 25 };
            simulation.readings = 4;
            simulation.noise = Noise {
                visit,
                ..Noise::default()
            };
        }
    };
    for visit in [0.0, 0.8] {
        let (inside, count) = inside(Treatment::default(), again(visit));
        assert!(inside >= least(count), "{inside} of {count} at {visit}");
        let simulated = measured(5, again(visit));
        let found = calibrated(
            &simulated.folder,
            &all(&simulated.folder),
            Treatment::default(),
        );
        let repeats = found.weighing.repeats.unwrap();
        assert_eq!(
            (repeats.visits, repeats.readings, repeats.degrees),
            (25, 100, 75)
        );
        // Of 225 degrees of freedom, six standard deviations of a standard deviation are 28 %.
        let own = (1.0 - visit).sqrt();
        assert!((repeats.position_m / (1e-5 * own) - 1.0).abs() < 0.28);
        assert!((repeats.rotation_rad.unwrap() / (4e-5 * own) - 1.0).abs() < 0.28);
        assert_eq!(
            repeats.lack_of_fit.p_value < 1e-3,
            visit > 0.0,
            "{repeats:?}"
        );
    }
}

/// From files to the screen and the JSON, both ways, and to the robot file.
#[test]
fn outliers_are_said_by_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --out DIR/measured --cart-poses 0 --outliers 0.06 --seed 9").done();
    let json = |out: &str| -> Value { serde_json::from_str(out).unwrap() };
    // They are not taken for a mistake.
    let check = json(&run("tau check DIR/measured --variant Full --json - -q").out);
    assert_eq!(check["mistakes"], Value::Array(vec![]), "{check:#}");
    let calibrate = "tau calibrate DIR/measured --variant Full --out DIR/calibrated";
    let said = run(calibrate).done();
    let found =
        json(&fs::read_to_string(folder.path().join("calibrated/statistics.json")).unwrap());
    let fit = &found["fit"];
    assert_eq!(fit["status"], "consistent");
    let outliers = fit["outliers"].as_array().unwrap();
    assert!(!outliers.is_empty());
    let truth = json(&fs::read_to_string(folder.path().join("measured/truth.json")).unwrap());
    let true_ones = truth["outliers"].as_array().unwrap();
    for outlier in outliers {
        assert!(true_ones.contains(&outlier["pose"]), "{outlier}");
        assert_eq!(outlier["file"], "tcp_poses.csv");
        assert_eq!(outlier["left_out"], true);
        assert!(said.contains(&outlier["pose"].to_string()), "{said}");
    }
    assert!(said.contains("as outliers"), "{said}");

    let huber = json(&run(&format!("{calibrate} --loss huber --json - -q")).out);
    assert_eq!(huber["fit"]["loss"], "huber");
    let less_weighed = huber["fit"]["outliers"].as_array().unwrap();
    assert!(!less_weighed.is_empty());
    for outlier in less_weighed {
        let weight = number(&outlier["weight"]);
        assert!(weight > 0.0 && weight < 0.5, "{outlier}");
    }
    assert!(said.contains("Without the outliers among them"), "{said}");
    let kept = json(&run(&format!("{calibrate} --keep-outliers --force --json - -q")).out);
    assert_eq!(kept["fit"]["status"], "inconsistent");
    assert_eq!(kept["fit"]["outliers"][0]["left_out"], false);

    let evaluate =
        "tau evaluate DIR/measured --variant Full --robot DIR/calibrated/robot.toml --json - -q";
    run(calibrate).done();
    let evaluated = json(&run(evaluate).out);
    assert_eq!(evaluated["fit"]["status"], "consistent");
    let missed: Vec<&Value> = (evaluated["fit"]["outliers"].as_array().unwrap().iter())
        .map(|outlier| &outlier["pose"])
        .collect();
    assert!(!missed.is_empty() && missed.iter().all(|pose| true_ones.contains(pose)));
    let largest = |key: &str| number(&evaluated[key]["max"]);
    assert!(largest("position_um_without_outliers") < 0.5 * largest("position_um"));
    assert_eq!(
        found["position_um_without_outliers"],
        evaluated["position_um_without_outliers"]
    );

    let both = run(&format!("{calibrate} --loss huber --keep-outliers"));
    assert_eq!(both.code, 2);
}

/// Command of a leg that was misread by more than the machine has room for, at a pose that validates.
#[test]
fn a_pose_that_cannot_be_predicted_is_named_and_the_others_are() {
    let directory = tempfile::tempdir().unwrap();
    let run = |command: &str| tau_in(directory.path(), command);
    run("tau simulate --model hexapod --seed 5 --out DIR/measured -q").done();
    let path = directory.path().join("measured/tcp_poses.csv");
    let mut rows: Vec<String> = (fs::read_to_string(&path).unwrap().lines())
        .map(str::to_owned)
        .collect();
    let column = rows[0].split(',').position(|name| name == "q1_m").unwrap();
    let mut cells: Vec<&str> = rows[20].split(',').collect();
    let pose = number(&cells[0].parse::<Value>().unwrap());
    let misread = (cells[column].parse::<f64>().unwrap() + 3.0).to_string();
    cells[column] = &misread;
    rows[20] = cells.join(",");
    fs::write(&path, rows.join("\n")).unwrap();

    let named = |without: &Value| {
        let without = without["not_predicted"].as_array().unwrap();
        assert_eq!(without.len(), 1, "{without:?}");
        assert_eq!(number(&without[0]["pose"]), pose);
        assert!(
            without[0]["why"].as_str().unwrap().contains("no solution"),
            "{without:?}"
        );
    };
    let calibrated = run("tau calibrate DIR/measured --variant Full --out DIR/out --json - -q");
    let calibrated = calibrated.json();
    named(&calibrated);
    assert_eq!(calibrated["fit"]["status"], "consistent");
    assert!(number(&calibrated["position_um"]["max"]) < 100.0);
    let evaluate =
        "tau evaluate DIR/measured --variant Full --robot DIR/out/robot.toml --json - -q";
    named(&run(evaluate).json());
    let said = run("tau study DIR/measured --out DIR/study").done();
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        said.contains(&format!("pose {pose} can't be predicted")),
        "{said}"
    );
    assert!(said.contains("Verdict on Full: consistent"), "{said}");
}

/// A command 2 rad off bends the fit to 18 poses so much that all of them lie far from it.
#[test]
fn a_gross_pose_of_few_does_not_hide() {
    for seed in 1..=3 {
        let folder = tempfile::tempdir().unwrap();
        let line = format!(
            "tau simulate --model five_bar --seed {seed} --poses 18 --random --out DIR/measured -q"
        );
        tau_in(folder.path(), &line).done();
        spoil(folder.path(), "tcp_poses.csv", 7, "q1_rad", 2.0);
        let line = "tau evaluate DIR/measured --model five_bar --variant Full --split all --json -";
        let fit = &tau_in(folder.path(), line).json()["fit"];
        assert_eq!(fit["status"], "consistent", "{seed}: {}", fit["why"]);
        let outliers = fit["outliers"].as_array().unwrap();
        let poses: Vec<&Value> = outliers.iter().map(|outlier| &outlier["pose"]).collect();
        assert_eq!(poses, [6], "{seed}");
    }
}

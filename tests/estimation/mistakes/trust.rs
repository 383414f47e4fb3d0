//! Verdicts, `tau check`, and mistakes that are recognised: on a Gantry-Tau, a linear delta and a hexapod.

use std::fs;
use std::path::Path;

use nalgebra::Rotation3;
use serde_json::Value;
use tau::Robot;
use tau::kinematics::{Pose, zyz};
use tempfile::TempDir;

use crate::support::{Random, fields, listing, number, tau_in};

/// The noise of trackers, and nothing else: dimensions stand in the description.
fn noise(robot: &str) -> String {
    format!("robot = \"{robot}\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n")
}

/// A robot, with the arguments that name it.
struct Machine {
    name: &'static str,
    model: &'static str,
    /// Name of a link, and a value of its length with tolerance as its file or description writes it.
    length: (&'static str, &'static str),
}

const MACHINES: [Machine; 3] = [
    Machine {
        name: "GantryTau",
        model: "",
        length: ("l1", "value = 2.04399, tol"),
    },
    Machine {
        name: "LinearDelta",
        model: "--model ROBOTS/linear_delta.tau",
        length: ("a1", "length_m = { value = 0.694622, tol = 3e-4 }"),
    },
    Machine {
        name: "Stewart",
        model: "--model ROBOTS/stewart.tau",
        length: ("leg1", "length_m = { value = 0.855522, tol = 3e-4 }"),
    },
];

impl Machine {
    /// A clean folder, without sets 2 and 3: what set 1 says is to be recognised by itself.
    fn simulated(&self, seed: u64) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let robot = if self.model.is_empty() {
            ""
        } else {
            fs::write(folder.path().join("noise.toml"), noise(self.name)).unwrap();
            "--robot DIR/noise.toml"
        };
        let model = self.model;
        let line =
            format!("tau simulate {model} {robot} --out DIR/measured --cart-poses 0 --seed {seed}");
        tau_in(folder.path(), &line).done();
        folder
    }

    fn run(&self, folder: &Path, command: &str) -> crate::support::Ran {
        let (verb, rest) = command.split_once(' ').unwrap_or((command, ""));
        tau_in(
            folder,
            &format!("tau {verb} DIR/measured {} {rest}", self.model),
        )
    }

    /// Mistakes that `tau check` recognises, and its exit code.
    fn mistakes(&self, folder: &Path) -> (Vec<Value>, u8) {
        let ran = self.run(folder, "check --variant Full --json -");
        let found: Value = serde_json::from_str(&ran.out).unwrap();
        (found["mistakes"].as_array().unwrap().clone(), ran.code)
    }
}

/// Rows of `tcp_poses.csv`, changed; each change is handed the columns of commands, position and angles.
fn change_poses(folder: &Path, change: impl Fn(&mut Vec<f64>, &mut [f64; 3], &mut [f64; 3])) {
    let path = folder.join("measured/tcp_poses.csv");
    let text = fs::read_to_string(&path).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap();
    let names: Vec<&str> = header.split(',').collect();
    let places = |of: &dyn Fn(&str) -> bool| -> Vec<usize> {
        (0..names.len()).filter(|&k| of(names[k])).collect()
    };
    let commands = places(&|name| name.starts_with('q'));
    let position = places(&|name| ["x_m", "y_m", "z_m"].contains(&name));
    let angles = places(&|name| ["alpha_rad", "beta_rad", "gamma_rad"].contains(&name));
    let rows = lines.map(|line| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        let read = |places: &[usize]| -> Vec<f64> {
            places.iter().map(|&k| cells[k].parse().unwrap()).collect()
        };
        let mut q = read(&commands);
        let mut p: [f64; 3] = read(&position).try_into().unwrap();
        let mut a: [f64; 3] = read(&angles).try_into().unwrap();
        change(&mut q, &mut p, &mut a);
        let values = q.iter().chain(&p).chain(&a);
        for (&k, value) in commands.iter().chain(&position).chain(&angles).zip(values) {
            cells[k] = format!("{value:.9}");
        }
        cells.join(",") + "\n"
    });
    let text = format!("{header}\n{}", rows.collect::<String>());
    fs::write(&path, text).unwrap();
}

fn change_robot(folder: &Path, change: impl Fn(&str) -> String) {
    let path = folder.join("measured/robot.toml");
    let text = change(&fs::read_to_string(&path).unwrap());
    fs::write(path, text).unwrap();
}

/// The one mistake that is recognised, of a kind, with words.
#[track_caller]
fn recognised(machine: &Machine, folder: &Path, kind: &str, words: &str) {
    let (found, code) = machine.mistakes(folder);
    let name = machine.name;
    assert_eq!(found.len(), 1, "{name}: {found:?}");
    assert_eq!(found[0]["kind"], kind, "{name}: {found:?}");
    let what = found[0]["what"].as_str().unwrap();
    assert!(what.contains(words), "{name}: {what}");
    let is_absurd = found[0]["absurd"].as_bool().unwrap();
    assert_eq!(code, u8::from(is_absurd), "{name}");
}

#[test]
fn clean_folders_are_consistent() {
    for machine in &MACHINES {
        let folder = machine.simulated(11);
        let (found, code) = machine.mistakes(folder.path());
        assert!(found.is_empty() && code == 0, "{found:?}");
        let line = "calibrate --variant Full --out DIR/out --json -";
        let result = machine.run(folder.path(), line).json();
        let fit = &result["fit"];
        assert_eq!(fit["status"], "consistent", "{fit:#}");
        let names = [
            "chi2",
            "dof",
            "residual_over_noise",
            "by_file",
            "worst",
            "pulls",
            "why",
        ];
        fields(fit, names);
        fields(
            &fit["by_file"][0],
            ["file", "kind", "rows", "rms", "expected_rms"],
        );
        fields(&fit["worst"][0], ["pose", "sigmas"]);
        fields(&fit["pulls"][0], ["parameter", "tolerances"]);
        let ratio = number(&fit["residual_over_noise"]);
        assert!((0.85..1.15).contains(&ratio), "{ratio}");
        let estimate = &result["parameters"][0];
        assert_eq!(estimate["sigma"], estimate["sigma_widened"]);
        let line = "evaluate --variant Full --robot DIR/out/robot.toml --json -";
        let predicted = machine.run(folder.path(), line).json();
        assert_eq!(predicted["fit"]["status"], "consistent", "{predicted:#}");
    }
}

#[test]
fn exchanged_commands_are_recognised() {
    for machine in &MACHINES {
        for (one, other) in [(0, 1), (1, 2)] {
            let folder = machine.simulated(12);
            change_poses(folder.path(), |q, _, _| q.swap(one, other));
            let words = format!("`q{}_m` and `q{}_m` are exchanged", one + 1, other + 1);
            recognised(machine, folder.path(), "commands", &words);
        }
    }
}

#[test]
fn a_mirrored_axis_is_recognised() {
    for machine in &MACHINES {
        let folder = machine.simulated(13);
        change_poses(folder.path(), |_, p, _| p[2] = -p[2]);
        recognised(
            machine,
            folder.path(),
            "axes",
            "the z axis of the positions is mirrored",
        );
    }
}

/// The angles of R = Rz(a)·Ry(b)·Rx(c) instead of ZYZ.
#[test]
fn other_angles_are_recognised() {
    for machine in &MACHINES {
        let folder = machine.simulated(14);
        change_poses(folder.path(), |_, _, angles| {
            let (c, b, a) = zyz(*angles).euler_angles();
            *angles = [a, b, c];
        });
        recognised(machine, folder.path(), "angles", "ZYX Euler angles");
    }
}

#[test]
fn a_transposed_rotation_is_recognised() {
    for machine in &MACHINES {
        let folder = machine.simulated(15);
        change_poses(folder.path(), |_, p, angles| {
            let rotation: Rotation3<f64> = zyz(*angles).inverse();
            let pose = Pose {
                position: (*p).into(),
                rotation,
            };
            *angles = pose.angles_rad();
        });
        recognised(machine, folder.path(), "angles", "transposed");
    }
}

#[test]
fn millimetres_in_the_noise_are_recognised() {
    for machine in &MACHINES {
        let folder = machine.simulated(16);
        change_robot(folder.path(), |text| {
            let at = text.find("position_m = ").unwrap() + "position_m = ".len();
            let end = at + text[at..].find('\n').unwrap();
            let value: f64 = text[at..end].trim().parse().unwrap();
            format!("{}{:e}{}", &text[..at], 1e3 * value, &text[end..])
        });
        recognised(machine, folder.path(), "noise", "`position_m` of `[noise]`");
    }
}

/// A link's length in the robot file, so many tolerances longer.
fn lengthen(machine: &Machine, folder: &Path, tolerances: f64) {
    let (link, length) = machine.length;
    change_robot(folder, |text| {
        if machine.model.is_empty() {
            let longer = format!("value = {}, tol", 2.04399 + tolerances * 3e-4);
            assert!(text.contains(length));
            return text.replacen(length, &longer, 1);
        }
        let number = length.split(['=', ',']).nth(2).unwrap().trim();
        let value: f64 = number.parse().unwrap();
        let longer = length.replace(number, &(value + tolerances * 3e-4).to_string());
        assert!(!text.contains("[links."), "{text}");
        format!("{text}\n[links.{link}]\n{longer}\n")
    });
}

/// A bad part is inconsistent, a slipped digit absurd.
#[test]
fn a_dimension_far_off_is_named() {
    for machine in &MACHINES {
        for (tolerances, status) in [(10.0, "inconsistent"), (100.0, "absurd")] {
            let folder = machine.simulated(17);
            lengthen(machine, folder.path(), tolerances);
            let name = format!("`{}.length`", machine.length.0);
            recognised(machine, folder.path(), "dimension", &name);
            let line = "calibrate --variant Full --out DIR/out --json -";
            let ran = machine.run(folder.path(), line);
            let result: Value = serde_json::from_str(&ran.out).unwrap();
            assert_eq!(result["fit"]["status"], status, "{}", ran.err);
            assert!(ran.err.contains(&name), "{}", ran.err);
        }
    }
}

#[test]
fn tolerances_in_other_units_are_recognised() {
    let machine = &MACHINES[0];
    let written = |text: &str, factor: f64, directions: bool| -> String {
        let scaled = |line: &str| {
            let (before, after) = line.split_once("tol = ")?;
            let (tolerance, after) = after.split_once(' ')?;
            let tolerance = factor * tolerance.parse::<f64>().ok()?;
            Some(format!("{before}tol = {tolerance:e} {after}"))
        };
        let lines = text.lines().map(|line| {
            let is_meant = directions || !line.starts_with("track_direction");
            let scaled = scaled(line).filter(|_| is_meant);
            scaled.unwrap_or_else(|| line.to_owned()) + "\n"
        });
        lines.collect()
    };
    for (factor, directions, words) in [(1e3, false, "too large"), (1e-3, true, "too small")] {
        let folder = machine.simulated(18);
        change_robot(folder.path(), |text| {
            let changed = written(text, factor, directions);
            assert_ne!(changed, text);
            changed
        });
        recognised(machine, folder.path(), "tolerances", words);
    }
}

/// Nothing is written unless it is forced, whatever is printed.
#[test]
fn an_absurd_result_is_not_written() {
    let machine = &MACHINES[0];
    let folder = machine.simulated(19);
    change_poses(folder.path(), |q, _, _| q.swap(0, 1));
    for command in [
        "calibrate --variant Full",
        "study --no-discover",
        "evaluate --variant Full",
    ] {
        let writes = !command.starts_with("evaluate");
        let out = if writes { "--out DIR/out" } else { "" };
        let line = format!("{command} {out} --json DIR/result.json --quiet");
        let ran = machine.run(folder.path(), &line);
        assert_eq!(ran.code, 1, "{}", ran.err);
        assert!(
            ran.err.contains("`q1_m` and `q2_m` are exchanged"),
            "{}",
            ran.err
        );
        assert!(ran.err.contains("--force"), "{}", ran.err);
        assert_eq!(ran.out, "");
        let kept = ["measured"];
        assert_eq!(listing(folder.path()), kept, "{command}");
    }
    let unasked = machine.run(folder.path(), "evaluate --variant Full");
    assert!(
        unasked.err.contains("--force") && !unasked.err.contains("written"),
        "{}",
        unasked.err
    );
    let line = "calibrate --variant Full --out DIR/out --quiet --force";
    let forced = machine.run(folder.path(), line);
    assert_eq!(forced.code, 0, "{}", forced.err);
    assert!(
        forced.err.starts_with("verdict: absurd: "),
        "{}",
        forced.err
    );
    assert!(folder.path().join("out/robot.toml").is_file());
}

/// The measurements that ship hold effects that `Full` lacks: sigmas are too small, and quiet does not hide it.
#[test]
fn an_inconsistent_fit_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau calibrate DATA --variant Full --out DIR/out";
    let said = tau_in(folder.path(), line).done();
    assert!(
        said.contains("Verdict: inconsistent: Residuals are "),
        "{said}"
    );
    let quiet = tau_in(
        folder.path(),
        &format!("{line} --quiet --json DIR/out.json"),
    );
    assert!(
        quiet.err.starts_with("verdict: inconsistent: "),
        "{}",
        quiet.err
    );
    assert_eq!(quiet.done(), "");
    let text = fs::read_to_string(folder.path().join("out.json")).unwrap();
    let result: Value = serde_json::from_str(&text).unwrap();
    let fit = &result["fit"];
    let widening = (number(&fit["chi2"]) / number(&fit["dof"])).sqrt();
    assert!((3.0..10.0).contains(&widening), "{widening}");
    // No noise makes a parameter less known than its drawing does.
    let parameters = result["parameters"].as_array().unwrap();
    let mut widened = 0;
    for own in parameters.iter().filter(|own| own["tolerance"].is_number()) {
        let [sigma, prior] = [&own["sigma"], &own["tolerance"]].map(number);
        let expected = (widening * sigma).min(prior.max(sigma));
        let found = number(&own["sigma_widened"]);
        assert!((found - expected).abs() < 1e-9 * expected, "{own}");
        widened += usize::from(found < prior);
    }
    assert!(widened > 20, "{widened}");
    assert!(fit["mistakes"].as_array().unwrap().is_empty(), "{fit:#}");
}

/// The reasons and the list of pulls tell one figure of a parameter.
#[test]
fn a_pull_is_told_with_one_figure() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model five_bar --seed 2228 --out DIR/measured -q";
    tau_in(folder.path(), line).done();
    let line = "tau calibrate DIR/measured --variant Full --out DIR/out --json -";
    let fit = &tau_in(folder.path(), line).json()["fit"];
    let worst = &fit["pulls"][0];
    let told = format!(
        "`{}` is pulled {:.2} tolerances off its nominal value.",
        worst["parameter"].as_str().unwrap(),
        number(&worst["tolerances"]).abs()
    );
    let mut why = fit["why"].as_array().unwrap().iter();
    assert!(why.any(|why| why == told.as_str()), "{told} {fit:#}");
}

/// A variant that brings residuals to the noise is not blamed for what one without effects leaves.
#[test]
fn noise_that_is_met_is_stated_rightly() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run(
        "tau simulate --model hexapod --variant Full --random --poses 80 --seed 1 --payload 40 --out DIR/measured -q \
         --effect link_compliance(leg2):strain=1.5e-6",
    )
    .done();
    run("tau discover DIR/measured --model hexapod --base Full --out DIR/found -q").done();
    let line = "tau calibrate DIR/measured --model DIR/found/discovered.tau --variant Discovered --out DIR/fit --json - -q";
    let found = run(line).json();
    assert_eq!(found["fit"]["status"], "consistent", "{found:#}");
}

#[test]
fn a_check_says_what_is_there_and_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let found = tau_in(folder.path(), "tau check DATA --json -").json();
    assert_eq!(found["meaningful"], true);
    assert_eq!(found["files"].as_array().unwrap().len(), 3);
    let full = &found["variants"]["Full"];
    assert_eq!(full["parameters"], 60);
    assert_eq!(full["rank"], 60);
    assert!(!full["undetermined"].as_array().unwrap().is_empty());
    let said = tau_in(folder.path(), "tau check DATA").done();
    for words in [
        "No mistake was recognised",
        "tcp_poses.csv: 176 rows",
        "Full: ",
    ] {
        assert!(said.contains(words), "{words} in {said}");
    }

    let machine = &MACHINES[1];
    let measured = machine.simulated(20);
    let path = measured.path().join("measured/tcp_poses.csv");
    let text = fs::read_to_string(&path).unwrap();
    let few: Vec<&str> = text.lines().take(12).collect();
    fs::write(&path, few.join("\n") + "\n").unwrap();
    fs::remove_file(measured.path().join("measured/cart_poses.csv")).unwrap();
    let ran = machine.run(measured.path(), "check");
    assert_eq!(ran.code, 1);
    assert!(
        ran.err.contains("a calibration would mean nothing"),
        "{}",
        ran.err
    );
    assert!(
        ran.out.contains("cart_poses.csv: the shape of each track"),
        "{}",
        ran.out
    );
}

/// Discovery refuses what calibration calls absurd, with the same mend.
#[test]
fn discovery_refuses_mistakes() {
    let machine = &MACHINES[0];
    let folder = machine.simulated(21);
    change_poses(folder.path(), |_, p, _| p[2] = -p[2]);
    let ran = machine.run(folder.path(), "discover --out DIR/out");
    assert_eq!(ran.code, 2, "{}", ran.err);
    assert!(
        ran.err.contains("the z axis of the positions is mirrored"),
        "{}",
        ran.err
    );
}

/// Links of a cart that are not parallel are more than the noise for a reduced arm, by a hundred times, and no wrong noise:
/// the variant with all links has it right, though a track of it follows measured points.
#[test]
fn what_a_variant_is_too_simple_for_is_no_mistake() {
    let folder = tempfile::tempdir().unwrap();
    let with = "--model ROBOTS/four_track.tau";
    let line = format!("tau simulate {with} --out DIR/measured --random --poses 60");
    tau_in(folder.path(), &line).done();
    let line =
        format!("tau calibrate DIR/measured {with} --variant Nominal --out DIR/out --json -");
    let found = tau_in(folder.path(), &line).json();
    assert_eq!(found["fit"]["status"], "inconsistent");
    assert_eq!(found["fit"]["mistakes"], serde_json::json!([]));
    let line = format!("tau check DIR/measured {with} --json -");
    let checked = tau_in(folder.path(), &line).json();
    assert_eq!(checked["mistakes"], serde_json::json!([]));
}

/// Base joints drawn two tenths of a metre off: noise is weighed along the links as they are found, so the verdict and the
/// parameters are those of a good drawing.
#[test]
fn a_sketch_is_judged_as_its_machine() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    run("tau simulate --model hexapod --variant Full --measure poses --poses 60 --random --seed 3 --out DIR/measured").done();
    let path = folder.path().join("measured/robot.toml");
    fs::write(
        &path,
        "robot = \"Hexapod\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n",
    )
    .unwrap();
    let mut random = Random(5);
    let drawing = Robot::from(&tau_generated::hexapod::ROBOT).description;
    let sketch: Vec<String> = (drawing.lines())
        .map(|line| {
            let Some((before, rest)) = line.split_once("track_offset = (") else {
                return line.to_owned();
            };
            let (place, _) = rest.split_once(')').unwrap();
            let place: Vec<String> = (place.split(','))
                .map(|number| number.trim().parse::<f64>().unwrap() + 0.2 * random.uniform())
                .map(|number| number.to_string())
                .collect();
            format!("{before}track_offset = ({}) m tol 0.2 m;", place.join(", "))
        })
        .collect();
    assert_ne!(sketch.join("\n"), drawing);
    fs::write(folder.path().join("sketch.tau"), sketch.join("\n")).unwrap();
    let calibrated = |model: &str| {
        run(&format!("tau calibrate DIR/measured --model {model} --variant Full --split all --json - --out DIR/c")).json()
    };
    let (drawn, sketched) = (calibrated("hexapod"), calibrated("DIR/sketch.tau"));
    for found in [&drawn, &sketched] {
        assert_eq!(
            found["fit"]["status"], "consistent",
            "{}",
            found["fit"]["why"]
        );
    }
    let [drawn, sketched] = [&drawn, &sketched].map(|found| number(&found["fit"]["chi2"]));
    assert!((drawn / sketched - 1.0).abs() < 0.1, "{drawn} {sketched}");
}

/// Other machines of the same drawing are told from a model that lacks something: within their tolerances they fit.
#[test]
fn a_machine_that_has_changed_is_told_from_what_a_model_lacks() {
    for machine in &MACHINES {
        let (one, other) = (machine.simulated(31), machine.simulated(32));
        machine
            .run(one.path(), "calibrate --variant Full --out DIR/out -q")
            .done();
        fs::copy(
            one.path().join("out/robot.toml"),
            other.path().join("one.toml"),
        )
        .unwrap();
        let line = "evaluate --variant Full --robot DIR/one.toml --json -";
        let ran = machine.run(other.path(), line);
        let result: Value = serde_json::from_str(&ran.out).unwrap();
        assert_eq!(result["fit"]["status"], "inconsistent", "{}", ran.err);
        let why = result["fit"]["why"].to_string();
        assert!(why.contains("the machine has changed"), "{why}");
        assert!(!why.contains("lacks something"), "{why}");
    }
}

//! Statistics over many machines, each with a bound that a correct program exceeds once in ten thousand runs.

use nalgebra::Vector3;
use tau::Setup;
use tau::calibration::{Options, calibrate};
use tau::kinematics::Sample;
use tau::simulation::{Conditions, Pose, Simulation, simulate};
use tau::uncertainty::Uncertainty;
use tau_testkit::Random;

use crate::{
    agreement, calibration as papers, redundant, repeats, truth, uncertainty, unknown_poses,
};

#[test]
fn calibrations_of_every_standard_robot_hold_the_truth() {
    for (name, _) in tau_generated::ROBOTS {
        truth::holds(name, "poses", 2);
        for kind in ["positions", "heights,distances"] {
            // Of four belts these leave the parameters to the readings.
            if name != "four_belts" || kind == "positions" {
                truth::holds(name, kind, 1);
            }
        }
    }
    // A ball of unknown place leaves the scale of others open.
    for name in ["linear_delta", "hexapod", "gantry_tau"] {
        truth::holds(name, "ball-bar", 1);
    }
}

#[test]
fn every_standard_robot_is_measured_as_the_list_says() {
    for (name, _) in tau_generated::ROBOTS {
        truth::is_measured_as_the_list_says(name);
    }
}

/// The covariance of another estimator made χ² of new poses 1.14 of what is expected; by what a fit follows of the noise of its
/// own poses it was 0.84.
#[test]
fn poses_of_many_machines_are_as_far_off_as_their_files_let_expect() {
    for model in ["servo_hexapod", "hexaglide"] {
        let simulate = format!("--model {model}");
        agreement::are_as_far_off_as_expected(&simulate, "alternate", 2..=25);
    }
    agreement::are_as_far_off_as_expected("", "all", 1..=16);
    let noisy = "--model linear_delta --noise-drives 3e-5";
    agreement::are_as_far_off_as_expected(noisy, "alternate", 1..=8);
}

#[test]
fn chi2_of_redundant_robots_is_that_of_the_measured_coordinates() {
    for robot in ["four_belts", "four_lines"] {
        redundant::chi2_is_that_of_coordinates(robot, 1..=8);
    }
}

#[test]
fn a_hundred_random_starts_reach_one_optimum() {
    for variant in [
        "Nominal",
        "Piecewise",
        "Full",
        "FullPiecewise",
        "BestPerLink",
    ] {
        papers::random_starts_reach_one_optimum(variant, 100);
    }
}

#[test]
fn right_models_have_even_p_values() {
    repeats::right_models_repeat_as_simulated(40);
}

#[test]
fn estimated_noise_alarms_seldom() {
    repeats::estimated_noise_proves_no_model(40);
}

/// Readings that share half of their variance: four of them are worth 1.6, and deviations by noise of each are too small
/// by √2.5.
#[test]
fn widened_deviations_are_those_of_the_errors() {
    for (measured, factor) in [
        ("--measure heights,distances", 1.9),
        ("--noise-drives 5e-6", 1.3),
    ] {
        let [stated, widened] = repeats::squares_of_errors(measured, 24);
        assert!(stated > factor * widened, "{stated}, {widened}");
        // Errors of one machine go together: as if of one number each, 24 of them have a mean square within 0.2 and 2.6.
        assert!((0.2..2.6).contains(&widened), "{measured}: {widened}");
    }
}

#[test]
fn balls_beside_a_plane_calibrate_five_bars() {
    unknown_poses::a_ball_calibrates_a_five_bar(40);
}

/// Of the first thousand machines each with exact and with noisy drives those that once ended elsewhere.
#[test]
fn positions_of_hexapods_lead_to_the_machine() {
    unknown_poses::lead_to_the_machine("", &[429, 491, 643, 761, 906]);
    let noisy = [218, 420, 429, 491, 580, 643, 906];
    unknown_poses::lead_to_the_machine(unknown_poses::NOISY_DRIVES, &noisy);
}

/// Shares of 95 % intervals of positions and of rotations that hold the truth between measured poses, over so many machines.
fn coverage(name: &str, variant: &str, machines: u64) -> [f64; 2] {
    let (robot, file) = uncertainty::robot(name);
    let variant = robot.variant(variant).unwrap();
    let mut counts = [[0.0; 2]; 2];
    for seed in 0..machines {
        let simulated = simulate(&Simulation {
            seed: 900 + seed,
            random_poses: 0,
            ..Simulation::new(robot.clone(), file.clone())
        })
        .unwrap();
        let folder = &simulated.folder;
        let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let setup = Setup::new(&robot, variant, &simulated.file, folder);
        let found = calibrate(setup, &poses, &Options::default()).unwrap();
        let known = Uncertainty::of_calibration(&found).unwrap();
        let mut random = Random(seed);
        for _ in 0..8 {
            // Between three poses that were measured.
            let near = [(); 3].map(|()| {
                let index = random.uniform() * poses.len() as f64;
                &folder.tcp_poses[index as usize]
            });
            let commands: Vec<f64> = (0..robot.commands)
                .map(|k| near.iter().map(|pose| pose.commands_m[k]).sum::<f64>() / 3.0)
                .collect();
            let sample = Sample {
                commands_m: &commands,
                ..Sample::from(near[0])
            };
            let pose = found.machine.forward(&sample).unwrap();
            let sigma = known.pose(&found.machine, &sample.at(pose)).unwrap();
            let conditions = Conditions {
                directions: vec![1.0; robot.commands],
                ..Conditions::default()
            };
            let start = Pose {
                position_m: pose.position,
                rotation: pose.rotation,
            };
            let machine = &simulated.truth.machine;
            let truth = machine.solve(&commands, &conditions, start).unwrap().pose;
            let off: Vector3<f64> = pose.position - truth.position_m;
            let turned = (pose.rotation * truth.rotation.inverse()).scaled_axis();
            let errors = [(off, sigma.position_m()), (turned, sigma.rotation_rad())];
            for (counts, (off, sigma)) in counts.iter_mut().zip(errors) {
                for (off, sigma) in off.iter().zip(sigma).filter(|own| own.1 > 0.0) {
                    counts[0] += f64::from(u8::from(off.abs() <= 1.96 * sigma));
                    counts[1] += 1.0;
                }
            }
        }
    }
    counts.map(|[hits, trials]| hits / trials)
}

/// Errors at the places of one machine go together, so machines count, not places: the share scatters by √(0.95 · 0.05 / n) at
/// most, and is 3.72 times that below once in ten thousand. Where carts turn, joints go along ways of other lengths than the
/// measured path. `MACHINES=200` gives the figures of the documentation.
#[test]
fn intervals_hold_the_truth() {
    let asked = std::env::var("MACHINES").ok();
    let machines = asked.and_then(|count| count.parse().ok()).unwrap_or(40);
    for (name, variant) in [
        ("gantry_tau", "Full"),
        ("gantry_tau", "FullPiecewise"),
        ("gantry_tau", "BestPerLink"),
        ("linear_delta", "Full"),
        ("hexapod", "Full"),
    ] {
        let [position, rotation] = coverage(name, variant, machines);
        println!("{name} {variant}: {position:.4}, turned {rotation:.4}");
        let least = 0.95 - 3.72 * (0.95 * 0.05 / machines as f64).sqrt();
        // A plate that is a point does not turn.
        let turns = rotation > least || name == "linear_delta";
        assert!(position > least && turns, "{name} {variant}");
    }
}

//! Statistics over many machines, each with a bound that a correct program exceeds once in ten thousand runs.

use tau_testkit::robots::GANTRY_VARIANTS;

use crate::{agreement, calibration, evaluate, redundant, repeats, truth, unknown_poses};

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
fn piecewise_tracks_of_files_predict_what_took_no_part() {
    evaluate::piecewise_tracks_predict(8);
}

#[test]
fn chi2_of_redundant_robots_is_that_of_the_measured_coordinates() {
    for robot in ["four_belts", "four_lines"] {
        redundant::chi2_is_that_of_coordinates(robot, 1..=8);
    }
}

#[test]
fn a_hundred_random_starts_reach_one_optimum() {
    for variant in GANTRY_VARIANTS {
        calibration::random_starts_reach_one_optimum(variant, 100);
    }
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

#[test]
fn right_models_have_even_p_values() {
    repeats::right_models_repeat_as_simulated(40);
}

//! What is drawn, equilibrium, and effects that no list holds, with formulas written here.

use std::sync::Arc;

use tau::robot_file::Payload;
use tau::simulation::{
    Build, CartError, CartReading, Effect, Physics, SimulatedFolder, Simulation, State,
};
use tau_model_dsl::model::Place;

use super::{LISTED, V, run, silent, standard, with_effects};

#[test]
fn a_drawn_machine_stays_within_reach_of_its_tolerances_and_differs_by_seed() {
    let rods = |simulation| run(&simulation).truth.machine.rods;
    let drawn = rods(silent());
    let exact = rods(Simulation {
        build: Build::Exact,
        ..silent()
    });
    let other = rods(Simulation {
        seed: 2,
        ..silent()
    });
    let mut squares = 0.0;
    for (file, (a, b)) in exact.iter().zip(drawn.iter().zip(&other)) {
        assert!(a.length_m != b.length_m && a.plate_joint_m != b.plate_joint_m);
        for rod in [a, b] {
            squares += ((rod.length_m - file.length_m) / 3e-4).powi(2);
            squares += ((rod.plate_joint_m - file.plate_joint_m) / 3e-4).norm_squared();
            assert!((rod.track_offset_m - file.track_offset_m).norm() < 1e-2);
        }
    }
    // The sum of 48 squared standard normals.
    assert!((24.0..77.0).contains(&squares), "{squares}");
    // Joints of one cart keep their distance but for their own tolerance: the cart is rigid.
    for (i, j) in [(1, 2), (3, 4), (4, 5), (3, 5)] {
        let arm = drawn[i].track_offset_m - drawn[j].track_offset_m;
        let apart = arm.dot(&(drawn[i].track_direction - drawn[j].track_direction));
        assert!(apart.abs() / arm.norm() < 1e-12);
    }
}

/// Along, level across and upright across a track.
fn axes(simulated: &SimulatedFolder, track: usize) -> [V; 3] {
    let along = simulated.truth.machine.rods[[0, 1, 3][track]].track_direction;
    let along = along.normalize();
    let level = V::z().cross(&along).normalize();
    [along, level, along.cross(&level)]
}

/// On carts whose links stretch among all other effects, and on legs.
#[test]
fn forces_hold_the_payload() {
    let legs = standard("hexapod", None);
    for mut simulation in [with_effects(&LISTED), legs] {
        let centre_m = [0.02, -0.03, 0.05];
        simulation.file.payload = Some(Payload {
            mass_kg: 39.0,
            centre_m,
            gravity_m_s2: [0.0, 0.0, -9.81],
        });
        let simulated = run(&simulation);
        for state in &simulated.truth.tcp_poses {
            let weight = V::new(0.0, 0.0, -39.0 * 9.81);
            let turn = state.pose.rotation;
            let (mut force, mut moment) = (weight, (turn * V::from(centre_m)).cross(&weight));
            for k in 0..6 {
                let lever = turn * state.plate_joints_m[k];
                let rod = state.pose.position_m + lever - state.joints_m[k];
                assert!((rod.norm() - state.lengths_m[k]).abs() < 1e-12);
                // A rod in tension pulls the plate towards the cart.
                let pull = -rod / rod.norm() * state.tensions_n[k];
                force += pull;
                moment += lever.cross(&pull);
            }
            assert!(force.norm() < 1e-9 && moment.norm() < 1e-9, "{state:?}");
            // The carts bear the weight.
            let loads = state.loads_n.iter().enumerate().map(|(track, load)| {
                let [along, level, upright] = axes(&simulated, track);
                along * load[0] + level * load[1] + upright * load[2]
            });
            let off = loads
                .reduce(|a, b| a + b)
                .map_or(0.0, |borne| (borne - weight).norm());
            assert!(off < 1e-9, "{off}");
        }
    }
}

#[test]
fn an_unlisted_effect_does_what_its_function_says() {
    let bump = |at: &CartReading| CartError {
        shift_m: [0.0, 0.0, 1e-4 * (-(at.q_m / 0.1).powi(2)).exp()],
        turn_rad: [0.0; 3],
    };
    let place = Place::Cart {
        track: 0,
        source: None,
    };
    let effect = Effect::unlisted("dent", place, Physics::Cart(Arc::new(bump)));
    let plain = with_effects(&[]);
    let dented = run(&Simulation {
        effects: vec![effect],
        ..plain.clone()
    });
    let truth = &dented.truth;
    assert_eq!(truth.status, ["unnamed_structure", "partly_explained"]);
    assert_eq!(truth.effects, [("dent".to_owned(), "one".to_owned())]);
    let middle = |simulated: &SimulatedFolder| {
        let mut rows = simulated.folder.cart_poses.iter();
        let row = rows.find(|row| row.track == 0 && row.command_m == 0.0);
        simulated.truth.set2.rotation.inverse() * V::from(row.unwrap().position_m)
    };
    let shift = middle(&dented) - middle(&run(&plain));
    assert!((shift.norm() - 1e-4).abs() < 1e-9 && shift.z > 0.9e-4);
}

#[test]
fn a_reduced_arm_keeps_its_orientation() {
    for (variant, turns) in [(Some("Nominal".to_owned()), false), (None, true)] {
        let simulated = run(&Simulation {
            variant,
            build: Build::Exact,
            ..silent()
        });
        let poses = &simulated.truth.tcp_poses;
        let first = poses[0].pose.rotation;
        let turn = |state: &State| (state.pose.rotation.matrix() - first.matrix()).norm();
        let largest = poses.iter().map(turn).fold(0.0, f64::max);
        assert!(
            if turns {
                largest > 1e-4
            } else {
                largest < 1e-10
            },
            "{largest}"
        );
    }
}

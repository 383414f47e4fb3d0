//! What is drawn, and belts that are pulled.

use serde_json::Value;
use tau::simulation::{SimulatedFolder, Simulation};
use tau_testkit::number;

use super::{V, parsed, run, standard};

/// Parameters of the whole machine, as `truth.json` has them.
fn parameters(simulated: &SimulatedFolder) -> Value {
    let truth: Value = serde_json::from_str(&simulated.truth.to_json()).unwrap();
    truth["parameters"].clone()
}

/// Without a variant the machine is one of the ordinary variant, `Full`.
#[test]
fn what_is_exact_or_held_is_as_drawn() {
    let variants = [Some("Scaled"), Some("Basic"), Some("Full"), None];
    let [free, held, full, plain] = variants.map(|variant| {
        let simulation = Simulation {
            variant: variant.map(str::to_owned),
            ..standard("linear_delta", None)
        };
        parameters(&run(&simulation))
    });
    assert_eq!(full, plain);
    for (name, nominal) in [("scale", 0.0), ("arm_a", 0.333), ("arm_c", 0.333)] {
        assert!(free[name] != nominal, "{name}");
        assert_eq!(held[name], nominal, "{name}");
        assert_eq!(full[name] == nominal, name == "scale", "{name}");
    }
    for name in ["radius", "endstop_b", "angle_a"] {
        assert_eq!([&free[name], &free[name]], [&held[name], &full[name]]);
    }
    // A constant is nobody's.
    assert_eq!(free["angle_c"], std::f64::consts::FRAC_PI_2);
}

/// Pulled belts have their tension, the others what then holds the sled, gravity along the sheet included; belts yield,
/// and the readings follow.
#[test]
fn pulled_belts_and_the_balance_of_the_others() {
    let mut simulation = standard("four_belts", Some(12.0));
    let effect = "link_compliance(all): strain=1e-6";
    simulation.effects = vec![parsed(effect, &simulation.robot)];
    let simulated = run(&simulation);
    let parameters = parameters(&simulated);
    let [zero, scale, height, arm] =
        ["zero", "scale", "height", "arm"].map(|name| number(&parameters[name]));
    let poses = simulated.folder.tcp_poses.iter();
    for (pose, state) in poses.zip(&simulated.truth.tcp_poses) {
        let mut force = V::new(0.0, -36.0, 0.0);
        for (k, belt) in simulated.truth.machine.rods.iter().enumerate() {
            let way = belt.track_offset_m - V::from(pose.position_m);
            let tension = state.tensions_n[k];
            force += way.normalize() * tension;
            assert_eq!(belt.pull_n.is_none(), k < 2, "{k}");
            let off = tension - belt.pull_n.unwrap_or(tension);
            assert!(off.abs() < 1e-10, "{k}: {off}");
            let slope = zero + (1.0 + scale) * pose.commands_m[k];
            let length = arm + (slope.powi(2) - height.powi(2)).sqrt();
            let off = length * (1.0 + 1e-6 * tension) - way.norm();
            assert!(off.abs() < 1e-10, "{k}: {off}");
        }
        assert!(force.xy().norm() < 1e-8, "{force}");
    }
}

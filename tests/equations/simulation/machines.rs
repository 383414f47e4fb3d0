//! What is drawn, and belts that are pulled.

use serde_json::Value;
use tau::simulation::{SimulatedFolder, Simulation};
use tau_testkit::number;

use super::{V, parsed, run, standard};

/// Numbers of `truth.json`.
struct Built(Value);

impl Built {
    fn of(simulated: &SimulatedFolder) -> Self {
        Self(serde_json::from_str(&simulated.truth.to_json()).unwrap())
    }

    fn parameter(&self, name: &str) -> f64 {
        number(&self.0["parameters"][name])
    }

    fn anchor(&self, link: &str) -> V {
        V::from_fn(|axis, _| number(&self.0["links"][link]["track_offset_m"][axis]))
    }
}

#[track_caller]
fn close(name: &str, a: f64, b: f64) {
    assert!((a - b).abs() < 2e-12 * a.abs().max(1.0), "{name}: {a} {b}");
}

const BELTS: [&str; 4] = ["top_left", "top_right", "bottom_left", "bottom_right"];

/// Without a variant the machine is one of the ordinary variant, `Full`.
#[test]
fn what_is_exact_or_held_is_as_drawn() {
    let [free, held, full, plain] =
        [Some("Scaled"), Some("Basic"), Some("Full"), None].map(|variant| {
            let simulation = Simulation {
                variant: variant.map(str::to_owned),
                ..standard("linear_delta", None)
            };
            Built::of(&run(&simulation))
        });
    assert_eq!(full.0, plain.0);
    let is_drawn = |of: &Built, name: &str, nominal: f64, expected: bool| {
        assert_eq!(of.parameter(name) != nominal, expected, "{name}");
    };
    for (name, nominal) in [("scale", 0.0), ("arm_a", 0.333), ("arm_c", 0.333)] {
        is_drawn(&free, name, nominal, true);
        is_drawn(&held, name, nominal, false);
        is_drawn(&full, name, nominal, name != "scale");
    }
    for name in ["radius", "endstop_b", "angle_a"] {
        assert_eq!(free.parameter(name), held.parameter(name), "{name}");
        assert_eq!(free.parameter(name), full.parameter(name), "{name}");
    }
    // A constant is nobody's.
    assert_eq!(free.parameter("angle_c"), std::f64::consts::FRAC_PI_2);
}

/// Pulled belts have their tension, the others what then holds the sled, gravity along the sheet included; belts yield,
/// and the readings follow.
#[test]
fn pulled_belts_and_the_balance_of_the_others() {
    let mut simulation = standard("four_belts", Some(12.0));
    let strain = 1e-6;
    let effect = format!("link_compliance(all): strain={strain}");
    simulation.effects = vec![parsed(&effect, &simulation.robot)];
    let simulated = run(&simulation);
    let built = Built::of(&simulated);
    let poses = simulated.folder.tcp_poses.iter();
    for (pose, state) in poses.zip(&simulated.truth.tcp_poses) {
        let mut force = V::new(0.0, -36.0, 0.0);
        for (k, name) in BELTS.into_iter().enumerate() {
            let anchor = built.anchor(name);
            let way = anchor - V::from(pose.position_m);
            let tension = state.tensions_n[k];
            force += way.normalize() * tension;
            let pull = &built.0["links"][name]["pull_n"];
            assert_eq!(pull.is_null(), k < 2, "{name}");
            close(name, pull.as_f64().unwrap_or(tension), tension);
            let belt =
                built.parameter("zero") + (1.0 + built.parameter("scale")) * pose.commands_m[k];
            let level = (belt.powi(2) - built.parameter("height").powi(2)).sqrt();
            let length = (built.parameter("arm") + level) * (1.0 + strain * tension);
            assert!((length - way.norm()).abs() < 1e-10, "{length} {way}");
        }
        assert!(force.xy().norm() < 1e-8, "{force}");
    }
}

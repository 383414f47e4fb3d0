//! Forward and inverse kinematics of the standard robots: each stands where its description says, and finds its commands
//! again at poses nearby, by equations that the commands and the plate share.

use nalgebra::Vector3;
use tau_kinematics::{InverseOptions, Machine, Pose, Sample, Surroundings};
use tau_robot::robot::Robot;
use tau_robot::robot_file::keys::described_reference;

const DESCRIBED: [(&str, &str); 8] = [
    (
        "linear_delta",
        include_str!("../../generated/models/linear_delta.tau"),
    ),
    (
        "rotary_delta",
        include_str!("../../generated/models/rotary_delta.tau"),
    ),
    (
        "hexapod",
        include_str!("../../generated/models/hexapod.tau"),
    ),
    (
        "servo_hexapod",
        include_str!("../../generated/models/servo_hexapod.tau"),
    ),
    (
        "hexaglide",
        include_str!("../../generated/models/hexaglide.tau"),
    ),
    (
        "five_bar",
        include_str!("../../generated/models/five_bar.tau"),
    ),
    (
        "four_belts",
        include_str!("../../generated/models/four_belts.tau"),
    ),
    (
        "four_lines",
        include_str!("../../generated/models/four_lines.tau"),
    ),
];

/// A variant with the values of the description.
fn machine(text: &str, variant: &str) -> Machine {
    let robot = Robot::from_text(text).unwrap_or_else(|errors| panic!("{errors}"));
    let variant = robot.variant(variant).unwrap().clone();
    let nominal = variant.parameters.iter();
    let values: Vec<f64> = nominal
        .map(|parameter| parameter.nominal.unwrap_or(0.0))
        .collect();
    let surroundings = Surroundings {
        reference: described_reference(&robot),
        held: values.clone(),
        ..Surroundings::default()
    };
    Machine {
        robot,
        variant,
        values,
        surroundings,
    }
}

fn moved(pose: &Pose, freedom: usize, amount: f64) -> Pose {
    let mut motion = [0.0; 6];
    motion[freedom] = amount;
    let [x, y, z, a, b, c] = motion;
    pose.moved(Vector3::new(x, y, z), Vector3::new(a, b, c))
}

#[test]
fn every_standard_robot_stands_at_its_reference_and_finds_its_commands_again() {
    for (name, text) in DESCRIBED {
        let machine = machine(text, "Full");
        let stated = machine.surroundings.reference.clone().unwrap();
        let there = Sample::new((&stated).into(), &stated.commands_m);
        let home = machine
            .at_reference(&there)
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let off = (home.pose.position - there.pose.position).norm();
        assert!(off < 1e-3, "{name}: {off} m off its reference");
        for &freedom in machine.pose_unknowns() {
            for amount in [-0.03, 0.03] {
                let goal = moved(&home.pose, freedom, amount);
                // From the reference alone, and from where it stands.
                for near in [None, Some((home.pose, home.commands_m.clone()))] {
                    let options = InverseOptions {
                        near,
                        ..InverseOptions::default()
                    };
                    let reached = if machine.is_given_by_position() {
                        machine.inverse_position(goal.position.into(), &options)
                    } else {
                        machine.inverse(goal, &options)
                    };
                    let reached =
                        reached.unwrap_or_else(|error| panic!("{name} {freedom}: {error}"));
                    let back = machine.forward_along(
                        &home.commands_m,
                        &Sample::new(home.pose, &reached.commands_m),
                    );
                    let back = back.unwrap_or_else(|error| panic!("{name} {freedom}: {error}"));
                    let off = (back.pose.position - goal.position).norm();
                    let turned = back.pose.turn_to(&goal.rotation).norm();
                    assert!(
                        off < 1e-9 && turned < 1e-9,
                        "{name} {freedom}: {off} m, {turned} rad"
                    );
                }
            }
        }
    }
}

/// The axes and lengths of a rotary delta say where its elbows are; spheres about them meet at the effector.
#[test]
fn a_crank_turns_its_joint_about_its_axis() {
    let machine = machine(DESCRIBED[1].1, "Full");
    let angles = [0.3_f64, -0.1, 0.2];
    let pose = machine
        .forward(&Sample::new(
            Pose::from_zyz([0.0, 0.0, -0.33], [0.0; 3]),
            &angles,
        ))
        .unwrap();
    for (k, angle) in angles.iter().enumerate() {
        let heading = k as f64 * std::f64::consts::TAU / 3.0;
        let out = 0.12 + 0.2 * angle.cos();
        let elbow = Vector3::new(out * heading.cos(), out * heading.sin(), -0.2 * angle.sin());
        let rod = (pose.position - elbow).norm();
        assert!((rod - 0.46).abs() < 1e-12, "{k}: {rod}");
    }
}

/// The firmware's own formula for a delta printer: carriage height = endstop + √(arm² − radius²) − travel.
#[test]
fn a_linear_delta_is_the_printers_own() {
    let machine = machine(DESCRIBED[0].1, "Full");
    let effector = Vector3::new(0.031, -0.047, 0.012);
    let reached = machine
        .inverse_position(effector.into(), &InverseOptions::default())
        .unwrap();
    for (travel, angle) in reached.commands_m.iter().zip([210.0_f64, 330.0, 90.0]) {
        let (x, y) = (
            0.14 * angle.to_radians().cos(),
            0.14 * angle.to_radians().sin(),
        );
        let across = (effector.x - x).powi(2) + (effector.y - y).powi(2);
        let carriage = effector.z + (0.333_f64.powi(2) - across).sqrt();
        let at_endstop = 0.3 + (0.333_f64.powi(2) - 0.14_f64.powi(2)).sqrt();
        assert!((at_endstop - carriage - travel).abs() < 1e-12);
    }
}

/// A printer of lines: |A − x| − |A| = line paid out.
#[test]
fn drums_pay_out_line_with_build_up() {
    let machine = machine(DESCRIBED[7].1, "Full");
    let x = Vector3::new(0.2, -0.1, 0.3);
    let reached = machine
        .inverse_position(x.into(), &InverseOptions::default())
        .unwrap();
    let anchors = [
        [0.0, -1.62, -0.15],
        [1.273, 1.273, -0.15],
        [-1.403, 0.81, -0.15],
        [0.0, 0.0, 2.35],
    ];
    for ((q, anchor), parts) in reached
        .commands_m
        .iter()
        .zip(anchors)
        .zip([2.0, 2.0, 2.0, 4.0])
    {
        let anchor = Vector3::from(anchor);
        let turn = q / 12.75;
        let paid_out = turn * 0.075 / parts - 14e-6 * turn * turn / (4.0 * parts);
        let closure = (anchor - x).norm() - anchor.norm() - paid_out;
        assert!(closure.abs() < 1e-12, "{closure}");
    }
}

/// Joints on carts by formulas stand where a formula by hand puts them; cranks have no lines.
#[test]
fn lines_of_joints_follow_from_formulas() {
    let delta = machine(DESCRIBED[0].1, "Scaled");
    let (radius, endstop, arm) = (0.14_f64, 0.3, 0.333_f64);
    for (track, degrees) in [210.0_f64, 330.0, 90.0].into_iter().enumerate() {
        let [line] = delta.joint_lines(track)[..] else {
            panic!("one joint rides on each cart");
        };
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let height = endstop + (arm.powi(2) - radius.powi(2)).sqrt();
        let expected = Vector3::new(radius * cosine, radius * sine, height);
        assert!((line[0] - expected).norm() < 1e-12, "{track}: {line:?}");
        assert!((line[1] + Vector3::z()).norm() < 1e-12, "{track}: {line:?}");
    }
    assert!(machine(DESCRIBED[1].1, "Full").joint_lines(0).is_empty());
}

/// Of a plate that four drives move, the pose that is found is nearer to the one that is asked for than those at commands
/// beside it, position and turn taken together as the plate's joints take them; one that it can take is taken.
#[test]
fn the_nearest_pose_is_nearest() {
    let machine = machine(include_str!("../../tests/robots/four_of_six.tau"), "Full");
    assert_eq!(machine.partial_freedoms(), Some(4));
    let anywhere = Pose::from_zyz([0.0; 3], [0.0; 3]);
    let home = machine.at_reference(&Sample::new(anywhere, &[])).unwrap();
    let options = InverseOptions::default();
    let commands = [0.02, 0.03, 0.01, -0.5];
    let there = machine
        .forward_along(&home.commands_m, &Sample::new(home.pose, &commands))
        .unwrap();
    let taken = machine
        .inverse_nearest(&home, there.pose, &options)
        .unwrap();
    for (found, given) in taken.commands_m.iter().zip(commands) {
        assert!((found - given).abs() < 1e-7, "{found} {given}");
    }
    let asked = there.pose.moved(
        Vector3::new(2e-3, -1e-3, 1e-3),
        Vector3::new(0.01, 0.02, -0.015),
    );
    let found = machine.inverse_nearest(&home, asked, &options).unwrap();
    let closures = machine
        .closures(&Sample::new(home.pose, &home.commands_m))
        .unwrap();
    let turning = closures.jacobian.columns(3, 3);
    let lever_m = (turning.norm_squared() / turning.nrows() as f64).sqrt();
    let off = |pose: &Pose| {
        let turn_m = pose.turn_to(&asked.rotation) * lever_m;
        ((pose.position - asked.position).norm_squared() + turn_m.norm_squared()).sqrt()
    };
    let least = off(&found.pose);
    assert!(least > 1e-4 && least < off(&there.pose), "{least}");
    for command in 0..machine.robot.commands {
        for change in [-1e-4, 1e-4] {
            let mut beside = found.commands_m.clone();
            beside[command] += change;
            let sample = Sample::new(found.pose, &beside);
            let beside = machine.forward_along(&found.commands_m, &sample).unwrap();
            assert!(off(&beside.pose) > least, "{command} {change}");
        }
    }
}

/// Eight cables on drums, as drawn, at commands of a machine whose anchors stand centimetres elsewhere: the cables contradict
/// each other by millimetres, and steps by the tangent alone would turn the plate to and fro. No pose nearby is better.
#[test]
fn cables_that_contradict_each_other_have_a_pose() {
    let drum = "length = norm(track_offset - plate_joint - (0 m, 0 m, 1.2 m)) + radius*q;";
    let mut links = String::new();
    for (index, (joint, anchor)) in [("0.25", "0.2"), ("-0.15", "2.4")].iter().enumerate() {
        for (corner, (x, y)) in [("-", "-"), ("-", ""), ("", "-"), ("", "")]
            .iter()
            .enumerate()
        {
            links += &format!(
                "link c{} actuated angle {{ {drum} plate_joint = ({x}0.25, {y}0.2, {joint}) m tol 1 mm; \
                 track_offset = ({x}2, {y}1.5, {anchor}) m tol 20 mm; }}\n",
                4 * index + corner
            );
        }
    }
    let text = format!(
        "robot Eight {{ param radius: m/rad = 8 mm/rad tol 60 um/rad; cluster cables on base {{ {links} }}
         reference {{ commands = (0, 0, 0, 0, 0, 0, 0, 0) rad; position = (0, 0, 1.2) m; }}
         variant Full {{ arm full; }} }}"
    );
    let machine = machine(&text, "Full");
    let commands = [
        -82.979_642_704_3,
        -61.400_482_202_5,
        50.939_442_713_5,
        65.169_735_724_8,
        -44.102_476_636_5,
        -26.104_521_320_3,
        79.610_206_146_1,
        92.324_006_074_1,
    ];
    let start = Pose::from_zyz([-0.745_36, -0.124_21, 0.951_55], [-0.062_8, 0.045, 0.089_4]);
    let found = machine
        .forward_fitted(&Sample::new(start, &commands))
        .unwrap();
    let missed_m = |pose: Pose| {
        let closures = machine.closures(&Sample::new(pose, &commands)).unwrap();
        closures.residuals.norm()
    };
    let least_m = missed_m(found.pose);
    assert!(least_m > 1e-3, "{least_m}");
    for &freedom in machine.pose_unknowns() {
        for amount in [-1e-4, 1e-4] {
            let beside_m = missed_m(moved(&found.pose, freedom, amount));
            assert!(beside_m > least_m, "{freedom} {amount}: {beside_m}");
        }
    }
}

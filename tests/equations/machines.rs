//! The standard robots: their equations against dual numbers, and their generated code against the interpreter.

use tau::Robot;

use crate::derivatives::{check_bit_for_bit, check_robot};

#[test]
fn equations_of_standard_robots_agree_with_dual_numbers() {
    for (_, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let model = tau_model_dsl::check_text(&robot.description).unwrap();
        check_robot(&robot, &model, 0..4);
    }
}

#[test]
fn generated_code_of_standard_robots_is_the_interpreters_bit_for_bit() {
    for (name, robot) in tau_generated::ROBOTS {
        let generated = Robot::from(robot);
        let interpreted = Robot::from_text(&generated.description)
            .unwrap_or_else(|errors| panic!("{name}: {errors}"));
        assert_eq!(generated.plate, interpreted.plate, "{name}");
        assert_eq!(generated.drives, interpreted.drives, "{name}");
        check_bit_for_bit(&generated, &interpreted);
    }
}

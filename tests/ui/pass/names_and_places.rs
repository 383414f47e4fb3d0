//! A robot that is declared within a function, and robots of the names of the runtime's own tables.

extern crate self as tau;
pub use tau_runtime as runtime;

use runtime::DeclaredRobot;

tau_macro::tau_model! {
    pub robot Robot {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Nominal { arm reduced; tracks linear; }
    }
}

tau_macro::tau_model! {
    robot Variant {
        track one;
        cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Full { arm full; tracks linear; }
    }
}

fn main() {
    tau_macro::tau_model! {
        robot Slide {
            track one;
            cluster arm on one { link l1, l2, l3, l4, l5, l6; }
            variant Nominal { arm reduced; tracks linear; }
        }
    }
    let names = [
        Slide::NOMINAL.name(),
        slide::nominal::ARM_LENGTH.name(),
        variant::full::L1_LENGTH.name(),
        <Robot as DeclaredRobot>::ROBOT.variants[Robot::NOMINAL.index()].name,
    ];
    assert_eq!(names, ["Nominal", "arm.length", "l1.length", "Nominal"]);
    assert_eq!(Variant::ROBOT.name, "Variant");
}

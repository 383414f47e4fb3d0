//! Robot files.

use super::{Answers, ROBOT};

#[test]
fn values() {
    let mut answers = Answers::default();
    answers.robot("empty", ROBOT, "");
    answers.robot("syntax", "q_m = [-0.65, 0.70]", "q_m = [-0.65 0.70");
    answers.robot("duplicate key", "rotation_rad", "position_m");
    answers.robot("unknown key", "position_m", "positon_m");
    answers.robot("unknown section", "[range]", "[ranges]");
    answers.robot("missing key", "rotation_rad = 4.0e-5\n", "");
    answers.robot("missing tolerance", "2.04, tol = 3.0e-4", "2.04");
    answers.robot(
        "missing value of a link",
        "length_m = { value = 2.04, tol = 3.0e-4 }\n",
        "",
    );
    answers.robot(
        "missing link",
        &ROBOT[ROBOT.find("[links.right]").unwrap()..],
        "",
    );
    answers.robot(
        "of another robot",
        ROBOT,
        "robot = \"Hexapod\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n",
    );
    answers.robot("misspelt link", "[links.right]", "[links.rigth]");
    answers.robot(
        "negative tolerance",
        "2.04, tol = 3.0e-4",
        "2.04, tol = -3.0e-4",
    );
    answers.robot("tolerance of zero", "2.04, tol = 3.0e-4", "2.04, tol = 0");
    answers.robot(
        "infinite tolerance",
        "2.04, tol = 3.0e-4",
        "2.04, tol = inf",
    );
    answers.robot("NaN", "value = 2.04", "value = nan");
    answers.robot("text", "value = 2.04", "value = \"2.04\"");
    answers.robot("no table", "{ value = 2.04, tol = 3.0e-4 }", "2.04");
    answers.robot(
        "two components",
        "[-0.049, -0.053, -0.103]",
        "[-0.049, -0.053]",
    );
    answers.robot("one component", "[-0.049, -0.053, -0.103]", "-0.049");
    answers.robot("length in millimetres", "2.04", "2040");
    answers.robot("negative length", "2.04", "-2.04");
    answers.robot(
        "plate joint in millimetres",
        "[-0.049, -0.053, -0.103]",
        "[-49, -53, -103]",
    );
    answers.robot(
        "offset in millimetres",
        "[-3.184, -4.969, 0.777]",
        "[-3184, -4969, 777]",
    );
    answers.robot(
        "direction of length zero",
        "[0.997, -0.067, -0.007]",
        "[0, 0, 0]",
    );
    answers.robot("range in millimetres", "[-0.65, 0.70]", "[-650, 700]");
    answers.robot("range backwards", "[-0.65, 0.70]", "[0.70, -0.65]");
    answers.robot("noise of zero", "1.0e-5", "0.0");
    answers.robot("noise of a metre", "1.0e-5", "1.0");
    answers.robot("noise of an atom", "1.0e-5", "1.0e-13");
    answers.robot(
        "tolerance of an atom",
        "2.04, tol = 3.0e-4",
        "2.04, tol = 1e-300",
    );
    answers.robot(
        "tolerance of a thousand kilometres",
        "2.04, tol = 3.0e-4",
        "2.04, tol = 1e6",
    );
    answers.robot(
        "number to base 16",
        "2.04, tol = 3.0e-4",
        "2.04, tol = 0x10",
    );
    for (case, gravity) in [
        ("gravity upwards", "9.81"),
        ("gravity in other units", "-981.0"),
    ] {
        let payload = format!(
            "[payload]\nmass_kg = 39.0\ncentre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, 0.0, {gravity}]\n\n[range]"
        );
        answers.robot(case, "[range]", &payload);
    }
    answers.robot(
        "another robot's links",
        "robot = \"Pair\"",
        "robot = \"Trio\"\n[links.middle]",
    );
    answers.robot(
        "effect without place",
        "[range]",
        "[effects.rack_pitch]\n[range]",
    );
    answers.robot(
        "effect elsewhere",
        "[range]",
        "[effects.\"rack_pitch(three)\"]\n[range]",
    );
    answers.robot(
        "negative number of poses",
        "[range]",
        "[calibration]\nprogram = \"tau 0.2.0\"\ndate = \"2026-01-01\"\nvariant = \"Full\"\nsplit = \"all\"\nposes = -3\n\
         folder = \"\"\ndescription = \"\"\ncommands_m = []\nposition_m = []\n\n[range]",
    );
    insta::assert_snapshot!(answers.0);
}

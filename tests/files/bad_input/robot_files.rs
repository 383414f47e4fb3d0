//! Robot files.

use super::*;

/// Case, a stretch of the file, what stands in its place, and the answer.
const CASES: &str = r#"
syntax                  | [-0.65, 0.70]            | [-0.65 0.70                    | T240:8
duplicate key           | rotation_rad             | position_m                     | T241:5
unknown key             | position_m               | positon_m                      | T242:3 T243:4
unknown section         | [range]                  | [ranges]                       | T243:7
missing key             | rotation_rad = 4.0e-5\n  |                                | T242:3
missing tolerance       | 2.04, tol = 3.0e-4       | 2.04                           | T242:11
no length of a link     | length_m = { value = 2.04, tol = 3.0e-4 }\n | \n          | T242:10
misspelt link           | [links.right]            | [links.rigth]                  | T248:16
negative tolerance      | 2.04, tol = 3.0e-4       | 2.04, tol = -3.0e-4            | T223:11
tolerance of zero       | 2.04, tol = 3.0e-4       | 2.04, tol = 0                  | T223:11
infinite tolerance      | 2.04, tol = 3.0e-4       | 2.04, tol = inf                | T217:11
NaN                     | value = 2.04             | value = nan                    | T217:11
text                    | value = 2.04             | value = "2.04"                 | T244:11
no table                | { value = 2.04, tol = 3.0e-4 } | 2.04                     | T244:11
two components          | -0.053, -0.103           | -0.053                         | T246:12
one component           | [-0.049, -0.053, -0.103] | -0.049                         | T244:12
length in millimetres   | 2.04                     | 2040                           | T221:11
negative length         | 2.04                     | -2.04                          | T223:11
joint in millimetres    | [-0.049, -0.053, -0.103] | [-49, -53, -103]               | T221:12
offset in millimetres   | [-3.184, -4.969, 0.777]  | [-3184, -4969, 777]            | T221:13
direction of length 0   | [0.997, -0.067, -0.007]  | [0, 0, 0]                      | T223:14
range in millimetres    | [-0.65, 0.70]            | [-650, 700]                    | T221:8
range backwards         | [-0.65, 0.70]            | [0.70, -0.65]                  | T247:8
noise of zero           | 1.0e-5                   | 0.0                            | T223:4
noise of a metre        | 1.0e-5                   | 1.0                            | T223:4
noise of an atom        | 1.0e-5                   | 1.0e-13                        | T223:4
tolerance of an atom    | 2.04, tol = 3.0e-4       | 2.04, tol = 1e-300             | T223:11
tolerance of a thousand kilometres | 2.04, tol = 3.0e-4 | 2.04, tol = 1e6           | T221:11
number to base 16       | 2.04, tol = 3.0e-4       | 2.04, tol = 0x10               | T217:11
another robot's links   | robot = "Pair"           | robot = "Trio"\n[links.middle] | T253:1
effect without place    | [range]                  | [effects.rack_pitch]\n[range]  | T249:7
effect elsewhere        | [range]                  | [effects."rack_pitch(three)"]\n[range] | T248:7
"#;

#[test]
fn values() {
    let mut answers = Answers::default();
    let mut answer = |case: &str, text: &str, expected: &str| {
        let work = with("robot.toml", text);
        answers.read(case, ["robot.toml", expected], &work, read_robot(&work));
    };
    for [case, old, new, expected] in cases(CASES) {
        answer(&case, &replaced(ROBOT, &old, &new), &expected);
    }
    answer("empty", "", "T242:1 T242:1 T242:1 T242:1");
    let (one_link, _) = ROBOT.split_once("[links.right]").unwrap();
    answer("missing link", one_link, "T242:10");
    let head = "robot = \"Hexapod\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    answer("of another robot", head, "T253:1");
    let before_range = |text: &str| ROBOT.replace("[range]", &format!("{text}\n[range]"));
    for (case, gravity) in [
        ("gravity upwards", 9.81),
        ("gravity in other units", -981.0),
    ] {
        let payload = format!(
            "[payload]\nmass_kg = 39.0\ncentre_m = [0, 0, 0]\ngravity_m_s2 = [0, 0, {gravity}]\n"
        );
        answer(case, &before_range(&payload), "T223:10");
    }
    let record = "[calibration]\nprogram = \"tau\"\ndate = \"\"\nvariant = \"Full\"\nsplit = \"all\"\nposes = -3\n\
                  folder = \"\"\ndescription = \"\"\ncommands_m = []\nposition_m = []\n";
    answer("negative number of poses", &before_range(record), "T218:12");
    insta::assert_snapshot!(answers.shown());
}

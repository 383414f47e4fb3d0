//! Input that users get wrong: what each mistake is answered with.
//!
//! Each case changes one thing of a valid folder or robot file, written to disk as a user would have
//! it; the snapshots show the answers.

mod measurements;
mod properties;
mod robot_files;

use std::fs;
use std::path::Path;

use tau::input_error::InputError;
use tau::measurements::{Folder, Shape, Split};
use tau::robot::{Cluster, Link, Robot};
use tau::robot_file::RobotFile;

fn shape() -> Shape {
    Shape::of_carts(2)
}

const TCP_POSES: &str = "\
pose,time_s,temperature_c,q1_m,q2_m,dir1,dir2,x_m,y_m,z_m,alpha_rad,beta_rad,gamma_rad
1,0,20.0,-0.507,-0.064,1,1,-1.903,-4.719,-0.370,1.484,1.765,-1.546
2,30,20.1,-0.617,-0.199,-1,-1,-1.904,-4.720,-0.170,1.483,1.764,-1.545
3,60,20.0,-0.421,0.122,1,1,-1.703,-4.721,0.030,1.482,1.766,-1.547
4,90,19.9,-0.333,0.251,1,1,-1.503,-4.522,0.031,1.481,1.767,-1.548
";
const CART_POSES: &str = "\
cart,point,q_m,x_m,y_m,z_m,alpha_rad,beta_rad,gamma_rad,time_s,temperature_c,dir
1,1,-0.65,-3.438,-5.782,-1.877,-1.907,1.182,1.554,0,20,1
1,2,0.70,-2.100,-5.601,-1.999,-1.906,1.183,1.555,20,20,1
2,1,-0.65,-3.338,-5.682,-1.777,-1.905,1.184,1.556,40,20,1
2,2,0.70,-2.000,-5.501,-1.899,-1.904,1.185,1.557,60,20,1
";
const CART_POSITIONS: &str = "\
pose,cart,q1_m,q2_m,x_m,y_m,z_m,time_s,temperature_c,dir
1,1,-0.146,-0.350,-2.131,-1.309,-2.677,10,20,1
1,2,-0.146,-0.350,-2.422,-0.943,-1.287,10,20,-1
2,1,0.311,0.122,-2.031,-1.209,-2.577,20,20,1
";
const ROBOT: &str = "\
robot = \"Pair\"

[noise]
position_m = 1.0e-5
rotation_rad = 4.0e-5

[range]
q_m = [-0.65, 0.70]

[links.left]
length_m = { value = 2.04, tol = 3.0e-4 }
plate_joint_m = { value = [-0.049, -0.053, -0.103], tol = 3.0e-4 }
track_offset_m = { value = [-3.184, -4.969, 0.777], tol = 1.0e-2 }
track_direction = { value = [0.997, -0.067, -0.007], tol = 1.0e-2 }

[links.right]
length_m = { value = 2.05, tol = 3.0e-4 }
plate_joint_m = { value = [-0.051, -0.115, -0.082], tol = 3.0e-4 }
track_offset_m = { value = [-3.132, -3.528, 0.799], tol = 1.0e-2 }
track_direction = { value = [0.998, -0.065, -0.005], tol = 1.0e-2 }
";

fn pair() -> Robot {
    let cluster = |name: &str, track| Cluster {
        name: name.into(),
        track: Some(track),
    };
    let link = |name: &str, cluster| Link {
        name: name.into(),
        cluster,
        actuated_by: None,
    };
    Robot {
        name: "Pair".into(),
        description: String::new(),
        tracks: vec!["one".into(), "two".into()],
        clusters: vec![cluster("arm1", 0), cluster("arm2", 1)],
        links: vec![link("left", 0), link("right", 1)],
        commands: 2,
        ..Robot::default()
    }
}

/// A measurement folder on disk, valid at first.
struct OnDisk(tempfile::TempDir);

impl OnDisk {
    fn valid() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder
            .write("tcp_poses.csv", TCP_POSES)
            .write("cart_poses.csv", CART_POSES)
            .write("cart_positions.csv", CART_POSITIONS)
            .write("robot.toml", ROBOT);
        folder
    }

    fn write(&self, file: &str, bytes: impl AsRef<[u8]>) -> &Self {
        fs::write(self.0.path().join(file), bytes).unwrap();
        self
    }

    fn remove(&self, file: &str) -> &Self {
        fs::remove_file(self.0.path().join(file)).unwrap();
        self
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn read(&self) -> Result<Folder, InputError> {
        Folder::read(self.path(), &shape())
    }

    fn read_robot(&self) -> Result<RobotFile, InputError> {
        RobotFile::read(&self.path().join("robot.toml"), &pair())
    }

    /// The answer to a mistake, without this machine's paths.
    fn answer<T>(&self, result: Result<T, InputError>) -> String {
        match result {
            Ok(_) => "accepted".to_owned(),
            Err(error) => error
                .render(false)
                .replace(&self.path().display().to_string(), "folder")
                .replace(std::path::MAIN_SEPARATOR, "/"),
        }
    }
}

/// Collects answers under the names of their cases.
#[derive(Default)]
struct Answers(String);

impl Answers {
    fn add(&mut self, case: &str, answer: &str) {
        let line = "-".repeat(case.len());
        self.0.extend([case, "\n", &line, "\n", answer, "\n\n"]);
    }

    /// The answer when one file of a valid folder has other contents.
    fn file(&mut self, case: &str, file: &str, contents: impl AsRef<[u8]>) {
        let folder = OnDisk::valid();
        folder.write(file, contents);
        self.add(case, &folder.answer(folder.read()));
    }

    /// The answer when a stretch of `tcp_poses.csv` is replaced.
    fn tcp_poses(&mut self, case: &str, old: &str, new: &str) {
        self.file(case, "tcp_poses.csv", replaced(TCP_POSES, old, new));
    }

    /// The answer when a stretch of `robot.toml` is replaced.
    fn robot(&mut self, case: &str, old: &str, new: &str) {
        let folder = OnDisk::valid();
        folder.write("robot.toml", replaced(ROBOT, old, new));
        self.add(case, &folder.answer(folder.read_robot()));
    }
}

/// The text with its first match replaced; there must be one.
fn replaced(text: &str, old: &str, new: &str) -> String {
    assert!(text.contains(old), "`{old}` is not in the text");
    text.replacen(old, new, 1)
}

/// Every number of some columns multiplied.
fn scaled(text: &str, columns: &[&str], factor: f64) -> String {
    let (header, rows) = text.split_once('\n').unwrap();
    let is_scaled: Vec<bool> = header
        .split(',')
        .map(|name| columns.contains(&name))
        .collect();
    let scale = |row: &str| {
        let fields = row.split(',').zip(&is_scaled).map(|(field, &is_scaled)| {
            if is_scaled {
                (field.parse::<f64>().unwrap() * factor).to_string()
            } else {
                field.into()
            }
        });
        fields.collect::<Vec<String>>().join(",")
    };
    let rows: Vec<String> = rows.lines().map(scale).collect();
    format!("{header}\n{}\n", rows.join("\n"))
}

#[test]
fn valid_input_is_accepted() {
    let folder = OnDisk::valid();
    let read = folder.read().unwrap();
    let lengths = (
        read.tcp_poses.len(),
        read.cart_poses.len(),
        read.cart_positions.len(),
    );
    assert_eq!(lengths, (4, 4, 3));
    assert_eq!(read.remarks, []);
    assert_eq!(folder.read_robot().unwrap().links.len(), 2);
}

#[test]
fn harmless_variations_are_accepted() {
    let plain = OnDisk::valid().read().unwrap();
    let variations = [
        TCP_POSES.replace('\n', "\r\n"),
        TCP_POSES.replace('\n', "\r"),
        format!("\u{feff}{TCP_POSES}"),
        format!("{TCP_POSES}\n \n\n"),
        TCP_POSES.trim_end().to_owned(),
        TCP_POSES.replace(',', " ,\t"),
        TCP_POSES
            .replace("-1.903", "\"-1.903\"")
            .replace("x_m", "\"x_m\""),
        TCP_POSES.replace("\n1,", "\n1.0000000e+00,"),
    ];
    for variation in variations {
        let folder = OnDisk::valid();
        folder.write("tcp_poses.csv", &variation);
        assert_eq!(
            folder.read().unwrap().tcp_poses,
            plain.tcp_poses,
            "{variation}"
        );
    }
}

#[test]
fn columns_may_come_in_any_order() {
    let reversed: Vec<String> = TCP_POSES
        .lines()
        .map(|line| line.split(',').rev().collect::<Vec<_>>().join(","))
        .collect();
    let folder = OnDisk::valid();
    let plain = folder.read().unwrap();
    folder.write("tcp_poses.csv", reversed.join("\n"));
    assert_eq!(folder.read().unwrap().tcp_poses, plain.tcp_poses);
}

#[test]
fn missing_sets_and_columns_are_remarked() {
    let folder = OnDisk::valid();
    folder.remove("cart_poses.csv").remove("cart_positions.csv");
    let with_note: Vec<String> = TCP_POSES
        .replace("dir2", "note")
        .lines()
        .map(|line| format!("{line},\"a, b\","))
        .collect();
    folder.write("tcp_poses.csv", with_note.join("\n"));
    let read = folder.read().unwrap();
    assert_eq!(read.tcp_poses[0].directions, None);
    let remarks: Vec<&str> = (read.remarks.iter())
        .map(|remark| remark.text.as_str())
        .collect();
    insta::assert_snapshot!(remarks.join("\n"));
}

#[test]
fn files() {
    let mut answers = Answers::default();
    let folder = OnDisk::valid();
    let missing = Folder::read(&folder.path().join("nowhere"), &shape());
    answers.add("missing folder", &folder.answer(missing));
    let file = Folder::read(&folder.path().join("robot.toml"), &shape());
    answers.add("file in place of a folder", &folder.answer(file));
    folder.remove("tcp_poses.csv");
    answers.add("missing file", &folder.answer(folder.read()));
    folder.write("tcp_pose.csv", TCP_POSES);
    answers.add("misnamed file", &folder.answer(folder.read()));
    folder.remove("robot.toml");
    answers.add("missing robot file", &folder.answer(folder.read_robot()));
    let of_folder = RobotFile::read(folder.path(), &pair());
    answers.add("folder in place of a robot file", &folder.answer(of_folder));
    answers.file("empty file", "tcp_poses.csv", "");
    answers.file("blank file", "tcp_poses.csv", "\n  \n");
    answers.file(
        "header only",
        "tcp_poses.csv",
        TCP_POSES.lines().next().unwrap(),
    );
    let latin1 = [TCP_POSES.as_bytes(), b"5,caf\xe9\n"].concat();
    answers.file("not UTF-8", "tcp_poses.csv", latin1);
    answers.file("UTF-16", "tcp_poses.csv", b"\xff\xfep\x00o\x00");
    insta::assert_snapshot!(answers.0);
}

#[test]
fn headers() {
    let mut answers = Answers::default();
    let rows = TCP_POSES.split_once('\n').unwrap().1;
    answers.file("no header", "tcp_poses.csv", rows);
    answers.file("wrong header", "tcp_poses.csv", "a,b,c\n1,2,3\n");
    answers.tcp_poses("misspelt column", "q2_m", "q2m");
    answers.tcp_poses("column in another unit", "alpha_rad", "alpha_deg");
    answers.tcp_poses("capital letters", "x_m,y_m", "X_M,Y_M");
    answers.tcp_poses("duplicate column", "y_m", "x_m");
    answers.file("semicolons", "tcp_poses.csv", TCP_POSES.replace(',', ";"));
    let german = TCP_POSES.replace(',', ";").replace('.', ",");
    answers.file("semicolons and decimal commas", "tcp_poses.csv", german);
    answers.file("tabs", "tcp_poses.csv", TCP_POSES.replace(',', "\t"));
    answers.file("set 2 for set 1", "tcp_poses.csv", CART_POSES);
    insta::assert_snapshot!(answers.0);
}

#[test]
fn fields() {
    let mut answers = Answers::default();
    answers.tcp_poses("text in a number", "-0.199", "abc");
    answers.tcp_poses("NaN", "-0.199", "NaN");
    answers.tcp_poses("infinity", "-0.199", "-inf");
    answers.tcp_poses("overflow", "-0.199", "1e999");
    answers.tcp_poses("empty field", "-0.199", "");
    answers.tcp_poses("quoted decimal comma", "-0.199", "\"-0,199\"");
    answers.tcp_poses("typographic minus", "-0.199", "\u{2212}0.199");
    answers.tcp_poses("fractional pose", "\n2,", "\n2.5,");
    answers.tcp_poses("negative pose", "\n2,", "\n-2,");
    answers.tcp_poses("duplicate pose", "\n3,", "\n1,");
    answers.tcp_poses("direction", "-1,-1", "-1,0");
    answers.tcp_poses("kelvin", "20.1", "293.2");
    answers.tcp_poses("row too short", ",-1.545", "");
    answers.tcp_poses("row too long", "-1.545", "-1.545,7");
    let decimal_commas = TCP_POSES.replace('.', ",");
    answers.file("decimal commas", "tcp_poses.csv", decimal_commas);
    answers.file(
        "cart number",
        "cart_poses.csv",
        replaced(CART_POSES, "\n2,1", "\n3,1"),
    );
    answers.file(
        "cart zero",
        "cart_positions.csv",
        replaced(CART_POSITIONS, "1,1,", "1,0,"),
    );
    answers.file(
        "duplicate point",
        "cart_poses.csv",
        replaced(CART_POSES, "2,2,0", "2,1,0"),
    );
    answers.file(
        "duplicate position",
        "cart_positions.csv",
        replaced(CART_POSITIONS, "1,2", "1,1"),
    );
    insta::assert_snapshot!(answers.0);
}

#[test]
fn units() {
    let mut answers = Answers::default();
    let degrees = 180.0 / std::f64::consts::PI;
    let angles = ["alpha_rad", "beta_rad", "gamma_rad"];
    let position = ["x_m", "y_m", "z_m"];
    answers.file(
        "degrees",
        "tcp_poses.csv",
        scaled(TCP_POSES, &angles, degrees),
    );
    answers.file(
        "one column in degrees",
        "tcp_poses.csv",
        scaled(TCP_POSES, &angles[1..2], degrees),
    );
    answers.tcp_poses("one angle in degrees", "1.482", "84.912");
    answers.file(
        "positions in millimetres",
        "tcp_poses.csv",
        scaled(TCP_POSES, &position, 1e3),
    );
    answers.file(
        "commands in millimetres",
        "tcp_poses.csv",
        scaled(TCP_POSES, &["q1_m", "q2_m"], 1e3),
    );
    answers.tcp_poses("one position in millimetres", "-1.703", "-1703");
    answers.file(
        "cart poses in millimetres",
        "cart_poses.csv",
        scaled(CART_POSES, &position, 1e3),
    );
    answers.file(
        "cart commands in millimetres",
        "cart_poses.csv",
        scaled(CART_POSES, &["q_m"], 1e3),
    );
    answers.file(
        "cart angles in degrees",
        "cart_poses.csv",
        scaled(CART_POSES, &angles, degrees),
    );
    answers.file(
        "cart positions in millimetres",
        "cart_positions.csv",
        scaled(CART_POSITIONS, &position, 1e3),
    );
    insta::assert_snapshot!(answers.0);
}

#[test]
fn legitimate_magnitudes_are_accepted() {
    let shifted = |by: f64| {
        let mut lines = TCP_POSES.lines().map(str::to_owned).collect::<Vec<_>>();
        for line in &mut lines[1..] {
            let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            fields[7] = (fields[7].parse::<f64>().unwrap() + by).to_string();
            *line = fields.join(",");
        }
        lines.join("\n")
    };
    for text in [
        shifted(80.0),
        scaled(TCP_POSES, &["x_m", "y_m", "z_m"], 0.01),
        scaled(TCP_POSES, &["q1_m", "q2_m"], 20.0),
        scaled(TCP_POSES, &["alpha_rad"], 4.0),
    ] {
        let folder = OnDisk::valid();
        folder.write("tcp_poses.csv", &text);
        assert_eq!(folder.answer(folder.read()), "accepted", "{text}");
    }
}

#[test]
fn poses() {
    let mut answers = Answers::default();
    let row = TCP_POSES.lines().nth(1).unwrap();
    let (header, rest) = (
        TCP_POSES.lines().next().unwrap(),
        row.split_once(',').unwrap().1,
    );
    answers.file(
        "all poses equal",
        "tcp_poses.csv",
        format!("{header}\n1,{rest}\n2,{rest}\n3,{rest}\n"),
    );
    let still = scaled(TCP_POSES, &["q1_m", "q2_m"], 0.0);
    answers.file("all commands equal", "tcp_poses.csv", still);
    let folder = OnDisk::valid();
    let read = folder.read().unwrap();
    let few = read.check_pose_count(2, 10, "variant `Full`, link `left`,");
    answers.add("fewer poses than parameters", &folder.answer(few));
    let all = [0, 1, 2, 3];
    let robot = folder.read_robot().unwrap();
    let far = {
        let mut read = read.clone();
        read.tcp_poses
            .iter_mut()
            .for_each(|pose| pose.commands_m[0] += 9.0);
        read.check_reach(&all, &pair(), &robot)
    };
    answers.add("commands outside every pose's reach", &folder.answer(far));
    let mut read = read;
    read.tcp_poses[2].commands_m[1] += 9.0;
    answers.add(
        "one command out of reach",
        &folder.answer(read.check_reach(&all, &pair(), &robot)),
    );
    insta::assert_snapshot!(answers.0);
}

#[test]
fn several_mistakes_are_answered_together() {
    let folder = OnDisk::valid();
    folder.write(
        "tcp_poses.csv",
        TCP_POSES.replace("-0.199", "abc").replace("19.9", "?"),
    );
    folder.write("cart_positions.csv", CART_POSITIONS.replace("q2_m", "q3_m"));
    insta::assert_snapshot!(folder.answer(folder.read()));
}

#[test]
fn of_a_hundred_mistakes_the_first_twenty_are_listed() {
    let (header, row) = (
        TCP_POSES.lines().next().unwrap(),
        TCP_POSES.lines().nth(1).unwrap(),
    );
    let row = row.replace("-4.719", "x");
    let fields: Vec<&str> = row.split(',').collect();
    let rows: Vec<String> = (1..=100)
        .map(|pose| {
            format!(
                "{pose},{},0.{pose},{}",
                fields[1..3].join(","),
                fields[4..].join(",")
            )
        })
        .collect();
    let folder = OnDisk::valid();
    folder.write("tcp_poses.csv", format!("{header}\n{}", rows.join("\n")));
    let error = folder.read().unwrap_err();
    let lines: Vec<usize> = error
        .problems()
        .iter()
        .map(|p| p.place.as_ref().unwrap().line)
        .collect();
    assert_eq!(lines, (2..22).collect::<Vec<_>>());
    assert!(
        error
            .render(false)
            .ends_with("note: 80 more errors are not listed")
    );
}

#[test]
fn splits() {
    let mut answers = Answers::default();
    for text in [
        "",
        "altrnate",
        "first",
        "first:x",
        "first:0",
        "fraction:1.5",
        "fraction:0.5:x",
    ] {
        let error = text.parse::<Split>().unwrap_err();
        answers.add(&format!("`{text}`"), &error.render(false));
    }
    insta::assert_snapshot!(answers.0);
}

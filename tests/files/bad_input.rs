//! Input that users get wrong: each case changes one thing of a valid folder on disk. Codes and lines are asserted, texts
//! shown by a snapshot for each kind of file.

mod other_measurements;
mod properties;
mod robot_files;
mod three_sets;

use tau::input_error::InputError;
use tau::measurements::{Folder, Shape};
use tau::robot::{Cluster, Link, Robot};
use tau::robot_file::RobotFile;
use tau_testkit::Work;

use crate::answers::{Answers, cases, replaced};

const TCP: &str = "tcp_poses.csv";
const TCP_POSES: &str = include_str!("bad_input/valid/tcp_poses.csv");
const CART_POSES: &str = include_str!("bad_input/valid/cart_poses.csv");
const CART_POSITIONS: &str = include_str!("bad_input/valid/cart_positions.csv");
const ROBOT: &str = include_str!("bad_input/valid/robot.toml");
const SETS: [(&str, &str); 4] = [
    (TCP, TCP_POSES),
    ("cart_poses.csv", CART_POSES),
    ("cart_positions.csv", CART_POSITIONS),
    ("robot.toml", ROBOT),
];

/// Two links on two carts.
fn pair() -> Robot {
    let cluster = |name: &str, track| Cluster {
        name: name.into(),
        track: Some(track),
    };
    let link = |name: &str, cluster| Link {
        name: name.into(),
        cluster,
        ..Link::default()
    };
    Robot {
        name: "Pair".into(),
        tracks: vec!["one".into(), "two".into()],
        clusters: vec![cluster("arm1", 0), cluster("arm2", 1)],
        links: vec![link("left", 0), link("right", 1)],
        commands: 2,
        ..Robot::default()
    }
}

/// A folder that holds these files of measurements.
fn folder_of<'a>(files: impl IntoIterator<Item = &'a (&'a str, &'a str)>) -> Work {
    let work = Work::empty();
    for (file, text) in files {
        work.write(&format!("measured/{file}"), text);
    }
    work
}

/// The valid folder with one file of other contents.
fn with(file: &str, contents: impl AsRef<[u8]>) -> Work {
    let work = folder_of(&SETS);
    work.write(&format!("measured/{file}"), contents);
    work
}

fn read(work: &Work) -> Result<Folder, InputError> {
    Folder::read(&work.measured(), &Shape::of_carts(2))
}

fn read_robot(work: &Work) -> Result<RobotFile, InputError> {
    RobotFile::read(&work.measured().join("robot.toml"), &pair())
}

#[test]
fn valid_input_is_accepted() {
    let work = folder_of(&SETS);
    let read = read(&work).unwrap();
    let rows = [
        read.tcp_poses.len(),
        read.cart_poses.len(),
        read.cart_positions.len(),
    ];
    assert_eq!(rows, [4, 4, 3]);
    assert_eq!(read.remarks, []);
    assert_eq!(read_robot(&work).unwrap().links.len(), 2);
}

#[test]
fn whole_files() {
    let mut answers = Answers::default();
    let work = folder_of(&SETS);
    let of = |name: &str| Folder::read(&work.path().join(name), &Shape::of_carts(2));
    answers.read("missing folder", ["nowhere", "T203"], &work, of("nowhere"));
    let file = of("measured/robot.toml");
    answers.read(
        "file in place of a folder",
        ["robot.toml", "T204"],
        &work,
        file,
    );
    let folder = RobotFile::read(&work.measured(), &pair());
    answers.read(
        "folder in place of a robot file",
        ["measured", "T202"],
        &work,
        folder,
    );
    work.remove("measured/robot.toml");
    let missing = read_robot(&work);
    answers.read("missing robot file", ["robot.toml", "T201"], &work, missing);
    work.remove("measured/tcp_poses.csv");
    answers.read("missing file", [TCP, "T201"], &work, read(&work));
    work.write("measured/tcp_pose.csv", TCP_POSES);
    answers.read(
        "misnamed file",
        ["tcp_pose.csv", "T230:1"],
        &work,
        read(&work),
    );
    let header = TCP_POSES.lines().next().unwrap();
    let latin1 = [TCP_POSES.as_bytes(), b"5,caf\xe9\n"].concat();
    for (case, expected, contents) in [
        ("empty file", "T210:1", b"".as_slice()),
        ("blank file", "T210:1", b"\n  \n"),
        ("header only", "T210:1", header.as_bytes()),
        ("not UTF-8", "T206:6", &latin1),
        ("UTF-16", "T206", b"\xff\xfep\x00o\x00"),
    ] {
        let work = with(TCP, contents);
        answers.read(case, [TCP, expected], &work, read(&work));
    }
    insta::assert_snapshot!(answers.shown());
}

/// Mistakes of several files are told together, of many in one the first twenty.
#[test]
fn several_mistakes_are_answered_together() {
    let mut answers = Answers::default();
    let work = with(TCP, TCP_POSES.replace("-0.199", "abc").replace("19.9", "?"));
    let other = CART_POSITIONS.replace("q2_m", "q3_m");
    work.write("measured/cart_positions.csv", other);
    let expected = "T217:3 T217:5 T214@cart_positions.csv:1";
    answers.read("two files", [TCP, expected], &work, read(&work));

    insta::assert_snapshot!(answers.shown());

    let (header, _) = TCP_POSES.split_once('\n').unwrap();
    let row = "0,20.0,0.POSE,-0.064,1,1,-1.903,x,-0.370,1.484,1.765,-1.546";
    let rows = (1..=100).map(|pose| format!("\n{pose},{}", row.replace("POSE", &pose.to_string())));
    let work = with(TCP, header.to_owned() + &rows.collect::<String>());
    let error = read(&work).unwrap_err();
    let problems = error.problems().iter();
    let lines: Vec<usize> = problems
        .map(|own| own.place.as_ref().unwrap().line)
        .collect();
    assert_eq!(lines, (2..22).collect::<Vec<_>>());
    insta::assert_snapshot!(error.render(false).lines().last().unwrap());
}

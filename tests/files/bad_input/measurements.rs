//! Files that tell less than the plate's pose.

use std::fs;

use super::{Answers, OnDisk, ROBOT, TCP_POSES, replaced};
use crate::support::tau_in;

const HEIGHTS: &str = "\
pose,q1_m,q2_m,height_m
11,-0.507,-0.064,0.310
12,-0.617,-0.199,0.305
12,-0.617,-0.199,0.306
13,-0.421,0.122,0.298
";
const POSITIONS: &str = "\
pose,q1_m,q2_m,target,x_m,y_m,sigma_x_m
21,-0.507,-0.064,,-1.903,-4.719,1e-5
22,-0.617,-0.199,left,-1.904,,1e-5
23,-0.421,0.122,left,-1.703,-4.721,
";
const DISTANCES: &str = "\
pose_a,pose_b,distance_m
11,12,0.201
12,21,0.150
";
const READINGS: &str = "\
pose,q1_m,q2_m
31,-0.507,-0.064
32,-0.617,-0.199
";

fn valid() -> OnDisk {
    let folder = OnDisk::valid();
    folder
        .write("heights.csv", HEIGHTS)
        .write("tcp_positions.csv", POSITIONS)
        .write("distances.csv", DISTANCES)
        .write("readings.csv", READINGS);
    folder
}

#[test]
fn all_files_together_are_accepted() {
    let folder = valid();
    let read = folder.read().unwrap();
    assert_eq!((read.plate_rows.len(), read.distances.len()), (9, 2));
    assert_eq!(read.plate_rows[1].values, [Some(-1.904), None, None]);
    assert_eq!(read.plate_rows[1].of.as_deref(), Some("left"));
    assert_eq!(read.plate_rows[2].sigmas, [None; 3]);
    // None of the three sets is needed.
    folder
        .remove("tcp_poses.csv")
        .remove("cart_poses.csv")
        .remove("cart_positions.csv");
    assert_eq!(folder.read().unwrap().plate_rows.len(), 9);
}

#[test]
fn other_measurements() {
    let mut answers = Answers::default();
    let mut case = |name: &str, file: &str, contents: &str| {
        let folder = valid();
        folder.write(file, contents);
        answers.add(name, &folder.answer(folder.read()));
    };
    let heights = |old: &str, new: &str| replaced(HEIGHTS, old, new);
    case(
        "columns of another file",
        "heights.csv",
        &heights("height_m", "distance_m"),
    );
    case(
        "columns of no file",
        "heights.csv",
        &heights("height_m", "reading"),
    );
    case(
        "millimetres in the header",
        "heights.csv",
        &heights("height_m", "height_mm"),
    );
    case("millimetres", "heights.csv", &heights("0.310", "310"));
    let all = heights("0.310", "310")
        .replace("0.305", "305")
        .replace("0.306", "306")
        .replace("0.298", "298");
    case("millimetres throughout", "heights.csv", &all);
    case("no height", "heights.csv", &heights("0.305", ""));
    case("text", "heights.csv", &heights("0.305", "low"));
    case(
        "other commands at the same pose",
        "heights.csv",
        &heights("12,-0.617,-0.199,0.306", "12,-0.421,0.122,0.306"),
    );
    case(
        "a number of another file's pose",
        "heights.csv",
        &heights("11,", "1,").replace("-0.507,-0.064", "-0.333,0.251"),
    );
    case(
        "degrees of commands",
        "heights.csv",
        &heights("q1_m", "q1_deg"),
    );
    let positions = |old: &str, new: &str| replaced(POSITIONS, old, new);
    case(
        "noise of nothing that the file holds",
        "tcp_positions.csv",
        &positions("sigma_x_m", "sigma_height_m"),
    );
    case(
        "negative noise of a row",
        "tcp_positions.csv",
        &positions("1e-5", "-1e-5"),
    );
    case(
        "noise of a row in millimetres",
        "tcp_positions.csv",
        &positions("1e-5", "10"),
    );
    case(
        "a row that measures nothing",
        "tcp_positions.csv",
        &positions("-1.904,", ","),
    );
    let distances = |old: &str, new: &str| replaced(DISTANCES, old, new);
    case(
        "a pose that is nowhere",
        "distances.csv",
        &distances("12,21", "12,99"),
    );
    case(
        "a distance from itself",
        "distances.csv",
        &distances("11,12", "11,11"),
    );
    case(
        "a distance of zero",
        "distances.csv",
        &distances("0.201", "0"),
    );
    case(
        "distances in millimetres",
        "distances.csv",
        &distances("0.201", "201").replace("0.150", "150"),
    );
    case(
        "readings without commands",
        "readings.csv",
        "pose\n31\n32\n",
    );
    case("an empty file", "readings.csv", "");
    let folder = valid();
    for file in [
        "tcp_poses.csv",
        "heights.csv",
        "tcp_positions.csv",
        "distances.csv",
        "readings.csv",
    ] {
        folder.remove(file);
    }
    folder.write("hights.csv", HEIGHTS);
    answers.add("nothing of the plate", &folder.answer(folder.read()));
    folder.remove("hights.csv").write("probe.csv", HEIGHTS);
    answers.add("heights of another name", &folder.answer(folder.read()));
    // Their columns tell what they are, whatever names are nearer.
    folder
        .remove("probe.csv")
        .write("probes.csv", POSITIONS)
        .write("lengths.csv", DISTANCES);
    answers.add("positions of another name", &folder.answer(folder.read()));
    insta::assert_snapshot!(answers.0);
}

/// A calibration would silently lack them; notes and logs are nobody's measurements.
#[test]
fn measurements_under_other_names_are_refused() {
    let mut answers = Answers::default();
    let mut case = |name: &str, file: &str, contents: &str| {
        let folder = OnDisk::valid();
        folder.write(file, contents);
        answers.add(name, &folder.answer(folder.read()));
    };
    case("columns of one kind", "probe.csv", HEIGHTS);
    let semicolons = HEIGHTS.replace(',', ";");
    case("semicolons between them", "probe.csv", &semicolons);
    let copy = TCP_POSES.replace("x_m", " \"X_m\"");
    case("columns of a file that is there", "copy.csv", &copy);
    case("drives alone", "moves.csv", READINGS);
    let inclined = replaced(HEIGHTS, "height_m", "tilt_rad");
    case("columns of no kind", "inclinometer.csv", &inclined);
    let two = HEIGHTS.replace("height_m", "height_m,distance_m");
    case("columns of two kinds", "both.csv", &two);
    case("poses without commands", "sag.csv", "pose,sag_um\n11,4\n");
    case(
        "readings without poses",
        "dial.csv",
        "q1_m,q2_m,dial_mm\n0,0,1\n",
    );
    case("a path of commands", "path.csv", "q1_m,q2_m,dir1\n0,0,1\n");
    case("a log", "log.csv", "time_s,temperature_c\n0,20.1\n");
    case("a log by another name", "height.csv", "time_s,level\n0,1\n");
    case("an empty table", "notes.csv", "\n");
    case("no table", "notes.txt", HEIGHTS);
    insta::assert_snapshot!(answers.0);

    let folder = OnDisk::valid();
    folder
        .write("probe.csv", HEIGHTS)
        .write("distances.csv", "pose_a,pose_b,distance_m\n1,2,-1\n");
    let error = folder.read().unwrap_err().to_string();
    assert!(error.contains("probe.csv:1:1:"), "{error}");
    assert!(error.contains("distances.csv:2:"), "{error}");
}

#[test]
fn noise_and_places() {
    let mut answers = Answers::default();
    let mut case = |name: &str, text: &str| {
        answers.robot(name, "[range]", &format!("{text}\n[range]"));
    };
    case(
        "accepted",
        "[noise.heights]\nheight_m = \"estimate\"\n[drives]\nnoise_m = [1e-5, 2e-5]\n[balls.first]\nposition_m = { value = [0.1, 0.2, 0.3], tol = 0.01 }",
    );
    case(
        "another word for estimate",
        "[noise.heights]\nheight_m = \"unknown\"",
    );
    case(
        "a key of another kind",
        "[noise.heights]\ndistance_m = 1e-5",
    );
    case("a kind that is none", "[noise.hights]\nheight_m = 1e-5");
    case(
        "noise in millimetres",
        "[noise.distances]\ndistance_m = 0.5",
    );
    case("drives without noise", "[drives]");
    case(
        "a target without tolerance",
        "[targets.left]\nposition_m = [0.1, 0.2, 0.3]",
    );
    case(
        "a surface without offset",
        "[surfaces.bed]\nnormal = { value = [0, 0, 1], tol = 1e-3 }",
    );
    case(
        "a ball in millimetres",
        "[balls.first]\nposition_m = { value = [100, 200, 300], tol = 0.01 }",
    );
    insta::assert_snapshot!(answers.0);
}

/// A name that is misspelt would silently be that of a place which nobody knows.
#[test]
fn places_that_no_row_names_are_remarked() {
    let folder = valid();
    let read = folder.read().unwrap();
    let place = "position_m = { value = [0.1, 0.2, 0.3], tol = 0.01 }\n";
    let places =
        format!("[targets.left]\n{place}[targets.rigth]\n{place}[balls.\"1 b\"]\n{place}[range]");
    folder.write("robot.toml", replaced(ROBOT, "[range]", &places));
    let remark = folder.read_robot().unwrap().unused_places(&read);
    assert_eq!(
        remark.as_ref().map(|remark| remark.text.as_str()),
        Some(
            "robot.toml has `[targets.rigth]`, `[balls.\"1 b\"]`, which no row of the folder names in a column \
             `target`, `surface` or `ball`"
        )
    );
    folder.write("robot.toml", ROBOT);
    let remark = folder.read_robot().unwrap().unused_places(&read);
    assert_eq!(remark, None);

    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --measure heights --noise-position 1e-5 --poses 30 --out DIR/m";
    tau_in(folder.path(), line).done();
    let path = folder.path().join("m/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, format!("{text}\n[balls.first]\n{place}")).unwrap();
    let ran = tau_in(folder.path(), "tau check DIR/m");
    let expected = "note: robot.toml has `[balls.first]`, which no row of the folder names";
    assert!(ran.err.contains(expected), "{}", ran.err);
}

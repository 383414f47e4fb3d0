//! Tables that tell less than the plate's pose.

use super::*;

const HEIGHTS: &str = include_str!("valid/heights.csv");
const POSITIONS: &str = include_str!("valid/tcp_positions.csv");
const DISTANCES: &str = include_str!("valid/distances.csv");
const READINGS: &str = include_str!("valid/readings.csv");
const OTHERS: [(&str, &str); 4] = [
    ("heights.csv", HEIGHTS),
    ("tcp_positions.csv", POSITIONS),
    ("distances.csv", DISTANCES),
    ("readings.csv", READINGS),
];

/// Case, file, a stretch of it, what stands in its place, and the answer.
const CASES: &str = r"
columns of another file              | heights.csv       | height_m               | distance_m            | T220:1
columns of no file                   | heights.csv       | height_m               | reading               | T220:1
millimetres in the header            | heights.csv       | height_m               | height_mm             | T216:1
millimetres                          | heights.csv       | 0.310                  | 310                   | T224:2
millimetres throughout               | heights.csv       | *,0.3                  | ,3                    | T221:2
no height                            | heights.csv       | 0.305                  |                       | T220:3
text                                 | heights.csv       | 0.305                  | low                   | T217:3
other commands at the same pose      | heights.csv       | -0.617,-0.199,0.306    | -0.421,0.122,0.306    | T228:4
a number of another file's pose      | heights.csv       | 11,-0.507,-0.064       | 1,-0.333,0.251        | T228:2
degrees of commands                  | heights.csv       | q1_m                   | q1_deg                | T214:1
noise of nothing that the file holds | tcp_positions.csv | sigma_x_m              | sigma_height_m        | T219:1
negative noise of a row              | tcp_positions.csv | 1e-5                   | -1e-5                 | T223:2
noise of a row in millimetres        | tcp_positions.csv | 1e-5                   | 10                    | T223:2
a row that measures nothing          | tcp_positions.csv | -1.904,                | ,                     | T220:3
a pose that is nowhere               | distances.csv     | 12,21                  | 12,99                 | T229:3
a distance from itself               | distances.csv     | 11,12                  | 11,11                 | T229:2
a distance of zero                   | distances.csv     | 0.201                  | 0                     | T223:2
distances in millimetres             | distances.csv     | *0.                    | 100                   | T221:2
readings without commands            | readings.csv      | *,q1_m,q2_m            |                       | T214:1 T213:2
";

/// Case, name, and contents of a table that is not read: a calibration would silently lack measurements, but notes and
/// logs are nobody's.
const OTHER_NAMES: &str = r"
columns of one kind     | probe.csv        | pose,q1_m,q2_m,height_m\n11,-0.507,-0.064,0.310\n | T230:1
semicolons between them | probe.csv        | pose;q1_m;q2_m;height_m\n11;-0.507;-0.064;0.310\n | T230:1
drives alone            | moves.csv        | pose,q1_m,q2_m\n31,-0.507,-0.064\n                | T230:1
columns of no kind      | inclinometer.csv | pose,q1_m,q2_m,tilt_rad\n11,-0.507,-0.064,0.310\n | T230:1
columns of two kinds    | both.csv         | pose,q1_m,q2_m,height_m,distance_m\n11,0,0,1,1\n  | T230:1
poses without commands  | sag.csv          | pose,sag_um\n11,4\n                               | T230:1
readings without poses  | dial.csv         | q1_m,q2_m,dial_mm\n0,0,1\n                        | T230:1
a path of commands      | path.csv         | q1_m,q2_m,dir1\n0,0,1\n                           | -
a log                   | log.csv          | time_s,temperature_c\n0,20.1\n                    | -
a log by another name   | height.csv       | time_s,level\n0,1\n                               | -
an empty table          | notes.csv        | \n                                                | -
no table                | notes.txt        | pose,q1_m,q2_m,height_m\n11,-0.507,-0.064,0.310\n | -
";

/// Case, what is added to the robot file before its line 7, and the answer.
const OF_ROBOT: &str = r#"
accepted                  | [noise.heights]\nheight_m = "estimate"\n[drives]\nnoise_m = [1e-5, 2e-5] | -
another word for estimate | [noise.heights]\nheight_m = "unknown"                                     | T244:8
a key of another kind     | [noise.heights]\ndistance_m = 1e-5                                        | T242:7 T243:8
a kind that is none       | [noise.hights]\nheight_m = 1e-5                                           | T243:7
noise in millimetres      | [noise.distances]\ndistance_m = 0.5                                       | T223:8
drives without noise      | [drives]                                                                  | T242:7
travel of the drives      | [drives]\ntravel = [[-1, 1], [0, 0.5]]                                     | -
one travel for two drives | [drives]\ntravel = [[-1, 1]]                                               | T246:8
travel from high to low   | [drives]\ntravel = [[1, -1], [0, 0.5]]                                     | T247:8
travel without its ends   | [drives]\ntravel = [1, [0, 0.5]]                                           | T244:8
travel in millimetres     | [drives]\ntravel = [[-600, 600], [0, 0.5]]                                 | T221:8
travel with an end        | [drives]\ntravel = [[-1, 1, 2], [0, 0.5]]                                  | T246:8
a place without tolerance | [targets.left]\nposition_m = [0.1, 0.2, 0.3]                              | T244:8
a plane without offset    | [surfaces.bed]\nnormal = { value = [0, 0, 1], tol = 1e-3 }                | T242:8
a ball in millimetres     | [balls.first]\nposition_m = { value = [100, 200, 300], tol = 0.01 }       | T221:8
"#;

fn all() -> Work {
    folder_of(SETS.iter().chain(&OTHERS))
}

#[test]
fn all_files_together_are_accepted() {
    let work = all();
    let found = read(&work).unwrap();
    assert_eq!((found.plate_rows.len(), found.distances.len()), (9, 2));
    assert_eq!(found.plate_rows[1].values, [Some(-1.904), None, None]);
    assert_eq!(found.plate_rows[1].of.as_deref(), Some("left"));
    assert_eq!(found.plate_rows[2].sigmas, [None; 3]);
    // None of the three sets is needed.
    assert_eq!(read(&folder_of(&OTHERS)).unwrap().plate_rows.len(), 9);
}

#[test]
fn other_measurements() {
    let mut answers = Answers::default();
    for [case, file, old, new, expected] in cases(CASES) {
        let work = all();
        let (_, text) = OTHERS.iter().find(|(own, _)| **own == *file).unwrap();
        work.write(&format!("measured/{file}"), replaced(text, &old, &new));
        answers.read(&case, [&file, &expected], &work, read(&work));
    }
    let work = all();
    work.write("measured/readings.csv", "");
    answers.read(
        "an empty file",
        ["readings.csv", "T210:1"],
        &work,
        read(&work),
    );
    insta::assert_snapshot!(answers.shown());
}

#[test]
fn measurements_under_other_names_are_refused() {
    let mut answers = Answers::default();
    for [case, file, contents, expected] in cases(OTHER_NAMES) {
        let work = with(&file, &contents);
        answers.read(&case, [&file, &expected], &work, read(&work));
    }
    let copy = with("copy.csv", TCP_POSES.replace("x_m", " \"X_m\""));
    answers.read(
        "columns of a file that is there",
        ["copy.csv", "T230:1"],
        &copy,
        read(&copy),
    );
    let two = with("probe.csv", HEIGHTS);
    two.write(
        "measured/distances.csv",
        "pose_a,pose_b,distance_m\n1,2,-1\n",
    );
    answers.read(
        "and another mistake",
        ["probe.csv", "T223@distances.csv:2 T230:1"],
        &two,
        read(&two),
    );
    // Where nothing else is there, columns tell what a table is, whatever name is nearer.
    for (expected, files) in [
        ("T230:1", [("hights.csv", HEIGHTS)].as_slice()),
        ("T230:1", &[("probe.csv", HEIGHTS)]),
        (
            "T230@lengths.csv:1 T230:1",
            &[("probes.csv", POSITIONS), ("lengths.csv", DISTANCES)],
        ),
    ] {
        let work = folder_of(SETS[1..].iter().chain(files));
        let file = files[0].0;
        answers.read(
            &format!("{file} alone"),
            [file, expected],
            &work,
            read(&work),
        );
    }
    insta::assert_snapshot!(answers.shown());
}

#[test]
fn noise_and_places() {
    let mut answers = Answers::default();
    for [case, more, expected] in cases(OF_ROBOT) {
        let text = ROBOT.replace("[range]", &format!("{more}\n[range]"));
        let work = with("robot.toml", text);
        answers.read(&case, ["robot.toml", &expected], &work, read_robot(&work));
    }
    insta::assert_snapshot!(answers.shown());
}

/// A name that is misspelt would silently be that of a place which nobody knows.
#[test]
fn places_that_no_row_names_are_remarked() {
    let work = all();
    let place = "position_m = { value = [0.1, 0.2, 0.3], tol = 0.01 }\n";
    let places =
        format!("[targets.left]\n{place}[targets.rigth]\n{place}[balls.\"1 b\"]\n{place}[range]");
    work.write("measured/robot.toml", ROBOT.replace("[range]", &places));
    let remark = |work: &Work| {
        read_robot(work)
            .unwrap()
            .unused_places(&read(work).unwrap())
    };
    insta::assert_snapshot!(remark(&work).unwrap());
    work.write("measured/robot.toml", ROBOT);
    assert_eq!(remark(&work), None);

    let work = Work::simulated(crate::HEIGHTS);
    let text = work.read("measured/robot.toml");
    work.write(
        "measured/robot.toml",
        format!("{text}\n[balls.first]\n{place}"),
    );
    assert!(work.run("check MEASURED").says("T255"));
}

//! No text panics the readers, and what is written reads back.

use proptest::prelude::*;
use tau::input_error::InputError;
use tau::measurements::{Folder, Split, Texts};
use tau::robot_file::{
    Covariance, LinkValues, MeasuredPath, Measuring, Noise, Origin, Payload, Provenance, Reference,
    RobotFile, StatedNoise, Surface, Value,
};

use super::{CART_POSES, CART_POSITIONS, OnDisk, ROBOT, TCP_POSES, pair, shape};

fn components(count: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-9.0..9.0_f64, count)
}

fn value(count: usize) -> impl Strategy<Value = Option<Value>> {
    let positive = 1e-12..1e4_f64;
    let sigma = prop::option::of(prop::collection::vec(positive.clone(), count));
    prop::option::of(
        (components(count), positive, sigma).prop_map(|(value, tol, sigma)| Value {
            value,
            tol,
            sigma,
        }),
    )
}

fn link_values() -> impl Strategy<Value = LinkValues> {
    let above_zero = || {
        value(1).prop_map(|number| {
            number.map(|number| Value {
                value: vec![number.value[0].abs() + 1e-3],
                ..number
            })
        })
    };
    let angles = value(3).prop_map(|angles| {
        angles.map(|angles| Value {
            value: angles.value.iter().map(|a| a / 2.0).collect(),
            ..angles
        })
    });
    let vectors = (value(3), value(3), value(3));
    (above_zero(), vectors, angles, above_zero()).prop_map(
        |(length, (plate_joint, track_offset, track_direction), track_rotation, pull)| LinkValues {
            length,
            plate_joint,
            track_offset,
            track_direction,
            track_rotation,
            pull,
        },
    )
}

fn robot_file() -> impl Strategy<Value = RobotFile> {
    let name = "\\PC{0,8}";
    let section = || prop::collection::btree_map(name, link_values(), 0..3);
    let parameter = prop_oneof![value(1), value(3)].prop_filter_map("absent", |value| value);
    let effects = prop::collection::btree_map(
        name,
        prop::collection::btree_map(name, parameter.clone(), 0..3),
        0..3,
    );
    let parameters = prop::collection::btree_map(name, parameter, 0..3);
    let crank = (value(3), value(3)).prop_map(|(centre, axis)| {
        let keys = [("centre_m", centre), ("axis", axis)].into_iter();
        let given = keys.filter_map(|(key, value)| Some((key.to_owned(), value?)));
        given.collect::<std::collections::BTreeMap<_, _>>()
    });
    let cranks = prop::collection::btree_map(name, crank, 0..3);
    let noise = (1e-12..0.1_f64, 1e-12..0.1_f64);
    let gravity = (-9.0..9.0_f64, -9.0..9.0_f64, -9.0..0.0_f64).prop_map(|(x, y, z)| [x, y, z]);
    let payload = prop::option::of((0.0..1e3_f64, prop::array::uniform3(-9.0..9.0_f64), gravity));
    let range = prop::option::of((-9.0..0.0_f64, 0.0..9.0_f64));
    let reference = prop::option::of((
        prop::collection::vec(-9.0..9.0_f64, 0..9),
        prop::array::uniform3(-9.0..9.0_f64),
        prop::array::uniform3(-3.0..3.0_f64),
    ))
    .prop_map(|stated| {
        stated.map(|(commands_m, position_m, orientation_rad)| Reference {
            has_angles: commands_m.len() % 2 == 1,
            commands_m,
            position_m,
            orientation_rad,
        })
    });
    let name = || "[a-z]{1,5}";
    let span = || (-9.0..0.0_f64, 0.0..9.0_f64).prop_map(|(low, high)| [low, high]);
    let record = (
        (
            any::<String>(),
            any::<String>(),
            any::<String>(),
            any::<String>(),
            any::<String>(),
        ),
        (
            0..9_usize,
            prop::collection::vec(span(), 0..4),
            prop::collection::vec(any::<String>(), 0..3),
        ),
        prop::sample::select(vec![
            Split::Alternate,
            Split::All,
            Split::First(7),
            Split::Fraction {
                share: 0.3,
                seed: 5,
            },
        ]),
    )
        .prop_map(
            |(texts, (poses, spans, tracker_effects), split)| Provenance {
                program: texts.0,
                date: texts.1,
                variant: texts.2,
                split,
                poses,
                folder: texts.3,
                description: texts.4,
                commands_m: spans.clone(),
                position_m: spans,
                widening: 1.0 + poses as f64 / 7.0,
                position_sigma_m: (poses > 4).then_some(1.5e-5),
                length_noise: (poses > 5).then_some(9e-4),
                rows: tracker_effects.iter().cloned().collect(),
                tracker_effects,
            },
        );
    let path =
        prop::collection::vec(prop::array::uniform3(-9.0..9.0_f64), 2..5).prop_map(|points_m| {
            let commands_m = (0..points_m.len()).map(|k| k as f64 / 3.0).collect();
            MeasuredPath {
                commands_m,
                points_m,
            }
        });
    let paths = prop::collection::btree_map(name(), path, 0..3);
    let stated = (
        range,
        reference,
        prop::option::of(record),
        paths,
        (cranks, parameters),
    );
    (
        any::<String>(),
        noise,
        payload,
        stated,
        section(),
        section(),
        section(),
        effects,
    )
        .prop_map(
            |(
                robot,
                noise,
                payload,
                (range_m, reference, calibration, paths, (cranks, parameters)),
                links,
                clusters,
                tracks,
                effects,
            )| {
                let robot_name = robot.clone();
                RobotFile {
                    source: Origin::default(),
                    robot,
                    noise: Noise {
                        position_m: noise.0,
                        rotation_rad: noise.1,
                    },
                    payload: payload.map(|(mass_kg, centre_m, gravity_m_s2)| Payload {
                        mass_kg,
                        centre_m,
                        gravity_m_s2,
                    }),
                    range_m,
                    reference,
                    measuring: measuring(noise.0),
                    covariance: Some(Covariance {
                        parameters: vec!["a.b".to_owned(), robot_name],
                        factor: vec![vec![noise.0], vec![-noise.1, noise.1 / 3.0]],
                        registered_rad: range_m.map(|(low, high)| [low, high, 0.1]),
                    }),
                    calibration,
                    paths,
                    links,
                    clusters,
                    tracks,
                    cranks,
                    parameters,
                    effects,
                }
            },
        )
}

/// A valid text with a few bytes replaced, inserted or dropped.
fn mutated(text: &'static str) -> impl Strategy<Value = String> {
    let edit = (
        any::<prop::sample::Index>(),
        0..3_usize,
        prop::collection::vec(any::<u8>(), 0..4),
    );
    prop::collection::vec(edit, 1..6).prop_map(move |edits| {
        let mut bytes = text.as_bytes().to_vec();
        for (at, dropped, inserted) in edits {
            let start = at.index(bytes.len() + 1);
            let end = (start + dropped).min(bytes.len());
            bytes.splice(start..end, inserted);
        }
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// A valid text with one of its words replaced by one that is likely to hurt.
fn reworded(text: &'static str) -> impl Strategy<Value = String> {
    let word = prop::sample::select(vec![
        "",
        ",",
        "\"",
        "\n",
        "\r",
        "nan",
        "inf",
        "-1e308",
        "4294967296",
        "[",
        "}",
        "=",
        "\u{feff}",
        "ü",
        "\0",
    ]);
    (any::<prop::sample::Index>(), word).prop_map(move |(at, word)| {
        let words: Vec<&str> = text.split_inclusive([',', '\n', ' ']).collect();
        let at = at.index(words.len());
        [
            words[..at].concat(),
            word.to_owned(),
            words[at + 1..].concat(),
        ]
        .concat()
    })
}

/// Every section of measurements, with a noise.
fn measuring(noise: f64) -> Measuring {
    let place = Value {
        value: vec![noise, -2.0, 0.5],
        tol: noise,
        sigma: None,
    };
    let offset = Value {
        value: vec![noise],
        tol: noise,
        sigma: Some(vec![noise]),
    };
    Measuring {
        axes: [
            None,
            Some(StatedNoise::Estimate),
            Some(StatedNoise::Known(noise)),
        ],
        noise: [
            ("heights".to_owned(), StatedNoise::Estimate),
            ("distances".to_owned(), StatedNoise::Known(noise)),
        ]
        .into(),
        drives: vec![StatedNoise::Known(noise), StatedNoise::Estimate],
        targets: [("left corner".to_owned(), place.clone())].into(),
        surfaces: [(
            "bed".to_owned(),
            Surface {
                normal: place.clone(),
                offset,
            },
        )]
        .into(),
        balls: [("ball".to_owned(), place)].into(),
    }
}

fn read_all(text: &str) -> Result<Folder, InputError> {
    let texts = Texts::of(|_| Some(text));
    Folder::from_texts("folder", texts, &shape())
}

/// An error can be shown, and points into its text.
fn check_error(error: &InputError, text: &str) {
    assert!(!error.problems().is_empty());
    assert!(!error.render(false).is_empty());
    assert!(!error.render(true).is_empty());
    for place in error
        .problems()
        .iter()
        .filter_map(|problem| problem.place.as_ref())
    {
        assert!(place.span.end <= text.len());
        assert!(place.line >= 1 && place.column >= 1);
    }
}

proptest! {
    #[test]
    fn what_is_written_reads_back_bit_for_bit(file in robot_file()) {
        let text = file.to_toml();
        let read = RobotFile::parse(&text, "robot.toml");
        let read = read.map_err(|error| TestCaseError::fail(error.render(false)))?;
        prop_assert_eq!(&read, &file);
        prop_assert_eq!(read.to_toml(), text);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let folder = OnDisk::valid();
        folder.write("tcp_poses.csv", &bytes).write("robot.toml", &bytes);
        let text = String::from_utf8_lossy(&bytes);
        check_error(&folder.read().unwrap_err(), &text);
        check_error(&folder.read_robot().unwrap_err(), &text);
    }

    #[test]
    fn mutated_tables_never_panic(text in prop_oneof![
        mutated(TCP_POSES), reworded(TCP_POSES), mutated(CART_POSES), reworded(CART_POSES),
        mutated(CART_POSITIONS), reworded(CART_POSITIONS),
    ]) {
        check_error(&read_all(&text).unwrap_err(), &text);
    }

    #[test]
    fn mutated_robot_files_never_panic(text in prop_oneof![mutated(ROBOT), reworded(ROBOT)]) {
        match RobotFile::parse_for(&text, "robot.toml", &pair()) {
            Ok(file) => prop_assert_eq!(RobotFile::parse(&file.to_toml(), "again").unwrap(), file),
            Err(error) => check_error(&error, &text),
        }
    }

    #[test]
    fn splits_of_any_text_never_panic(text in "\\PC{0,12}|(first|fraction|all)(:\\PC{0,4}){0,3}") {
        if let Err(error) = text.parse::<Split>() {
            check_error(&error, &text);
        }
    }
}

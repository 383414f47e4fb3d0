//! A study with made-up numbers of plausible size, for tests of the layout alone.

use tau::assumptions::{
    Assumptions, OrientationPoint, PathDeviation, TrackComparison, TrackLinearity,
};
use tau::calibration::{Combination, LinkResult, LinkSigma, ParameterEstimate};
use tau::evaluation::{Evaluation, PoseError, Summary};
use tau::kinematics::{Layout, Rail, Rod};
use tau::measurements::PoseCounts;
use tau::robot::{Architecture, Arm, Owner};
use tau::sensitivity::{LinkSensitivity, ParameterSensitivity, Sensitivity, Turn};
use tau::session::{Input, Record, Stamp};
use tau::study::results::{Setting, Study, VariantResult};
use tau_codes::{files, fit, remark};

const LINKS: [&str; 6] = ["l1", "l2a", "l2b", "l3a", "l3b", "l3c"];
const CLUSTERS: [&str; 3] = ["arm1", "arm2", "arm3"];
const TRACKS: [&str; 3] = ["one", "two", "three"];
const PARAMETERS: [&str; 10] = [
    "L", "Px", "Py", "Pz", "Offset_x", "Offset_y", "Offset_z", "Orient_1", "Orient_2", "Orient_3",
];

/// Numbers between -1 and 1 that look irregular and are always the same.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn three(&mut self, size: f64) -> [f64; 3] {
        [0; 3].map(|_| size * self.next())
    }
}

/// All parts filled, in the sizes of the prototype's data.
pub(crate) fn study() -> Study {
    let mut numbers = Numbers(7);
    let variants = [
        ("Nominal", 110.0, false),
        ("Piecewise", 98.0, false),
        ("Full", 97.0, true),
        ("FullPiecewise", 86.0, true),
        ("BestPerLink", 73.0, true),
    ];
    let variants = variants.map(|(name, size, full)| variant(&mut numbers, name, size, full));
    let assumptions = assumptions(&mut numbers);
    let positions = assumptions.orientation.iter();
    Study {
        setting: Setting {
            robot: "GantryTau".to_owned(),
            architecture: Architecture {
                carts: 3,
                ..Architecture::default()
            },
            folder: "data/prototype".to_owned(),
            poses: PoseCounts {
                total: 176,
                in_range: 121,
                calibration: 61,
                validation: 60,
            },
            rows: None,
            has_cart_poses: true,
            noise: (1e-5, 4e-5),
            positions_m: positions.map(|point| point.position_m).collect(),
            layout: Some(layout()),
        },
        variants: variants.into(),
        assumptions,
        check: None,
        sensitivity: Some(sensitivity(&mut numbers)),
        discovery: None,
        remarks: vec![
            remark!(fit::POSES_DROPPED; "55 of 176 poses leave the range of set 2 and are dropped."),
            remark!(files::COLUMNS_ABSENT; "Column load_n is missing: effects of load cannot be seen."),
        ],
    }
}

/// Origin of made-up numbers.
pub(crate) fn record() -> Record {
    Record {
        stamp: Stamp {
            program: "tau 0.0.0".to_owned(),
            date: "2026-01-02".to_owned(),
        },
        split: "alternate".to_owned(),
        inputs: vec![Input::new("tcp_poses.csv", b"")],
        arguments: vec!["measured".to_owned()],
    }
}

/// Three tracks along x with one, two and three links to a plate.
pub(crate) fn layout() -> Layout {
    let tcp = [-1.3, -4.2, 0.0];
    let carts = [[-1.3, -5.2, 1.0], [-1.3, -3.2, 1.0], [-1.3, -5.2, -0.8]];
    let link = |index: usize, name: &&str| {
        let track = [0, 1, 1, 2, 2, 2][index];
        let aside = 0.06 * index as f64;
        let [x, y, z] = carts[track];
        Rod {
            name: (*name).to_owned(),
            cluster: CLUSTERS[track].to_owned(),
            track: Some(track),
            driven_by: None,
            ends_m: [
                [x + aside, y, z],
                [tcp[0] + aside, tcp[1], tcp[2] + 0.5 * aside],
            ],
        }
    };
    let links: Vec<Rod> = LINKS
        .iter()
        .enumerate()
        .map(|(index, name)| link(index, name))
        .collect();
    let tracks = TRACKS.iter().enumerate().map(|(track, name)| {
        let [x, y, z] = carts[track];
        let own = links.iter().filter(|rod| rod.track == Some(track));
        Rail {
            name: (*name).to_owned(),
            is_crank: false,
            line_m: vec![[x - 0.7, y, z], [x + 0.7, y, z]],
            cart_m: [x, y, z],
            joints_m: own.map(|rod| rod.ends_m[0]).collect(),
        }
    });
    Layout {
        variant: "Full".to_owned(),
        tcp_m: tcp,
        tracks: tracks.collect(),
        plate_m: links.iter().step_by(2).map(|rod| rod.ends_m[1]).collect(),
        base_m: vec![],
        links,
    }
}

fn variant(numbers: &mut Numbers, name: &str, size: f64, full: bool) -> VariantResult {
    let pose_errors: Vec<_> = (0..60)
        .map(|index| PoseError {
            pose: 2 + index * 176 / 60,
            position_m: [-1.3, -4.2, 0.0].map(|centre| centre + 0.5 * numbers.next()),
            error_um: numbers.three(size),
            orientation_rad: full.then(|| numbers.three(2e-4)),
            sigma: None,
        })
        .collect();
    let lengths = || pose_errors.iter().map(PoseError::length_um);
    let position_um = Summary {
        mean: lengths().sum::<f64>() / 60.0,
        max: lengths().fold(0.0, f64::max),
        rms: (lengths().map(|length| length * length).sum::<f64>() / 60.0).sqrt(),
    };
    let piecewise =
        |link: &str| name.contains("Piecewise") || name == "BestPerLink" && link.contains('2');
    let names: &[&str] = if full { &LINKS } else { &CLUSTERS };
    let links: Vec<_> = names
        .iter()
        .map(|link| LinkResult {
            name: (*link).to_owned(),
            length_m: 2.04 + 0.003 * numbers.next(),
            plate_joint_m: full.then(|| numbers.three(0.15)),
            track_offset_m: [-3.2, -4.1, 0.1].map(|centre| centre + 0.8 * numbers.next()),
            track_direction: (!piecewise(link)).then(|| [0.997_32, -0.066_77, -0.006_97]),
            track_rotation_rad: piecewise(link).then(|| numbers.three(0.01)),
            cost_m4: 4e-6 * (1.1 + numbers.next()),
            sigma: LinkSigma {
                length_m: 2.1e-5,
                plate_joint_m: [1.2e-5, 1.3e-5, 1.4e-5],
                track_offset_m: [2.2e-4, 2.3e-4, 2.4e-4],
                track: [3.1e-5, 3.2e-5, 3.3e-5],
            },
            tolerance: LinkSigma {
                length_m: 1e-3,
                plate_joint_m: [1e-3; 3],
                track_offset_m: [1e-2; 3],
                track: [5e-3; 3],
            },
        })
        .collect();
    let suffixes: &[&str] = if full {
        &PARAMETERS
    } else {
        &["L", "Offset_x", "Offset_y", "Offset_z"]
    };
    let parameters: Vec<_> = names
        .iter()
        .enumerate()
        .flat_map(|(index, link)| {
            let owner = if full {
                Owner::Link(index)
            } else {
                Owner::Cluster(index)
            };
            suffixes
                .iter()
                .map(move |suffix| (format!("{link}.{suffix}"), owner))
        })
        .map(|(name, owner)| {
            let tolerance = if name.contains(".O") { 1e-2 } else { 3e-4 };
            let nominal = 2.0 * numbers.next();
            ParameterEstimate {
                unit: if name.contains("Orient") { "" } else { "m" }.to_owned(),
                name,
                owner,
                nominal,
                tolerance: Some(tolerance),
                value: nominal + 1.5 * tolerance * numbers.next(),
                sigma: tolerance * (0.5 + 0.45 * numbers.next()),
            }
        })
        .collect();
    let correlations = (0..14)
        .map(|index| {
            let other = &parameters[(index + 3) % parameters.len()];
            let one = &parameters[index % parameters.len()];
            (
                one.name.clone(),
                other.name.clone(),
                0.999 - 0.01 * index as f64,
            )
        })
        .collect();
    let undetermined = (0..if full { 6 } else { 0 })
        .map(|index| Combination {
            terms: (0..10)
                .map(|term| {
                    (
                        parameters[10 * index + term].name.clone(),
                        0.9 / (1.0 + term as f64),
                    )
                })
                .collect(),
            data_over_prior: if index == 5 {
                f64::INFINITY
            } else {
                1.5 + index as f64
            },
        })
        .collect();
    VariantResult {
        name: name.to_owned(),
        arm: if full { Arm::Full } else { Arm::Reduced },
        evaluation: Evaluation {
            position_um,
            orientation_rad_max_abs: full.then_some([1.9e-4, 2.1e-4, 1.8e-4]),
            expected_rms_um: None,
            errors: pose_errors,
            not_predicted: vec![],
        },
        links,
        parameters,
        correlations,
        undetermined,
        iterations: 31,
        termination: "the cost no longer falls".to_owned(),
        fit: None,
        validation_outliers: vec![],
        held: None,
    }
}

fn assumptions(numbers: &mut Numbers) -> Assumptions {
    let orientation = (0..176_u32)
        .map(|index| {
            let (layer, row, height) = (index / 30, index % 30 / 5, index % 5);
            let [x, y, z] = [
                -1.9 + 0.24 * f64::from(layer),
                -4.72 + 0.2 * f64::from(row),
                -0.37 + 0.2 * f64::from(height),
            ];
            OrientationPoint {
                pose: index + 1,
                position_m: [x, y, z],
                deviation_rad: [
                    1e-3 * (y + 4.2) * z + 1e-4 * numbers.next(),
                    -5e-3 * (y + 4.2 + 0.8 * z) + 2e-4 * numbers.next(),
                    1.5e-3 * z + 2e-4 * numbers.next(),
                ],
            }
        })
        .collect();
    let path = |numbers: &mut Numbers, count: u32, size: f64| -> Vec<PathDeviation> {
        (0..count)
            .map(|index| {
                let q = -0.65 + 1.35 * f64::from(index) / f64::from(count);
                PathDeviation {
                    q_m: q,
                    parallel_um: size * ((5.0 * q).sin() + 0.3 * numbers.next()),
                    horizontal_um: 0.6 * size * ((3.0 * q).cos() - 0.7 + 0.2 * numbers.next()),
                    vertical_um: 0.4 * size * (q * q - 0.2 + 0.3 * numbers.next()),
                }
            })
            .collect()
    };
    let linearity = TRACKS
        .iter()
        .zip([40.0, 85.0, -55.0])
        .map(|(track, size)| TrackLinearity {
            track: (*track).to_owned(),
            points: path(numbers, 28, size),
        })
        .collect();
    let sets = TRACKS
        .iter()
        .map(|track| TrackComparison {
            track: (*track).to_owned(),
            points: path(numbers, 110, 22.0),
            rms_um: [15.2, 9.1, 4.4],
        })
        .collect();
    Assumptions {
        orientation,
        linearity,
        sets,
    }
}

fn sensitivity(numbers: &mut Numbers) -> Sensitivity {
    let links = LINKS
        .iter()
        .enumerate()
        .map(|(link, name)| LinkSensitivity {
            link: (*name).to_owned(),
            parameters: PARAMETERS
                .iter()
                .enumerate()
                .map(|(index, parameter)| {
                    let size = 20.0 + 15.0 * (index % 4) as f64 + 8.0 * link as f64;
                    let by_pose_um: Vec<_> =
                        (0..60).map(|_| size * (1.2 + numbers.next())).collect();
                    let angle = if link == 0 { 0.0 } else { 3e-6 };
                    let by_pose_rad: Vec<_> =
                        by_pose_um.iter().map(|value| angle * value).collect();
                    let position_mm = 2e-3 * by_pose_um.iter().sum::<f64>();
                    let orientation_rad = 2.0 * by_pose_rad.iter().sum::<f64>();
                    ParameterSensitivity {
                        parameter: (*parameter).to_owned(),
                        position_mm,
                        position_mm_central: position_mm * 1.000_01,
                        position_mm_analytic: position_mm * 1.000_01,
                        orientation_rad,
                        orientation_rad_central: orientation_rad,
                        orientation_rad_analytic: orientation_rad,
                        cost_m4: 1e-7 * (1.5 + numbers.next()),
                        by_pose_um,
                        by_pose_rad,
                    }
                })
                .collect(),
        })
        .collect();
    Sensitivity {
        variant: "Full".to_owned(),
        poses: 60,
        step: 5e-5,
        turn: Turn::EulerAngles,
        links,
        disagreement: 3e-5,
    }
}

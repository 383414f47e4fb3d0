//! Simulation as the command line asks for it.

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use tau_codes::{Remark, files, fit};
use tau_robot::input_error::{Errors, InputError};
use tau_robot::measurements::{DISTANCES, PlateKind, plausible};
use tau_robot::prototype;
use tau_robot::robot::Robot;
use tau_robot::robot_file::{Payload, RobotFile, StatedNoise};

use super::build::Build;
use super::effect::Effect;
use super::folder::SimulatedFolder;
use super::noise::{Noise, Tails};
use super::plan::{Approach, FARTHEST_TURN, Poses, Temperature, TrackPoints};
use super::plate::Measure;
use super::session::{simulate, within_reach};
use super::simulation::Simulation;

/// Everything that can be asked for, as it is typed.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub struct Request {
    /// The robot file; by default what the description gives, or else the prototype's.
    pub robot: Option<PathBuf>,
    /// Variant whose simplifications the true machine keeps; see [`Simulation::variant`].
    pub variant: Option<String>,
    /// Effects, such as `rack_pitch(two): sine=8e-5, period=0.0133`.
    pub effects: Vec<String>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// True if the machine is exactly that of the robot file, instead of drawn from its tolerances.
    pub exact: bool,
    /// Noise of positions to state and to apply, in place of the file's (m).
    pub noise_position_m: Option<f64>,
    /// Noise of rotations to state and to apply, in place of the file's (rad).
    pub noise_rotation_rad: Option<f64>,
    /// Noise of the drives' readings to state and to apply, in place of the file's (m or rad).
    pub noise_drives: Option<f64>,
    /// Noise of the measured tensions of links that drives lengthen (N); without it they are not measured.
    pub noise_force_n: Option<f64>,
    /// True noise of sets 1, 2 and 3 over the stated one.
    pub noise_scale: [f64; 3],
    /// True if the noise has heavy tails (Student's t of three degrees of freedom).
    pub heavy_tails: bool,
    /// Share of the variance that the coordinates of a pose have in common.
    pub common_noise: f64,
    /// Share of its variance that a reading has in common with the others at the same pose.
    pub visit_noise: f64,
    /// Correlation of successive measurements.
    pub serial_noise: f64,
    /// Share of the TCP poses that are outliers.
    pub outliers: f64,
    /// Size of an outlier in standard deviations.
    pub outlier_size: f64,
    /// Layers, rows and columns of the grid of TCP poses.
    pub grid: [usize; 3],
    /// Its steps (m).
    pub grid_step_m: Option<[f64; 3]>,
    /// Number of TCP poses: those of the grid end there.
    pub poses: Option<usize>,
    /// Kinds of measurement at these poses, by their names in [`Measure::ALL`].
    pub measures: Vec<String>,
    /// Number of readings at each of them.
    pub readings: usize,
    /// True if the TCP poses are random instead of on the grid.
    pub random: bool,
    /// Largest turn of the plate at each of the TCP poses (rad).
    pub tilt_rad: f64,
    /// Random displacement of grid and track points, as a share of the step.
    pub jitter: f64,
    /// Number of points on each track in set 2.
    pub track_points: usize,
    /// True if set 2 is measured both ways.
    pub both_ways: bool,
    /// Number of random poses in set 3.
    pub cart_poses: usize,
    /// True if poses are approached from random sides.
    pub random_approach: bool,
    /// Temperature at the start (°C).
    pub temperature_c: f64,
    /// Rise of the temperature during set 1 (K).
    pub warming_k: f64,
    /// Mass of the payload in place of the file's (kg).
    pub payload_mass_kg: Option<f64>,
}

impl Default for Request {
    fn default() -> Self {
        let (noise, temperature) = (Noise::default(), Temperature::default());
        Self {
            robot: None,
            variant: None,
            effects: Vec::new(),
            seed: 1,
            exact: false,
            noise_position_m: None,
            noise_rotation_rad: None,
            noise_drives: None,
            noise_force_n: None,
            noise_scale: noise.scale,
            heavy_tails: false,
            common_noise: noise.common,
            visit_noise: noise.visit,
            serial_noise: noise.serial,
            outliers: noise.outliers,
            outlier_size: noise.outlier_size,
            grid: [6, 6, 5],
            grid_step_m: None,
            poses: Some(176),
            measures: vec!["poses".to_owned()],
            readings: 1,
            random: false,
            tilt_rad: 0.0,
            jitter: 0.0,
            track_points: TrackPoints::default().count,
            both_ways: false,
            cart_poses: 150,
            random_approach: false,
            temperature_c: temperature.start_c,
            warming_k: temperature.rise_k,
            payload_mass_kg: None,
        }
    }
}

/// A summary of the simulation, for the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// Number of rows of sets 1, 2 and 3.
    pub rows: [usize; 3],
    /// Number of rows of other files of the plate, those that are there.
    pub others: Vec<(&'static str, usize)>,
    /// Effects by name and place.
    pub effects: Vec<(String, String)>,
    /// Outliers among the TCP poses.
    pub outliers: usize,
    /// Points that were out of reach and left out.
    pub out_of_reach: usize,
    /// True if readings of redundant drives, which are measurements, have no noise.
    pub drives_are_exact: bool,
    /// Remarks on what was asked for and not had, or says nothing.
    pub remarks: Vec<Remark>,
}

impl Request {
    /// Simulates and writes the folder.
    ///
    /// # Errors
    /// All mistakes of the options at once, by their names on the command line; as [`simulate`] and
    /// [`SimulatedFolder::write`].
    pub fn run(&self, robot: &Robot, folder: &Path) -> Result<Summary, InputError> {
        let simulation = self.simulation(robot)?;
        let mut simulated = simulate(&simulation)?;
        if simulated.truth.out_of_reach > 0 {
            simulated.truth.remarks.extend(within_reach(&simulation));
        }
        simulated.check(folder, robot)?;
        simulated.write(folder)?;
        Ok(Summary::of(&simulated, robot))
    }

    /// The simulation that the request describes.
    ///
    /// # Errors
    /// All mistakes of the options at once.
    pub fn simulation(&self, robot: &Robot) -> Result<Simulation, InputError> {
        let mut errors = Errors::default();
        self.check(&mut errors);
        let mut effects = Vec::new();
        for text in &self.effects {
            match Effect::parse(text, robot, "--effect") {
                Ok(effect) => effects.push(effect),
                Err(error) => errors.add(error),
            }
        }
        let measures: Vec<Measure> = (self.measures.iter())
            .map(|text| errors.keep(text.parse().map(Some)))
            .collect::<Option<_>>()
            .unwrap_or_default();
        if let Some(name) = &self.variant
            && robot.variant(name).is_none()
        {
            let known: Vec<&str> = robot.variants.iter().map(|v| v.name.as_str()).collect();
            errors.add(InputError::unknown_name(
                files::NO_SUCH_VARIANT,
                "--variant",
                "variant",
                name,
                known,
            ));
        }
        let file = match &self.robot {
            Some(path) => RobotFile::read(path, robot),
            None => prototype::parameters_of(robot),
        };
        let mut file = match file {
            Ok(file) => file,
            Err(error) => {
                errors.add(error);
                errors.finish()?;
                return Err(InputError::whole(
                    files::CANNOT_READ,
                    "robot.toml",
                    "the robot file can't be used",
                ));
            }
        };
        errors.finish()?;
        file.noise.position_m = self.noise_position_m.unwrap_or(file.noise.position_m);
        file.noise.rotation_rad = self.noise_rotation_rad.unwrap_or(file.noise.rotation_rad);
        if let Some(sigma) = self.noise_drives {
            file.measuring.drives = vec![StatedNoise::Known(sigma)];
        }
        let noise = [
            ("position_m", "--noise-position", file.noise.position_m),
            ("rotation_rad", "--noise-rotation", file.noise.rotation_rad),
        ];
        if measures.contains(&Measure::Poses)
            && let Some((key, option, _)) = noise.iter().find(|(_, _, sigma)| !sigma.is_finite())
        {
            let message = format!("`[noise]` of the robot file has no `{key}`");
            let help = format!(
                "state it there or with {option}, or say with --measure what is measured in place of poses"
            );
            return Err(InputError::whole(fit::NOISE_UNSTATED, *option, message).help(help));
        }
        if let Some(mass_kg) = self.payload_mass_kg {
            file.payload = Some(match file.payload {
                Some(payload) => Payload { mass_kg, ..payload },
                None => Payload {
                    mass_kg,
                    centre_m: [0.0; 3],
                    gravity_m_s2: [0.0, 0.0, -9.81],
                },
            });
        }
        Ok(Simulation {
            variant: self.variant.clone(),
            build: if self.exact {
                Build::Exact
            } else {
                Build::default()
            },
            effects,
            noise: Noise {
                scale: self.noise_scale,
                tails: if self.heavy_tails {
                    Tails::Heavy
                } else {
                    Tails::Normal
                },
                common: self.common_noise,
                visit: self.visit_noise,
                serial: self.serial_noise,
                outliers: self.outliers,
                outlier_size: self.outlier_size,
            },
            noise_force_n: self.noise_force_n,
            poses: if self.random {
                Poses::Random {
                    count: self.poses.unwrap_or(self.grid.iter().product()),
                }
            } else {
                Poses::Grid {
                    counts: self.grid,
                    step_m: self.grid_step_m,
                    limit: self.poses,
                    jitter: self.jitter,
                }
            },
            tilt_rad: self.tilt_rad,
            measures,
            readings: self.readings,
            track_points: TrackPoints {
                count: self.track_points,
                jitter: self.jitter,
                both_ways: self.both_ways,
            },
            random_poses: self.cart_poses,
            approach: if self.random_approach {
                Approach::Random
            } else {
                Approach::Moves
            },
            temperature: Temperature {
                start_c: self.temperature_c,
                rise_k: self.warming_k,
                ..Temperature::default()
            },
            seed: self.seed,
            ..Simulation::new(robot.clone(), file)
        })
    }

    fn check(&self, errors: &mut Errors) {
        /// More poses than a day has room for.
        const MOST: usize = 100_000;
        /// The random part of the temperature, over the ends of what a measurement folder may hold (K).
        const MARGIN_K: f64 = 1.0;
        let mut refuse = |fine: bool, option: &str, found: &dyn Debug, expected: &str| {
            if !fine {
                let message = format!("found {found:?}, expected {expected}");
                errors.add(InputError::whole(files::OPTION_VALUE, option, message));
            }
        };
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let noise = |value: f64| positive(value) && value <= plausible::LARGEST_NOISE;
        let size = |value: f64| value.is_finite() && (0.0..=1e6).contains(&value);
        for (option, found, expected) in [
            (
                "--noise-position",
                self.noise_position_m,
                "a length above zero, in m",
            ),
            (
                "--noise-rotation",
                self.noise_rotation_rad,
                "an angle above zero, in rad",
            ),
            (
                "--noise-drives",
                self.noise_drives,
                "a length or an angle above zero, in m or rad",
            ),
        ] {
            if let Some(found) = found {
                let expected = format!("{expected}, and at most {}", plausible::LARGEST_NOISE);
                refuse(noise(found), option, &found, &expected);
            }
        }
        if let Some(found) = self.noise_force_n {
            let expected = "a force from zero to a million newtons";
            refuse(size(found), "--noise-force", &found, expected);
        }
        refuse(
            self.noise_scale.iter().all(|&scale| size(scale)),
            "--noise-scale",
            &self.noise_scale,
            "factors from zero to a million",
        );
        for (option, found) in [
            ("--common-noise", self.common_noise),
            ("--visit-noise", self.visit_noise),
            ("--outliers", self.outliers),
            ("--jitter", self.jitter),
        ] {
            let is_share = (0.0..=1.0).contains(&found);
            refuse(is_share, option, &found, "a share from 0 to 1");
        }
        let of_plate = |kind: &String| kind != "readings";
        refuse(
            self.visit_noise == 0.0
                || self.measures.is_empty()
                || self.measures.iter().any(of_plate),
            "--visit-noise",
            &self.visit_noise,
            "none: `--measure readings` measures nothing of the plate",
        );
        refuse(
            (1..=MOST).contains(&self.readings),
            "--readings",
            &self.readings,
            "a number from 1 to 100000",
        );
        refuse(
            self.serial_noise.abs() < 1.0,
            "--serial-noise",
            &self.serial_noise,
            "a correlation between -1 and 1",
        );
        refuse(
            size(self.outlier_size),
            "--outlier-size",
            &self.outlier_size,
            "a number of standard deviations",
        );
        refuse(
            (0.0..=FARTHEST_TURN).contains(&self.tilt_rad),
            "--tilt",
            &self.tilt_rad,
            &format!("an angle in rad, at most {FARTHEST_TURN}, as joints allow"),
        );
        if let Some(found) = self.grid_step_m {
            let expected = "three lengths above zero, in m";
            refuse(
                found.iter().all(|&s| positive(s)),
                "--grid-step",
                &found,
                expected,
            );
        }
        let points = self
            .grid
            .iter()
            .try_fold(1_usize, |product, &count| product.checked_mul(count));
        refuse(
            points.is_some_and(|points| (1..=MOST).contains(&points)),
            "--grid",
            &self.grid,
            "three counts above zero, of together at most 100000 points",
        );
        if let Some(found) = self.poses {
            refuse(
                (2..=MOST).contains(&found),
                "--poses",
                &found,
                "2 to 100000",
            );
        }
        for (option, found) in [
            ("--track-points", self.track_points),
            ("--cart-poses", self.cart_poses),
        ] {
            let fine = found == 0 || (2..=MOST).contains(&found);
            refuse(fine, option, &found, "none or 2 to 100000");
        }
        let lowest = plausible::TEMPERATURES_C.start() + MARGIN_K;
        let highest = plausible::TEMPERATURES_C.end() - MARGIN_K;
        let measurable = |value: f64| (lowest..=highest).contains(&value);
        refuse(
            measurable(self.temperature_c),
            "--temperature",
            &self.temperature_c,
            &format!("a temperature between {lowest} and {highest} °C"),
        );
        if measurable(self.temperature_c) {
            refuse(
                measurable(self.temperature_c + self.warming_k),
                "--warming",
                &self.warming_k,
                &format!(
                    "a rise of the temperature, in K, that ends between {lowest} and {highest} °C"
                ),
            );
        }
        if let Some(found) = self.payload_mass_kg {
            refuse(
                positive(found),
                "--payload",
                &found,
                "a mass above zero, in kg",
            );
        }
    }
}

impl Summary {
    fn of(simulated: &SimulatedFolder, robot: &Robot) -> Self {
        let SimulatedFolder {
            folder,
            truth,
            file,
            ..
        } = simulated;
        let mut drives = 0..robot.commands;
        Self {
            drives_are_exact: robot.is_redundant()
                && drives.all(|drive| file.noise_of_drive(drive).is_none()),
            rows: [
                folder.tcp_poses.len(),
                folder.cart_poses.len(),
                folder.cart_positions.len(),
            ],
            others: (PlateKind::ALL.into_iter())
                .map(|kind| (kind.file(), folder.rows_of(kind).count()))
                .chain([(DISTANCES, folder.distances.len())])
                .filter(|(_, rows)| *rows > 0)
                .collect(),
            effects: truth.effects.clone(),
            outliers: truth.outliers.len() + truth.gross_rows.len(),
            out_of_reach: truth.out_of_reach,
            remarks: truth.remarks.clone(),
        }
    }
}

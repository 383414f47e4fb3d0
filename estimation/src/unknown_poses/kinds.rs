//! Kinds of residuals with their noise, as the robot file states it.

use tau_codes::{Code, fit};
use tau_kinematics::{Machine, Sample};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Folder, PlateKind};
use tau_robot::robot::Robot;
use tau_robot::robot_file::{Noise, RobotFile, StatedNoise};

use super::measurand::Measurand;
use super::rows::Kind;
use crate::machine::error::Error;
use crate::problem::{CLOSURE_SHARE, Component, POSE_UNKNOWNS};

/// First guess of a noise that is to be estimated (m). It weighs a kind against others in the first round alone; the
/// estimate replaces it.
pub(super) const FIRST_GUESS_M: f64 = 1e-4;

/// The kinds of a component of carts, whose noise exceeds the stated one by a factor that they share, where their misfit is
/// significantly larger.
#[derive(Debug)]
pub(super) struct KindsOfComponent {
    pub(super) kinds: Vec<usize>,
    /// Of the noise over the stated one.
    pub(super) factor: f64,
}

impl KindsOfComponent {
    /// Those of carts.
    pub(super) fn of_carts(kinds: &[Kind]) -> Vec<Self> {
        let of = |component| Self {
            kinds: (0..kinds.len())
                .filter(|&kind| kinds[kind].of.component() == component)
                .collect(),
            factor: 1.0,
        };
        Component::OF_CARTS.map(of).into()
    }
}

/// Kinds of residuals that a folder has, each with its noise.
///
/// # Errors
/// A kind of which nothing states the noise.
pub(super) fn kinds_of_noise(
    folder: &Folder,
    file: &RobotFile,
    machine: &Machine,
) -> Result<Vec<Kind>, Error> {
    let noise = Stated(file);
    let mut kinds = vec![];
    if !folder.tcp_poses.is_empty() {
        kinds.extend(noise.of_poses()?);
    }
    for (kind, of, key) in [
        (PlateKind::Position, Measurand::Position, "position_m"),
        (PlateKind::Height, Measurand::Height, "height_m"),
        (PlateKind::BallBar, Measurand::BallBar, "distance_m"),
    ] {
        if folder.rows_of(kind).next().is_none() {
            continue;
        }
        match file.noise_of_axes().filter(|_| kind == PlateKind::Position) {
            Some(axes) => kinds.extend(noise.of_axes(folder, axes)?),
            None => kinds.push(noise.of_lengths(of, key)?),
        }
    }
    if !folder.distances.is_empty() {
        kinds.push(noise.of_lengths(Measurand::Distance, "distance_m")?);
    }
    let stated = kinds
        .iter()
        .filter_map(|kind| of_rows_that_state(kind, folder));
    kinds.extend(stated.collect::<Vec<_>>());
    kinds.push(noise.of_drives(machine, &kinds)?);
    Ok(kinds)
}

/// Rows that state their own noise, of a kind whose noise is estimated from the others: a kind of the same name.
fn of_rows_that_state(kind: &Kind, folder: &Folder) -> Option<Kind> {
    if !kind.is_estimated() {
        return None;
    }
    let rows = (folder.plate_rows.iter()).filter(|row| Some(row.kind) == kind.of.plate());
    let of_rows = rows.flat_map(|row| match kind.of {
        Measurand::Coordinate(axis) => &row.sigmas[axis..=axis],
        _ => &row.sigmas[..],
    });
    let is_distance = kind.of == Measurand::Distance;
    let distances = folder.distances.iter().filter(|_| is_distance);
    let own = of_rows.chain(distances.map(|row| &row.sigma_m)).flatten();
    let squares: Vec<f64> = own.map(|sigma| sigma * sigma).collect();
    let usual = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    usual.is_finite().then_some(Kind {
        stated: Some(StatedNoise::Known(usual)),
        sigma: usual,
        ..*kind
    })
}

/// The noise that a robot file states.
struct Stated<'a>(&'a RobotFile);

impl Stated<'_> {
    fn refused(
        &self,
        code: Code,
        message: impl Into<String>,
        help: impl Into<String>,
    ) -> InputError {
        InputError::whole(code, &self.0.source, message).help(help)
    }

    fn unstated(&self, of: Measurand, key: &str) -> InputError {
        self.refused(
            fit::NOISE_UNSTATED,
            format!("nothing states the noise of {}", of.file()),
            format!("add {key}, or \"estimate\""),
        )
    }

    fn kind(&self, of: Measurand, stated: StatedNoise) -> Kind {
        let usual = self.0.noise.position_m;
        let sigma = match stated {
            StatedNoise::Known(sigma) => sigma,
            StatedNoise::Estimate if usual.is_finite() => usual,
            StatedNoise::Estimate => FIRST_GUESS_M,
        };
        Kind::new(of, Some(stated), sigma)
    }

    fn of_poses(&self) -> Result<[Kind; 2], InputError> {
        let noise = self.0.noise;
        let of = [
            (Measurand::PosePosition, noise.position_m),
            (Measurand::PoseRotation, noise.rotation_rad),
        ];
        if of.iter().any(|(_, sigma)| !sigma.is_finite()) {
            let keys = "`position_m` and `rotation_rad` to `[noise]`";
            return Err(self.unstated(Measurand::PosePosition, keys));
        }
        Ok(of.map(|(of, sigma)| self.kind(of, StatedNoise::Known(sigma))))
    }

    fn of_lengths(&self, of: Measurand, key: &str) -> Result<Kind, InputError> {
        let section = of.file().trim_end_matches(".csv");
        let missing = || self.unstated(of, &format!("`[noise.{section}]` with `{key}`"));
        let stated = self.0.noise_of(of.file()).ok_or_else(missing)?;
        Ok(self.kind(of, stated))
    }

    /// Of positions, axis by axis; of one that no row measures any will do.
    fn of_axes(
        &self,
        folder: &Folder,
        axes: [Option<StatedNoise>; 3],
    ) -> Result<Vec<Kind>, InputError> {
        let positions = PlateKind::Position;
        let kinds = positions
            .columns()
            .iter()
            .enumerate()
            .map(|(axis, column)| {
                let of = Measurand::Coordinate(axis);
                let mut rows = folder.rows_of(positions);
                let is_measured = rows.any(|row| row.values[axis].is_some());
                let any = axes.iter().flatten().next().copied();
                let stated = axes[axis].or(any.filter(|_| !is_measured));
                let key = || format!("`{column}` to `[noise.tcp_positions]`");
                let stated = stated.ok_or_else(|| self.unstated(of, &key()))?;
                Ok(self.kind(of, stated))
            });
        kinds.collect()
    }

    /// Of drives or of the links' lengths beside what else was measured. Closures of exact drives hold to a share of what
    /// lengths are measured to.
    fn of_drives(&self, machine: &Machine, others: &[Kind]) -> Result<Kind, InputError> {
        let commands = 0..machine.robot.commands;
        let drives: Vec<Option<StatedNoise>> = (commands.clone())
            .map(|command| self.0.noise_of_drive(command))
            .collect();
        let are_exact = drives.iter().all(Option::is_none);
        if let Some(stated) = self.0.noise_of_links() {
            if !are_exact {
                return Err(self.refused(
                    fit::NOISE_TWICE,
                    "both `[drives]` and `[noise.links]` state the noise of a link's length",
                    "keep the one that scatters more",
                ));
            }
            return Ok(self.kind(Measurand::LinkLength, stated));
        }
        if others.is_empty() && are_exact {
            return Err(self.refused(
                fit::NOISE_UNSTATED,
                "nothing states the noise of the drives, and nothing else was measured",
                "add `[drives]` with `noise_m`",
            ));
        }
        // Closures of exact drives are lengths, whatever the drives do.
        let turn = commands
            .clone()
            .all(|command| machine.robot.is_angle(command));
        let is_angle = turn && !are_exact;
        let unit_m = if is_angle {
            metres_per_radian(machine)
        } else {
            Some(1.0)
        };
        let (stated, sigma) = if are_exact {
            let lengths = others.iter().filter(|kind| !kind.of.is_angle());
            let least = lengths.map(|kind| kind.sigma).fold(f64::INFINITY, f64::min);
            (None, CLOSURE_SHARE * least)
        } else if drives.contains(&Some(StatedNoise::Estimate)) {
            let guess = FIRST_GUESS_M / unit_m.unwrap_or(1.0);
            (Some(StatedNoise::Estimate), guess)
        } else {
            let usual = usual_drive(self.0, machine.robot.commands);
            (Some(StatedNoise::Known(usual)), usual)
        };
        Ok(Kind {
            unit_m,
            ..Kind::new(Measurand::Closure { is_angle }, stated, sigma)
        })
    }
}

/// Kinds of residuals of carts, in the order of their [components](Component).
pub(super) fn kinds_of_carts(noise: Noise) -> [Kind; 3] {
    Component::OF_CARTS.map(|component| {
        let sigma = component.stated(noise);
        let stated = Some(StatedNoise::Known(sigma));
        Kind::new(Measurand::OfCarts(component), stated, sigma)
    })
}

/// Length (m) by which drives that turn move their links per radian at the reference, in the root mean square; of each
/// that of the link that it moves most, along it.
fn metres_per_radian(machine: &Machine) -> Option<f64> {
    let stated = machine.surroundings.reference.as_ref()?;
    let sample = Sample::new(stated.into(), &stated.commands_m);
    let closures = machine.closures(&sample).ok()?;
    let of_drive = |command: usize| {
        let column = closures.jacobian.column(POSE_UNKNOWNS + command);
        let of_links = column.iter().zip(&closures.slopes);
        of_links.fold(0.0, |most: f64, (entry, slope)| {
            most.max((entry / slope).abs())
        })
    };
    let commands = machine.robot.commands;
    let squares: f64 = (0..commands).map(|command| of_drive(command).powi(2)).sum();
    Some((squares / commands as f64).sqrt()).filter(|metres| *metres > 0.0)
}

/// Root mean square of the stated noise of the drives (m).
fn usual_drive(file: &RobotFile, commands: usize) -> f64 {
    let sigma = |command: usize| match file.noise_of_drive(command) {
        Some(StatedNoise::Known(sigma)) => sigma,
        _ => 0.0,
    };
    let squares: f64 = (0..commands).map(|command| sigma(command).powi(2)).sum();
    (squares / commands as f64).sqrt()
}

/// True if each drive moves one link alone.
pub(super) fn moves_links_apart(robot: &Robot) -> bool {
    let by_length = robot.links.iter().filter_map(|link| link.actuated_by);
    let by_track = robot
        .links
        .iter()
        .filter_map(|link| robot.clusters[link.cluster].track);
    let mut moved = vec![0; robot.commands];
    by_length
        .chain(by_track)
        .for_each(|command| moved[command] += 1);
    moved.iter().all(|count| *count <= 1)
}

/// Noise of each command for the weights of closures, in units of that of their kind; `None` where drives are exact.
pub(super) fn drive_sigmas(file: &RobotFile, commands: usize) -> Option<Vec<f64>> {
    let each: Vec<Option<StatedNoise>> = (0..commands)
        .map(|command| file.noise_of_drive(command))
        .collect();
    if each.iter().all(Option::is_none) {
        return None;
    }
    let is_estimated = each.contains(&Some(StatedNoise::Estimate));
    let usual = usual_drive(file, commands);
    let sigmas = each.into_iter().map(|noise| match noise {
        // Where one is to be estimated, all are taken for equal.
        _ if is_estimated => 1.0,
        Some(StatedNoise::Known(sigma)) => sigma / usual,
        _ => 0.0,
    });
    Some(sigmas.collect())
}

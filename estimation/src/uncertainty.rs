//! Standard deviations of predicted poses and commands, from those of the parameters.
//!
//! With C the covariance of the parameters, F·Fᵀ, and S = ∂(pose)/∂p of the [implicit function
//! theorem](crate::implicit), a predicted pose has the covariance S·C·Sᵀ: what is not known of the machine, without the
//! noise of its measurement. Where carts go along measured paths, the noise of the points of these is added; that it is
//! in the parameters as well, which it moves by far less, is not regarded. Joints' ways are longer or shorter than these
//! [where carts turn](crate::machine::track_scale): these scales do move the parameters, and stand in F with them.
//! Effects that the model lacks are not in it.

use nalgebra::{DMatrix, DVector, Matrix6};
use tau_kinematics::{Error, Machine, POSE_COLUMNS, Sample};
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot::{Parameter, ResidualKind, Variant};
use tau_robot::robot_file::RobotFile;
use tau_robot::robot_file::keys::WIDE;

use crate::calibration::Calibration;
use crate::implicit::Linearized;
use crate::joint::Way;
use crate::machine::{Prepared, track_scale};
use crate::numerics::factor::{Factor, Row};
use crate::numerics::parallel;

/// Poses at which the largest standard deviation is looked for: more tell nothing else.
const MOST_POSES: usize = 4000;

/// Uncertainty of a machine's parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// Row of each of the variant's parameters in F; `None` where the parameter is known exactly.
    rows: Vec<Option<usize>>,
    /// Row of the scale of each closure's way in F; none where joints go along no measured path.
    track_scales: Vec<Option<usize>>,
    /// F of their covariance F·Fᵀ.
    factor: Factor,
    /// Standard deviation of each coordinate of the points that piecewise tracks pass through (m).
    points_m: f64,
}

/// Covariance of a predicted pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseUncertainty {
    /// Of translation (m) and rotation vector in the measurement frame (rad); that of the rotation is zero where the arm
    /// is reduced.
    pub covariance: Matrix6<f64>,
}

impl PoseUncertainty {
    /// The same with standard deviations so many times as large.
    #[must_use]
    pub fn widened(self, by: f64) -> Self {
        Self {
            covariance: self.covariance * (by * by),
        }
    }

    /// Standard deviations of the position, one per axis (m).
    pub fn position_m(&self) -> [f64; 3] {
        [0, 1, 2].map(|k| self.covariance[(k, k)].max(0.0).sqrt())
    }

    /// Standard deviations of the rotation vector, one per axis (rad).
    pub fn rotation_rad(&self) -> [f64; 3] {
        [3, 4, 5].map(|k| self.covariance[(k, k)].max(0.0).sqrt())
    }

    /// Variances of translation (m²) and rotation vector (rad²), one per axis.
    pub(crate) fn variances(&self) -> [f64; 6] {
        std::array::from_fn(|k| self.covariance[(k, k)].max(0.0))
    }

    /// Root mean square distance of the position from the true one (m).
    pub fn distance_m(&self) -> f64 {
        let axes = self.position_m();
        axes.iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt()
    }
}

impl Uncertainty {
    /// Of the parameters of a variant that are listed by index, with the lower triangle F of their covariance F·Fᵀ, by rows;
    /// the others are known exactly.
    pub fn new(variant: &Variant, listed: &[usize], factor: &[Vec<f64>]) -> Self {
        let rows = (0..variant.parameters.len())
            .map(|index| listed.iter().position(|&own| own == index))
            .collect();
        Self::by_rows(rows, factor)
    }

    /// Of parameters by their rows of F, where zeros at their ends may be left out.
    fn by_rows(rows: Vec<Option<usize>>, factor: &[Vec<f64>]) -> Self {
        Self {
            rows,
            track_scales: vec![],
            factor: Factor::new(factor),
            points_m: 0.0,
        }
    }

    /// The same with measured paths whose points have some noise (m) in each coordinate.
    #[must_use]
    pub fn with_path_noise(self, points_m: f64) -> Self {
        Self { points_m, ..self }
    }

    /// The same with the scales of joints' ways that have rows in F, by name, from the first.
    #[must_use]
    pub(crate) fn with_track_scales(
        self,
        machine: &Machine,
        first: usize,
        names: impl Iterator<Item = String>,
    ) -> Self {
        let listed: Vec<String> = names.collect();
        let row = |closure| {
            let name = track_scale::name(machine, closure);
            Some(first + listed.iter().position(|own| *own == name)?)
        };
        Self {
            track_scales: machine.closure_instances().map(row).collect(),
            ..self
        }
    }

    /// Of a calibration's parameters, under the stated noise; `None` where nothing determines one.
    pub fn of_calibration(calibration: &Calibration) -> Option<Self> {
        let variant = &calibration.machine.variant;
        let factor = calibration.factor.as_ref()?;
        let known = Self::new(variant, &calibration.used, factor);
        let known = known.with_path_noise(calibration.file.noise.position_m);
        let listed = calibration.file.covariance.iter();
        let listed = listed.flat_map(|covariance| covariance.parameters.iter().cloned());
        Some(known.with_track_scales(&calibration.machine, 0, listed))
    }

    /// Of a machine with the values of a robot file.
    ///
    /// The file's covariance, under the stated noise ([`RobotFile::widening`] is not in it); parameters that it does not list, such as all those of a
    /// drawing, have their tolerances, each for itself. `None` where a parameter has no tolerance, or is one that has
    /// been calibrated without a record of how it goes with others, and where others than
    /// this variant's were calibrated.
    pub fn of_prepared(prepared: &Prepared, file: &RobotFile) -> Option<Self> {
        let machine = &prepared.machine;
        let variant = &machine.variant;
        let known = file.covariance.as_ref();
        if file.calibrated_otherwise(variant).is_some() {
            return None;
        }
        let mut factor = known.map_or_else(Vec::new, |known| known.factor.clone());
        let mut columns = factor.len();
        let mut is_used = vec![false; variant.parameters.len()];
        (variant.instances_of(ResidualKind::Closure))
            .flat_map(|closure| &closure.parameters)
            .for_each(|&index| is_used[index] = true);
        let row = |(index, parameter): (usize, &Parameter)| -> Option<Option<usize>> {
            let name = &parameter.name;
            let listed =
                known.and_then(|known| known.parameters.iter().position(|own| own == name));
            if listed.is_some() || !is_used[index] {
                return Some(listed);
            }
            let nominal = prepared.nominal[index];
            let is_known = |tolerance: &f64| *tolerance < WIDE && !nominal.is_calibrated;
            let tolerance = nominal.tolerance.filter(is_known)?;
            let mut own = vec![0.0; columns];
            own.push(tolerance);
            factor.push(own);
            columns += 1;
            Some(Some(factor.len() - 1))
        };
        let rows = variant.parameters.iter().enumerate().map(row);
        let rows = rows.collect::<Option<Vec<_>>>()?;
        let known_with_paths = Self::by_rows(rows, &factor).with_path_noise(file.noise.position_m);
        let listed = known
            .into_iter()
            .flat_map(|known| known.parameters.iter().cloned());
        Some(known_with_paths.with_track_scales(machine, 0, listed))
    }

    /// The same with standard deviations so many times as large.
    fn widened(mut self, by: f64) -> Self {
        self.factor.scale(by);
        self.points_m *= by;
        self
    }

    /// Number of columns of F.
    pub(crate) fn columns(&self) -> usize {
        self.factor.columns()
    }

    /// The same as the calibration that the file is of leaves it: where that missed the stated noise, at as much noise as it
    /// showed ([`RobotFile::widening`]).
    pub fn widened_of_prepared(prepared: &Prepared, file: &RobotFile) -> Option<Self> {
        Self::of_prepared(prepared, file).map(|own| own.widened(file.widening()))
    }

    /// Rows of F of some parameters, given by index; zero where one is known exactly.
    pub(crate) fn factor_of(&self, parameters: &[usize]) -> DMatrix<f64> {
        let mut factor = DMatrix::zeros(parameters.len(), self.factor.columns());
        for (row, &index) in parameters.iter().enumerate() {
            if let Some(own) = self.rows.get(index).copied().flatten() {
                for (column, entry) in self.factor.row(own).enumerate() {
                    factor[(row, column)] = entry;
                }
            }
        }
        factor
    }

    /// The scales of joints' ways that are not known, with their rows of F.
    pub(crate) fn track_scales(&self, machine: &Machine) -> impl Iterator<Item = (Way, Vec<f64>)> {
        let closures = machine.closure_instances().zip(&self.track_scales);
        closures.filter_map(move |(closure, row)| {
            let row = (*row)?;
            Some((Way::of(machine, closure)?, self.factor.row(row).collect()))
        })
    }

    /// Largest [distance](PoseUncertainty::distance_m) of a machine's positions at measured poses of a folder, given by
    /// index (m): at the evenly spread part of them that takes part where there are thousands. It is as large where the
    /// pose is predicted, since that lies within a share of a thousandth of the machine.
    ///
    /// # Errors
    /// A pose can't be predicted.
    pub fn largest_m(
        &self,
        machine: &Machine,
        folder: &Folder,
        poses: &[usize],
    ) -> Result<f64, Error> {
        let step = poses.len().div_ceil(MOST_POSES).max(1);
        let poses: Vec<&TcpPose> = (poses.iter().step_by(step))
            .filter_map(|&pose| folder.tcp_poses.get(pose))
            .collect();
        let distances = parallel::map(&poses, |&measured| {
            let known = self.pose(machine, &Sample::from(measured))?;
            Ok::<_, Error>(known.distance_m())
        });
        distances
            .into_iter()
            .try_fold(0.0, |largest, distance| Ok(f64::max(largest, distance?)))
    }

    /// Of the pose that a machine takes at the commands of a sample, whose pose that is, where its drives and links are exact.
    ///
    /// # Errors
    /// A singular pose; data that the sample lacks; derivatives that are not finite.
    pub fn pose(&self, machine: &Machine, sample: &Sample<'_>) -> Result<PoseUncertainty, Error> {
        self.of_pose(machine, sample, false)
    }

    /// The same with the noise of drives and links, by which the plate is off where it is measured.
    ///
    /// # Errors
    /// As [`Self::pose`].
    pub fn pose_with_length_noise(
        &self,
        machine: &Machine,
        sample: &Sample<'_>,
    ) -> Result<PoseUncertainty, Error> {
        self.of_pose(machine, sample, true)
    }

    fn of_pose(
        &self,
        machine: &Machine,
        sample: &Sample<'_>,
        with_length_noise: bool,
    ) -> Result<PoseUncertainty, Error> {
        let unknowns = machine.pose_unknowns();
        let known = self.motion(machine, sample, unknowns, with_length_noise)?;
        let mut covariance = Matrix6::zeros();
        for (row, &unknown) in unknowns.iter().enumerate() {
            for (column, &with) in unknowns.iter().enumerate() {
                // Symmetric to the last digit.
                covariance[(unknown, with)] = known[(row.max(column), row.min(column))];
            }
        }
        Ok(PoseUncertainty { covariance })
    }

    /// Standard deviations of the commands (m) at which a machine takes the pose of a sample, or, where the orientation
    /// follows, its position; the sample has these commands. The noise of drives and links is in them: it is what the drives
    /// read, where the plate stands in the pose.
    ///
    /// # Errors
    /// As [`Self::pose`].
    pub fn commands(&self, machine: &Machine, sample: &Sample<'_>) -> Result<Vec<f64>, Error> {
        let commands = (0..machine.robot.commands).map(|k| POSE_COLUMNS + k);
        let turning = if machine.orientation_follows() {
            3..POSE_COLUMNS
        } else {
            0..0
        };
        let first = turning.len();
        let unknowns: Vec<usize> = turning.chain(commands).collect();
        let known = self.motion(machine, sample, &unknowns, true)?;
        let variances = known.diagonal();
        let sigmas = variances.iter().map(|variance| variance.max(0.0).sqrt());
        Ok(sigmas.skip(first).collect())
    }

    /// Covariance of unknowns that follow the closures.
    fn motion(
        &self,
        machine: &Machine,
        sample: &Sample<'_>,
        unknowns: &[usize],
        with_length_noise: bool,
    ) -> Result<DMatrix<f64>, Error> {
        let closures = Linearized::new(machine, sample)?;
        if unknowns == machine.pose_unknowns() {
            // Nothing limits how far off the plate is.
            machine.check_regular(&closures.by_pose)?;
        }
        let not_finite = || Error::NotFinite {
            closure: machine.variant.name.clone(),
            effects: Box::default(),
        };
        let response = closures.response(unknowns).ok_or_else(not_finite)?;
        let by_paths = self.by_paths(machine, sample, &closures);
        let mut of_parameters: Vec<Row> = (closures.by_parameters.iter())
            .map(|entries| {
                let own = |&(parameter, entry): &(usize, f64)| Some((self.rows[parameter]?, entry));
                entries.iter().filter_map(own).collect()
            })
            .collect();
        for (index, (row, own)) in self.track_scales.iter().zip(&mut of_parameters).enumerate() {
            own.extend(row.and_then(|row| {
                let closure = machine.closure_instances().nth(index)?;
                let track = machine.track_of(closure)?;
                let travel = machine.measured_path(track)?.at(sample.commands_m[track]);
                // A cart is displaced against the plate.
                let along = (0..3).map(|axis| -closures.by_pose[(index, axis)] * travel[axis]);
                Some((row, along.sum()))
            }));
        }
        let mut of_closures =
            self.factor.covariance_of(&of_parameters) + &by_paths * by_paths.transpose();
        if with_length_noise {
            let scatter = machine.surroundings.length_noise.scatter(&closures.by_pose);
            of_closures += &scatter * scatter.transpose();
        }
        Ok(&response * of_closures * response.transpose())
    }

    /// Derivatives of the closures by a standard deviation of the carts on measured paths along each axis.
    fn by_paths(
        &self,
        machine: &Machine,
        sample: &Sample<'_>,
        closures: &Linearized,
    ) -> DMatrix<f64> {
        let of_variant = || machine.variant.instances_of(ResidualKind::Closure);
        let mut columns = Vec::new();
        for track in 0..machine.robot.tracks.len() {
            let Some(path) = machine.measured_path(track) else {
                continue;
            };
            let shares = path.shares(sample.commands_m[track]);
            let deviation = shares.iter().map(|(_, share)| share * share).sum::<f64>();
            let deviation = self.points_m * deviation.sqrt();
            columns.extend((0..3).map(|axis| {
                let rows = of_variant().enumerate().map(|(row, closure)| {
                    let is_carried = machine.track_of(closure) == Some(track);
                    // A cart is displaced against the plate.
                    let by_cart = || -closures.by_pose[(row, axis)];
                    if is_carried {
                        deviation * by_cart()
                    } else {
                        0.0
                    }
                });
                DVector::from_iterator(closures.by_parameters.len(), rows)
            }));
        }
        if columns.is_empty() {
            return DMatrix::zeros(closures.by_parameters.len(), 0);
        }
        DMatrix::from_columns(&columns)
    }
}

//! Calibration: from nominal values and measured TCP poses to the parameters of a variant.

mod cost;
pub(crate) mod known;
mod link_sigma;
pub(crate) mod minimum;
mod output;
pub(crate) mod serial;
mod start;
mod stated;
mod undetermined;

use std::collections::BTreeSet;
use std::sync::Arc;

use tau_codes::fit;
use tau_kinematics::{Machine, Statics};
use tau_robot::fingerprint::of_numbers;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Folder, TCP_POSES, TcpPose};
use tau_robot::robot::{Instance, ResidualKind, Robot, Variant};
use tau_robot::robot_file::RobotFile;
use tau_solver::Termination;

use crate::joint::judged::Judged;
use crate::joint::predicted::GroupFit;
use crate::machine::error::{not_converged, unsolved};
use crate::machine::searched;
use crate::numerics::{count, triangle};
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::setup::Setup;
use crate::weighing::{self, Kept, Outlier, Treatment, Weighing};

pub use crate::machine::{
    Error, Line, MOUNTING_M, Nominal, NominalTrack, Prepared, Registration, length_noise,
};
pub(crate) use cost::closure_cost;
use link_sigma::Knowledge;
pub use link_sigma::LinkSigma;
pub(crate) use link_sigma::own_parameter;
use minimum::Minimum;
pub(crate) use output::statics;
pub use output::{LinkResult, ParameterEstimate, Source};
pub(crate) use output::{reference, widened};
pub use serial::Serial;
pub use stated::Stated;
pub(crate) use undetermined::undetermined;

/// Relative change of the cost at which a fit ends: parameters stay within 1e-6 of their standard deviations, where a
/// valley bends within 1e-3.
pub(crate) const EXACT_COST: f64 = 1e-12;
/// Distance of a joint from where forces of the arm take it to be, as a share of the length of the links, from which they
/// are computed anew: they are off by as large a share, of what compliances move mostly less than a micrometre.
const OTHER_FORCES: f64 = 1e-4;

/// Options of a calibration.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Start in place of the nominal values: one value per parameter of the variant, SI.
    /// Priors stay those of the nominal values.
    pub start: Option<Vec<f64>>,
    /// Options of the solver.
    pub solver: tau_solver::Options,
    /// Treatment of outliers; by default they are left out.
    pub treatment: Treatment,
    /// True if a scale of the whole machine that no measurement determines is fitted all the same, where poses are
    /// unknown.
    pub free_scale: bool,
    /// True if carts take no part, as in the paper, where poses were measured.
    pub poses_alone: bool,
    /// True if mistakes of rows are recognised where these are not met and poses are unknown, before more is tried to fit
    /// them as they are.
    pub recognises_mistakes: bool,
}

impl Options {
    /// Refuses to free the scale where poses are measured.
    ///
    /// # Errors
    /// [`Self::free_scale`] is set.
    pub fn refuse_free_scale(&self) -> Result<(), InputError> {
        if !self.free_scale {
            return Ok(());
        }
        let message = "found measured poses, which determine the scale of the machine: there is nothing to free";
        Err(InputError::whole(fit::SCALE_MEASURED, TCP_POSES, message)
            .help("leave `--free-scale` out (`free_scale` of the options)"))
    }
}

/// A combination of parameters that the data do not determine.
#[derive(Debug, Clone, PartialEq)]
pub struct Combination {
    /// Parameter names with their shares, largest first; shares are in units of the tolerances.
    pub terms: Vec<(String, f64)>,
    /// Standard deviation of the combination from the data alone, relative to its prior; infinite
    /// where the data say nothing.
    pub data_over_prior: f64,
}

/// A calibrated variant.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// The variant with its calibrated values.
    pub machine: Machine,
    /// Registration of set 2 that angles of piecewise tracks refer to.
    pub registration: Option<Registration>,
    /// The robot file with calibrated values and their standard deviations; tolerances are the
    /// priors', so that it can be calibrated again.
    pub file: RobotFile,
    /// Table II.
    pub links: Vec<LinkResult>,
    /// Every parameter that the closures depend on. Angles of piecewise tracks are those against the
    /// registered path, nominally zero; in [`Self::links`] and [`Self::file`] they are absolute.
    pub parameters: Vec<ParameterEstimate>,
    /// Index of each of them in the variant.
    pub used: Vec<usize>,
    /// Covariance of [`Self::parameters`], in their order, priors included.
    pub covariance: Vec<Vec<f64>>,
    /// Lower triangle F by rows with F·Fᵀ the covariance, to more digits than it has; `None` where nothing determines a
    /// parameter.
    pub factor: Option<Vec<Vec<f64>>>,
    /// Pairs of parameters with the largest correlations, largest first.
    pub correlations: Vec<(String, String, f64)>,
    /// Combinations that the data leave to the priors, worst first.
    pub undetermined: Vec<Combination>,
    /// Half the sum of squared whitened residuals and priors.
    pub cost: f64,
    /// Number of calibration poses that took part.
    pub poses: usize,
    /// Weights of the poses that were given: outliers, and readings that share what the model lacks.
    pub weighing: Weighing,
    /// Correlation of the noise of poses that follow each other, if there is any.
    pub serial: Option<Serial>,
    /// The carts of sets 2 and 3, if they took part.
    pub carts: Option<Carts>,
    /// Iterations of the solver, summed over independent parts.
    pub iterations: usize,
    /// Why the solver stopped, in words.
    pub termination: String,
    /// The fit that judges it, where weighing the poses came by it, and the values that it started from.
    pub(crate) known: Option<Arc<(Vec<f64>, Judged)>>,
    /// Fingerprint of the poses, outliers included, where it was made of nothing else.
    pub(crate) made_of: Option<String>,
}

/// Carts of sets 2 and 3 in a calibration.
#[derive(Debug, Clone)]
pub struct Carts {
    /// Fit of each kind of measurement.
    pub groups: Vec<GroupFit>,
    /// Measurements far off all others.
    pub outliers: Vec<Outlier>,
}

impl Calibration {
    /// The fit to its poses under the priors by which it is judged, if it is known already.
    pub(crate) fn judged(&self) -> Option<&Judged> {
        let (values, judged) = self.known.as_deref()?;
        (*values == self.machine.values).then_some(judged)
    }

    /// Refuses poses of which it was not made.
    pub(crate) fn refuse_others(&self, folder: &Folder, poses: &[usize]) -> Result<(), InputError> {
        let made_of = self.made_of.as_deref();
        if made_of.is_some_and(|made_of| made_of != fingerprint(folder, poses)) {
            let message = "the calibration was made of other poses than these";
            return Err(InputError::whole(fit::OTHER_CALIBRATION, &folder.name, message).help(
                "ask for the verdict of the session that calibrated; others have `verdict_on_prediction`",
            ));
        }
        Ok(())
    }
}

/// A variant with the values of a robot file: nominal ones or those of an earlier calibration.
///
/// `folder` is needed where the variant has piecewise tracks and the file does not hold their paths, and, together with `poses` (indices
/// of its TCP poses), where the arm is reduced and the file gives links only: their plate joints
/// are then carried into the track offsets by the mean measured rotation of these poses.
///
/// # Errors
/// A parameter for which nothing gives a value; a piecewise track without its path.
pub fn machine_from_file(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: Option<&Folder>,
    poses: &[usize],
) -> Result<Machine, InputError> {
    Ok(Prepared::from_file(robot, variant, file, folder, poses)?.machine)
}

/// Calibrates a variant on TCP poses of a folder, given by index: the least sum of squares rᵀΣ⁻¹r of the closures r of each
/// pose (eq. 5 of Dressler et al. 2010), plus the priors.
///
/// The closures of a pose share the noise of its position and rotation: Σ = G·diag(σ_T², σ_R²)·Gᵀ with the derivatives G of
/// closures by the pose where a fit of each closure for itself puts the machine. The bias that this noise
/// gives the score is taken off. Points of measured paths are unknowns with the noise of a position. Poses are [weighed](crate::weighing): outliers are left
/// out or lose their pull, and readings of one visit count by what they do not share.
///
/// # Errors
/// [`Error::Input`] for fewer poses than parameters, poses that are all the same, poses out of reach,
/// values or columns missing; [`Error::NotConverged`] if the solver does not reach a minimum.
pub fn calibrate(
    setup: Setup<'_>,
    poses: &[usize],
    options: &Options,
) -> Result<Calibration, Error> {
    options.refuse_free_scale()?;
    let folder = setup.folder;
    let file = &setup.file.completed(setup.robot);
    let setup = Setup { file, ..setup };
    let are_alone = options.poses_alone || !setup.takes_carts();
    check_poses(setup, poses, are_alone)?;
    let mut prepared = setup.prepared(poses)?;
    let found = from_prepared(&prepared, file, folder, poses, options)?;
    let measured = measured_at(folder, poses);
    let first = measured.first().map(|&pose| pose.into());
    let length_m = first.and_then(|first| prepared.machine.mean_length_m(&first).ok());
    let length_m = length_m.unwrap_or(f64::INFINITY);
    let forces = forces_elsewhere(&prepared.machine, &found.machine, file, length_m);
    if forces.is_none() {
        return Ok(found);
    }
    prepared.machine.surroundings.statics = forces;
    let options = Options {
        start: Some(found.machine.values),
        ..options.clone()
    };
    from_prepared(&prepared, file, folder, poses, &options)
}

/// Fingerprint of measured poses, by index; of what is there.
fn fingerprint(folder: &Folder, poses: &[usize]) -> String {
    let measured = poses.iter().filter_map(|&pose| folder.tcp_poses.get(pose));
    of_numbers(measured.flat_map(|pose| {
        let numbers = pose.position_m.iter().chain(&pose.angles_rad);
        numbers.chain(&pose.commands_m).copied()
    }))
}

fn measured_at<'a>(folder: &'a Folder, poses: &[usize]) -> Vec<&'a TcpPose> {
    poses.iter().map(|&pose| &folder.tcp_poses[pose]).collect()
}

/// Forces of the arm as it was found, where they matter and joints do not stand where they were taken to be.
fn forces_elsewhere(
    before: &Machine,
    found: &Machine,
    file: &RobotFile,
    length_m: f64,
) -> Option<Statics> {
    let taken = (before.surroundings.statics.as_ref()).filter(|_| before.reads_forces())?;
    statics(found, file).filter(|after| after.joints_apart_m(taken) >= OTHER_FORCES * length_m)
}

/// The calibration from prepared values.
fn from_prepared(
    prepared: &Prepared,
    file: &RobotFile,
    folder: &Folder,
    poses: &[usize],
    options: &Options,
) -> Result<Calibration, Error> {
    let (robot, variant) = (&prepared.machine.robot, &prepared.machine.variant);
    let measured = measured_at(folder, poses);
    let start = options.start.as_deref().unwrap_or(&prepared.machine.values);
    if start.len() != variant.parameters.len() {
        let (given, expected) = (start.len(), variant.parameters.len());
        let what = format!("{given} start values, expected {expected}");
        return Err(InputError::whole(fit::START_VALUES, &folder.name, what).into());
    }
    let samples = Sample::all(robot, folder, poses, &Frames::default());
    let range_m = searched::widest(measured.iter().flat_map(|pose| &pose.commands_m));
    let (values, iterations) = start::near(
        prepared,
        start,
        &samples,
        (file.noise, range_m),
        &options.solver,
    )?;
    // Noise is weighed near the minimum: the ways of links at the nominal values may be others.
    let near = Prepared {
        machine: prepared.machine.with_values(values.clone()),
        ..prepared.clone()
    };
    let setup = Setup::new(robot, variant, file, folder);
    let are_alone = options.poses_alone || !setup.takes_carts();
    let weighed = |prepared: &Prepared, values: &[f64]| {
        let weighed = weighing::weighed(prepared, values, &samples, file.noise, options.treatment);
        let (mut weighing, judged) = weighed?;
        let left: Vec<usize> = weighing.taking_part(poses).collect();
        if let Err(error) = check_places(setup, &left, are_alone) {
            weighing = weighing.keeping_outliers(Kept::Needed(error.text()));
        }
        let minimum = Minimum::of(prepared, values, (&samples, file.noise), &weighing, judged)?;
        Ok::<_, Error>((weighing, minimum))
    };
    let (mut weighing, mut minimum) = weighed(&near, &values)?;
    let mut serial = None;
    // Readings of one visit share what they share.
    if weighing.repeats.is_none() {
        let measured = (samples.as_slice(), file);
        serial = Serial::of(&near, &minimum.fitted, measured, &weighing.fit)?;
    } else {
        serial::refuse_rho(file)?;
    }
    let mut of_serial = near;
    if let Some(found) = serial {
        of_serial.machine.surroundings.serial = Some(found.rho);
        (weighing, minimum) = weighed(&of_serial, &minimum.values)?;
    }
    let (prepared, machine) = (&of_serial, &of_serial.machine);
    let known = &minimum.known;
    let posterior = known.posterior();
    let (_, undetermined) = (known.undetermined(variant, &minimum.values))
        .map_err(|error| not_converged(machine, unsolved(&error)))?;
    let fitted = Fitted {
        covariance: triangle::rows(&posterior.covariance()),
        // Measured poses leave no motion open along which parameters would curve.
        second_order: vec![0.0; known.used.len()],
        factor: known.factor(&posterior, &prepared.track_scales),
        undetermined,
        cost: minimum.cost,
        iterations: iterations + minimum.iterations,
        termination: Termination::Cost.to_string(),
        used: known.used.clone(),
        values: minimum.values,
    };
    let measured: Vec<&TcpPose> = (weighing.taking_part(poses))
        .map(|pose| &folder.tcp_poses[pose])
        .collect();
    let calibration = finish(prepared, file, &measured, fitted)?;
    Ok(Calibration {
        weighing,
        serial,
        known: (minimum.judged)
            .map(|judged| Arc::new((calibration.machine.values.clone(), judged))),
        made_of: Some(fingerprint(folder, poses)),
        ..calibration
    })
}

/// A fitted variant.
pub(crate) struct Fitted {
    /// Value of each of the variant's parameters, SI.
    pub(crate) values: Vec<f64>,
    /// Indices of those that the closures depend on.
    pub(crate) used: Vec<usize>,
    /// Their covariance, priors included.
    pub(crate) covariance: Vec<Vec<f64>>,
    /// Mean squares of their errors of second order.
    pub(crate) second_order: Vec<f64>,
    /// Lower triangle of the covariance, and behind the parameters of the [scales](Prepared::track_scales) that it holds; `None`
    /// where nothing determines a parameter.
    pub(crate) factor: Option<Vec<Vec<f64>>>,
    pub(crate) undetermined: Vec<Combination>,
    pub(crate) cost: f64,
    pub(crate) iterations: usize,
    pub(crate) termination: String,
}

/// Puts together what a fit to the given poses hands on.
pub(crate) fn finish(
    prepared: &Prepared,
    file: &RobotFile,
    poses: &[&TcpPose],
    fitted: Fitted,
) -> Result<Calibration, Error> {
    let machine = prepared.machine.with_values(fitted.values);
    let estimates = output::estimates(
        &machine,
        &prepared.nominal,
        &fitted.used,
        &fitted.covariance,
        &fitted.second_order,
    );
    let name = |place: usize| estimates[place].name.clone();
    let priors = estimates.iter().map(|own| own.tolerance);
    let priors: Vec<f64> = priors.map(|own| own.unwrap_or(f64::INFINITY)).collect();
    let known = Knowledge {
        used: &fitted.used,
        covariance: &fitted.covariance,
        second_order: &fitted.second_order,
        priors: &priors,
    };
    let shown: Vec<tau_kinematics::Sample<'_>> = poses.iter().map(|&pose| pose.into()).collect();
    Ok(Calibration {
        links: output::links(&machine, &known, prepared.registration.as_ref(), poses)?,
        file: RobotFile {
            reference: reference(&machine, &shown).or_else(|| file.reference.clone()),
            paths: if prepared.measured_paths.is_empty() {
                file.paths.clone()
            } else {
                prepared.measured_paths.clone()
            },
            covariance: output::covariance(
                (&estimates, prepared.names_of_track_scales()),
                fitted.factor.as_deref(),
                (prepared.registration.as_ref()).filter(|_| !prepared.measured_paths.is_empty()),
            ),
            ..output::file(
                &machine,
                &estimates,
                &fitted.used,
                file,
                prepared.registration.as_ref(),
            )
        },
        correlations: correlations(&fitted.covariance)
            .into_iter()
            .map(|(a, b, value)| (name(a), name(b), value))
            .collect(),
        covariance: fitted.covariance,
        factor: fitted.factor,
        parameters: estimates,
        used: fitted.used,
        undetermined: fitted.undetermined,
        cost: fitted.cost,
        poses: poses.len(),
        weighing: Weighing::even(poses.len()),
        iterations: fitted.iterations,
        termination: fitted.termination,
        registration: prepared.registration,
        machine,
        serial: None,
        carts: None,
        known: None,
        made_of: None,
    })
}

/// Checks that poses are as many as a variant needs, in reach, and apart. Unless they `are_alone`, other sets of the folder
/// are fitted with them, so that residuals of these judge the fit, too.
///
/// # Errors
/// They are not.
pub fn check_poses(setup: Setup<'_>, poses: &[usize], are_alone: bool) -> Result<(), InputError> {
    check_places(setup, poses, are_alone)?;
    setup.folder.check_reach(poses, setup.robot, setup.file)
}

/// Checks that poses are as many as a variant needs, and apart.
pub(crate) fn check_places(
    setup: Setup<'_>,
    poses: &[usize],
    are_alone: bool,
) -> Result<(), InputError> {
    let Setup {
        robot,
        variant,
        folder,
        ..
    } = setup;
    let moves = |pose: &usize| {
        let (pose, first) = (&folder.tcp_poses[*pose], &folder.tcp_poses[poses[0]]);
        let differ = |a: &[f64], b: &[f64]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-6);
        differ(&pose.position_m, &first.position_m)
    };
    if poses.len() > 1 && !poses.iter().any(moves) {
        return Err(InputError::whole(
            fit::SAME_POSES,
            &folder.name,
            format!(
                "all {} calibration poses are the same, expected them spread out",
                poses.len()
            ),
        ));
    }
    let needed = poses_needed(variant, robot.plate.is_in_plane());
    let [of_closure, enough, degrees, parameters] = needed;
    let least = if are_alone { enough } else { of_closure };
    let mut places = BTreeSet::new();
    for &pose in poses {
        let commands = folder.tcp_poses[pose].commands_m.iter();
        places.insert(commands.map(|own| own.to_bits()).collect::<Vec<u64>>());
        if places.len() >= least {
            return Ok(());
        }
    }
    let of = (parameters, variant.name.as_str());
    folder.check_pose_count(places.len(), (enough, degrees), of)
}

/// True of components along z, on which closures of a plate in the plane depend by their squares alone.
pub(crate) fn is_along_z(variant: &Variant, parameter: usize) -> bool {
    variant.parameters[parameter].component == Some(2)
}

/// Calibration poses that a variant needs: as many as its largest closure has parameters, counting those that several share
/// in parts; and so many that a residual is left to judge a fit by. Then the residuals that these leave, and the parameters that
/// they determine. Of a plate in the plane none follows z.
fn poses_needed(variant: &Variant, is_in_plane: bool) -> [usize; 4] {
    let closures: Vec<&Instance> = variant.instances_of(ResidualKind::Closure).collect();
    let free = |closure: &&Instance| {
        let all = closure.parameters.clone().into_iter();
        all.filter(move |&own| !(is_in_plane && is_along_z(variant, own)))
    };
    let mut users = vec![0.0_f64; variant.parameters.len()];
    (closures.iter().flat_map(&free)).for_each(|own| users[own] += 1.0);
    let parts = |closure: &&Instance| free(closure).map(|own| users[own].recip()).sum::<f64>();
    let largest = closures.iter().map(parts).fold(0.0, f64::max);
    let parameters = users.iter().filter(|&&users| users > 0.0).count();
    // The small allowance keeps thirds that add up to a whole number from being rounded up.
    let of_closure = count((largest - 1e-9).ceil());
    let enough = of_closure.max(parameters / closures.len().max(1) + 1);
    let degrees = (enough * closures.len()).saturating_sub(parameters);
    [of_closure, enough, degrees, parameters]
}

/// The pairs with the largest correlations, largest first.
fn correlations(covariance: &[Vec<f64>]) -> Vec<(usize, usize, f64)> {
    const LISTED: usize = 12;
    let sigma = |i: usize| covariance[i][i].sqrt();
    let correlation = |a: usize, b: usize| match covariance[b][a] {
        0.0 => 0.0,
        shared => shared / (sigma(a) * sigma(b)),
    };
    let mut pairs: Vec<(usize, usize, f64)> = (0..covariance.len())
        .flat_map(|a| (0..a).map(move |b| (b, a)))
        .map(|(a, b)| (a, b, correlation(a, b)))
        .filter(|(.., correlation)| correlation.is_finite())
        .collect();
    pairs.sort_by(|a, b| b.2.abs().total_cmp(&a.2.abs()));
    pairs.truncate(LISTED);
    pairs
}

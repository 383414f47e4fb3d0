//! A calibration that states what a fit to more than closures found.

use nalgebra::DMatrix;
use tau_kinematics::Machine;
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot::ResidualKind;
use tau_robot::robot_file::RobotFile;

use crate::numerics::triangle;

use super::{Calibration, Error, Fitted, Prepared, finish};

/// A fitted variant, as it is stated.
#[derive(Debug)]
pub struct Stated {
    /// Value of each of the variant's parameters, SI.
    pub values: Vec<f64>,
    /// Covariance of all of them (products of their SI units), priors included; zero where a parameter was not fitted.
    pub covariance: DMatrix<f64>,
    /// Half the sum of squared whitened residuals and priors, of all that was fitted.
    pub cost: f64,
}

impl Prepared {
    /// States a fit as a calibration on poses of a folder, given by index; `file` is the robot file that the fit
    /// started from.
    ///
    /// # Errors
    /// A pose lacks what its closures read.
    pub fn stated(
        &self,
        file: &RobotFile,
        folder: &Folder,
        poses: &[usize],
        stated: Stated,
    ) -> Result<Calibration, Error> {
        let Machine { variant, .. } = &self.machine;
        let mut used: Vec<usize> = variant
            .instances_of(ResidualKind::Closure)
            .flat_map(|closure| closure.parameters.iter().copied())
            .collect();
        used.sort_unstable();
        used.dedup();
        let row = |&a: &usize| used.iter().map(|&b| stated.covariance[(a, b)]).collect();
        let covariance: Vec<Vec<f64>> = used.iter().map(row).collect();
        let fitted = Fitted {
            factor: triangle::lower(&covariance),
            second_order: vec![0.0; used.len()],
            covariance,
            values: stated.values,
            undetermined: vec![],
            cost: stated.cost,
            iterations: 0,
            termination: "fitted to all sets".to_owned(),
            used,
        };
        let measured: Vec<&TcpPose> = poses.iter().map(|&pose| &folder.tcp_poses[pose]).collect();
        finish(self, file, &measured, fitted)
    }
}

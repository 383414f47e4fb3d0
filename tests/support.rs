//! What several themes need: the prototype's robot and measurements, and random numbers from a seed.

use tau::Robot;
use tau::measurements::Folder;
use tau::robot_file::RobotFile;

/// The standard Gantry-Tau, with its generated code.
pub(crate) fn gantry_tau() -> Robot {
    Robot::from(&tau_generated::gantry_tau::ROBOT)
}

/// The measurements that the project ships, and the robot file with them.
pub(crate) fn prototype() -> (Folder, RobotFile) {
    (
        tau::prototype::folder().unwrap(),
        tau::prototype::robot_file().unwrap(),
    )
}

/// The SplitMix64 generator (Steele, Lea, Flood, OOPSLA 2014).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Evenly between −1 and 1.
    pub(crate) fn uniform(&mut self) -> f64 {
        2.0 * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64) - 1.0
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (0.5 * (self.uniform() + 1.0) + f64::MIN_POSITIVE).ln()).sqrt();
        radius * (std::f64::consts::PI * self.uniform()).cos()
    }
}

/// Table II of the paper, model 3: every link with its own direction.
pub(crate) fn paper_file() -> RobotFile {
    let (_, mut file) = prototype();
    let rows = include_str!("reference/table2_linear.csv").lines().skip(1);
    for row in rows
        .map(|row| row.split(',').collect::<Vec<_>>())
        .filter(|row| row[0] == "3")
    {
        let numbers: Vec<f64> = row[2..12]
            .iter()
            .map(|number| number.parse().unwrap())
            .collect();
        let link = file.links.get_mut(&format!("l{}", row[1])).unwrap();
        let slots = [
            (&mut link.length, &numbers[..1]),
            (&mut link.plate_joint, &numbers[1..4]),
            (&mut link.track_offset, &numbers[4..7]),
            (&mut link.track_direction, &numbers[7..]),
        ];
        for (slot, numbers) in slots {
            slot.as_mut().unwrap().value = numbers.to_vec();
        }
    }
    file
}

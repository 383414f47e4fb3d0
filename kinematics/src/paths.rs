//! Measured paths of the carts, for piecewise tracks.

use nalgebra::{Rotation3, Vector3};

/// The path of a cart: straight between measured points (eq. 4 of Dressler et al. 2010).
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    commands: Vec<f64>,
    points: Vec<Vector3<f64>>,
}

/// The stretch of a path that holds a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Commands at its two ends (m).
    pub commands: [f64; 2],
    /// Its two ends, relative to the path's point at q = 0 (m).
    pub ends: [Vector3<f64>; 2],
}

impl Path {
    /// Through measured points (m), in any order; points at the same command (m) are averaged. `None`
    /// where there are fewer than two different commands.
    pub fn new(measured: &[(f64, Vector3<f64>)]) -> Option<Self> {
        let (commands, points) = Self::averaged(measured);
        let mut path = Self { commands, points };
        if path.commands.len() < 2 {
            return None;
        }
        let origin = path.at(0.0);
        path.points.iter_mut().for_each(|point| *point -= origin);
        Some(path)
    }

    /// The commands (m) in order, and the mean of the points (m) measured at each.
    pub fn averaged(measured: &[(f64, Vector3<f64>)]) -> (Vec<f64>, Vec<Vector3<f64>>) {
        let mut sorted = measured.to_vec();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        sorted
            .chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq())
            .map(|same| {
                let sum: Vector3<f64> = same.iter().map(|&(_, point)| point).sum();
                (same[0].0, sum / same.len() as f64)
            })
            .unzip()
    }

    /// Index of the measured point at which the segment that holds a command (m) starts: the first or the
    /// last one for a command beyond the ends.
    fn start(&self, command: f64) -> usize {
        let inner = &self.commands[1..self.commands.len() - 1];
        inner.partition_point(|&q| q <= command)
    }

    /// The segment that holds a command (m).
    pub fn segment(&self, command: f64) -> Segment {
        let start = self.start(command);
        Segment {
            commands: [self.commands[start], self.commands[start + 1]],
            ends: [self.points[start], self.points[start + 1]],
        }
    }

    /// The point at a command (m), relative to that at q = 0 (m).
    pub fn at(&self, command: f64) -> Vector3<f64> {
        let Segment {
            commands: [q0, q1],
            ends: [start, end],
        } = self.segment(command);
        start + (end - start) * ((command - q0) / (q1 - q0))
    }

    /// Indices of the two measured points that a command's (m) point depends on, and its derivative by each.
    pub fn shares(&self, command: f64) -> [(usize, f64); 2] {
        let start = self.start(command);
        let [q0, q1] = self.segment(command).commands;
        let weight = (command - q0) / (q1 - q0);
        [(start, 1.0 - weight), (start + 1, weight)]
    }

    /// Commands of the measured points (m), in order.
    pub fn commands(&self) -> &[f64] {
        &self.commands
    }

    /// The path turned about its point at q = 0.
    #[must_use]
    pub fn turned(mut self, rotation: &Rotation3<f64>) -> Self {
        self.points
            .iter_mut()
            .for_each(|point| *point = rotation * *point);
        self
    }

    /// Lowest and highest measured command (m).
    pub fn range(&self) -> (f64, f64) {
        (self.commands[0], self.commands[self.commands.len() - 1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_interpolated_relative_to_zero() {
        let point = |x: f64| Vector3::new(x, 0.0, 0.0);
        let path = Path::new(&[
            (1.0, point(5.0)),
            (-1.0, point(1.0)),
            (1.0, point(7.0)),
            (2.0, point(8.0)),
        ])
        .unwrap();
        assert_eq!(path.at(0.0), point(0.0));
        assert_eq!(path.at(1.0), point(2.5));
        assert_eq!(path.at(1.5), point(3.5));
        assert_eq!(path.at(3.0), point(6.5), "the last segment goes on");
        assert_eq!(path.segment(-5.0).commands, [-1.0, 1.0]);
        assert_eq!(path.commands(), [-1.0, 1.0, 2.0]);
        assert_eq!(path.shares(1.25), [(1, 0.75), (2, 0.25)]);
        assert_eq!(path.shares(-2.0), [(0, 1.5), (1, -0.5)]);
        assert!(Path::new(&[(1.0, point(5.0)), (1.0, point(1.0))]).is_none());
    }
}

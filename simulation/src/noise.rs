//! Noise of the measurement, well-behaved or not.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::random::Random;

/// Shape of the noise's distribution, always of variance one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Tails {
    /// Normal.
    #[default]
    Normal,
    /// Student's t of three degrees of freedom.
    Heavy,
}

/// Noise of the measurement. The robot file states its size; everything else here is what an estimator
/// is not told.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// True noise of sets 1, 2 and 3 over the stated one: `[1.25; 3]` where it is a quarter larger,
    /// `[0.0; 3]` for none at all.
    pub scale: [f64; 3],
    /// Shape.
    pub tails: Tails,
    /// Share of a pose's variance that all its coordinates have in common.
    pub common: f64,
    /// Share of its variance that a reading of set 1 has in common with the others of the same visit: what the machine
    /// does not repeat.
    pub visit: f64,
    /// Correlation of successive measurements, AR(1).
    pub serial: f64,
    /// Share of the TCP poses that are outliers.
    pub outliers: f64,
    /// Size of an outlier, in standard deviations of position and of rotation.
    pub outlier_size: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            scale: [1.0; 3],
            tails: Tails::Normal,
            common: 0.0,
            visit: 0.0,
            serial: 0.0,
            outliers: 0.0,
            outlier_size: 20.0,
        }
    }
}

impl Noise {
    /// A deviate of its shape, of variance one.
    pub(super) fn deviate(&self, random: &mut Random) -> f64 {
        match self.tails {
            Tails::Normal => random.normal(),
            Tails::Heavy => random.student3(),
        }
    }
}

/// Displacement of a measured pose in standard deviations: position, rotation vector.
pub(super) type Deviation = [Vector3<f64>; 2];

/// Draws noise in the order of measurement.
pub(super) struct Generator<'a> {
    noise: &'a Noise,
    random: Random,
    /// The last deviation of each series: by set and cart.
    before: BTreeMap<(usize, usize), Deviation>,
}

impl<'a> Generator<'a> {
    pub(super) fn new(noise: &'a Noise, seed: u64) -> Self {
        Self {
            noise,
            random: Random::new(seed, "noise"),
            before: BTreeMap::new(),
        }
    }

    /// Deviate that the measurements of one pose share.
    pub(super) fn pose(&mut self) -> f64 {
        self.fresh()
    }

    /// The next deviation of a cart (0 for the TCP) in a set, from 1.
    pub(super) fn next(&mut self, set: usize, cart: usize, common: f64) -> Deviation {
        let (own, shared) = ((1.0 - self.noise.common).sqrt(), self.noise.common.sqrt());
        let mut deviation: Deviation =
            [0, 1].map(|_| Vector3::from_fn(|_, _| own * self.fresh() + shared * common));
        let serial = self.noise.serial;
        if let Some(before) = self.before.get(&(set, cart)) {
            for (now, before) in deviation.iter_mut().zip(before) {
                *now = before * serial + *now * (1.0 - serial * serial).sqrt();
            }
        }
        self.before.insert((set, cart), deviation);
        deviation.map(|part| part * self.noise.scale[set - 1])
    }

    fn fresh(&mut self) -> f64 {
        self.noise.deviate(&mut self.random)
    }
}

/// Deviations that the readings of each visit of set 1 share, and how much of a reading's own is beside them.
pub(super) struct Visits {
    random: Random,
    own: f64,
    shared: f64,
}

/// Displacement of the plate at each visit, in standard deviations of what is measured of it: that of set 1.
pub(super) fn displacements(seed: u64, stops: usize) -> Vec<Vector3<f64>> {
    let mut random = Random::new(seed, "visits");
    let of_visit = |_| {
        let [shift, _turn] = [0, 1].map(|_| random.normals());
        shift
    };
    (0..stops).map(of_visit).collect()
}

impl Visits {
    pub(super) fn new(noise: &Noise, seed: u64) -> Self {
        Self {
            random: Random::new(seed, "visits"),
            own: (1.0 - noise.visit).sqrt(),
            shared: noise.visit.sqrt() * noise.scale[0],
        }
    }

    /// The next visit's.
    pub(super) fn next(&mut self) -> Deviation {
        [0, 1].map(|_| Vector3::from_fn(|_, _| self.shared * self.random.normal()))
    }

    /// A reading's deviation with that of its visit.
    pub(super) fn with(&self, own: Deviation, visit: &Deviation) -> Deviation {
        [0, 1].map(|k| own[k] * self.own + visit[k])
    }
}

/// Deviates of the numbers of successive rows of a file, of variance one.
pub(super) struct Series<'a> {
    noise: &'a Noise,
    before: Option<[f64; 3]>,
}

impl<'a> Series<'a> {
    pub(super) fn new(noise: &'a Noise) -> Self {
        Self {
            noise,
            before: None,
        }
    }

    /// Those of the next row, which has so many numbers; `visit` is what the place where the plate stood adds to each.
    pub(super) fn next(&mut self, random: &mut Random, count: usize, visit: [f64; 3]) -> [f64; 3] {
        let Noise {
            common,
            visit: share,
            serial,
            ..
        } = *self.noise;
        // A single number has all in common with itself.
        let common = if count > 1 { common } else { 0.0 };
        let shared = if common > 0.0 {
            common.sqrt() * self.noise.deviate(random)
        } else {
            0.0
        };
        let mut own = [0.0; 3];
        for own in own.iter_mut().take(count) {
            *own = (1.0 - common).sqrt() * self.noise.deviate(random) + shared;
        }
        if let Some(before) = self.before {
            for (now, before) in own.iter_mut().zip(before) {
                *now = before * serial + *now * (1.0 - serial * serial).sqrt();
            }
        }
        self.before = Some(own);
        std::array::from_fn(|k| own[k] * (1.0 - share).sqrt() + visit[k] * share.sqrt())
    }
}

/// Indices of the outliers among poses, with their deviation.
pub(super) fn outliers(noise: &Noise, poses: usize, seed: u64) -> BTreeMap<usize, Deviation> {
    let mut random = Random::new(seed, "outliers");
    let expected = noise.outliers * poses as f64;
    let count = (0..poses)
        .take_while(|&k| k as f64 + 0.5 <= expected)
        .count();
    random
        .sample(count, poses)
        .into_iter()
        .map(|index| {
            (
                index,
                [0, 1].map(|_| random.direction() * noise.outlier_size),
            )
        })
        .collect()
}

//! Contents of the drawing, in space.

use tau::discovery::results::Place;
use tau::evaluation::PoseError;
use tau::kinematics::{Layout, Rod};

use super::Pin;
use super::view::Point;
use crate::number::{extent, rms};

/// Dots of measured poses, and vectors of errors, at most.
const MOST: usize = 240;
/// Length of a typical error, rms, in the drawing over the diagonal of the machine: long enough to be seen, short
/// enough not to hide the arm. The largest error takes no more than [`LONGEST`].
const TYPICAL: f64 = 0.05;
/// The same of the largest error, which is drawn no longer.
const LONGEST: f64 = 0.25;

/// Errors at poses that are drawn.
pub(crate) struct Errors<'a> {
    /// Predicted less measured, by pose.
    pub(crate) poses: &'a [PoseError],
    /// Positions of all measured poses (m).
    pub(crate) measured_m: Vec<Point>,
    /// True if these were estimated, not measured.
    pub(crate) are_estimated: bool,
}

/// A line from a measured position towards the predicted one.
pub(super) struct Needle {
    pub(super) from: Point,
    pub(super) to: Point,
    /// True for the largest error of all.
    pub(super) is_worst: bool,
}

/// The machine with what is known of it.
pub(crate) struct Scene<'a> {
    pub(super) layout: &'a Layout,
    /// Measured positions; of those that would lie on one another one.
    pub(super) dots: Vec<Point>,
    /// True if these were estimated.
    pub(super) are_estimated: bool,
    pub(super) needles: Vec<Needle>,
    /// Factor by which errors are magnified.
    pub(crate) factor: f64,
    /// Number of poses with errors, of which needles are drawn.
    pub(crate) poses: usize,
    /// Numbers, each at the places where it acts.
    pub(super) pins: Vec<(usize, Point)>,
    /// Length of the axes that are drawn beside (m).
    pub(crate) axes_m: f64,
}

impl<'a> Scene<'a> {
    pub(crate) fn new(layout: &'a Layout, errors: &Errors<'_>, pins: &[Pin]) -> Self {
        let diagonal = diagonal(&solid(layout));
        let lengths = || errors.poses.iter().map(|error| 1e-6 * error.length_um());
        let largest = crate::number::largest(lengths());
        let typical = rms(lengths().filter(|length| length.is_finite()));
        let factor = round_down((TYPICAL * diagonal / typical).min(LONGEST * diagonal / largest));
        let worst = errors
            .poses
            .iter()
            .filter(|error| error.length_um().is_finite())
            .max_by(|a, b| a.length_um().total_cmp(&b.length_um()));
        let shown = thinned(errors.poses, |error| error.position_m, PoseError::length_um);
        let needles = shown
            .into_iter()
            .filter(|error| error.length_um().is_finite() && factor.is_finite())
            .map(|error| Needle {
                from: error.position_m,
                to: [0, 1, 2]
                    .map(|axis| error.position_m[axis] + 1e-6 * factor * error.error_um[axis]),
                is_worst: worst.is_some_and(|worst| worst.pose == error.pose),
            })
            .collect();
        let dots = thinned(&errors.measured_m, |point| *point, |_| 0.0);
        let pins = pins.iter().flat_map(|pin| {
            let places = anchors(layout, &pin.place);
            places.into_iter().map(|place| (pin.number, place))
        });
        Self {
            layout,
            dots: dots.into_iter().copied().collect(),
            are_estimated: errors.are_estimated,
            needles,
            factor,
            poses: errors.poses.len(),
            pins: pins.collect(),
            axes_m: round_down(0.12 * diagonal),
        }
    }

    /// Number of errors that are drawn.
    pub(crate) fn shown(&self) -> usize {
        self.needles.len()
    }

    /// True if something is pinned.
    pub(crate) fn has_pins(&self) -> bool {
        !self.pins.is_empty()
    }

    /// Everything that has to fit on the paper.
    pub(super) fn points(&self) -> Vec<Point> {
        let mut points = solid(self.layout);
        points.extend(&self.dots);
        points.extend(self.needles.iter().map(|needle| needle.to));
        points.retain(|point| point.iter().all(|value| value.is_finite()));
        points
    }

    /// Places of what has a name.
    pub(super) fn named(&self) -> Vec<Point> {
        let carts = self.layout.tracks.iter().map(|rail| rail.cart_m);
        let bases = self.layout.links.iter().filter(|rod| rod.track.is_none());
        let mut points: Vec<Point> = carts.chain(bases.map(|rod| rod.ends_m[0])).collect();
        points.push(self.layout.tcp_m);
        points
    }
}

/// Points of the machine itself.
fn solid(layout: &Layout) -> Vec<Point> {
    let rails = layout.tracks.iter();
    let mut points: Vec<Point> = rails
        .flat_map(|rail| rail.line_m.iter().chain(&rail.joints_m))
        .copied()
        .collect();
    points.extend(layout.links.iter().flat_map(|rod| rod.ends_m));
    points.push(layout.tcp_m);
    points.retain(|point| point.iter().all(|value| value.is_finite()));
    points
}

fn diagonal(points: &[Point]) -> f64 {
    let width = |axis: usize| {
        let (low, high) = extent(points.iter().map(|point| point[axis]));
        (high - low).max(0.0)
    };
    width(0).hypot(width(1)).hypot(width(2))
}

/// The largest of 1, 2 and 5 times a power of ten that is not above a number.
fn round_down(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return f64::NAN;
    }
    let power = 10_f64.powf(value.log10().floor());
    let digit = match value / power {
        ratio if ratio >= 5.0 => 5.0,
        ratio if ratio >= 2.0 => 2.0,
        _ => 1.0,
    };
    digit * power
}

/// At most [`MOST`] of some items: space is divided into cells as small as possible, and of each cell the heaviest item
/// stays, so that the items stay spread as they are and the heaviest of all is among them.
fn thinned<T>(items: &[T], place: impl Fn(&T) -> Point, weight: impl Fn(&T) -> f64) -> Vec<&T> {
    if items.len() <= MOST {
        return items.iter().collect();
    }
    let points: Vec<Point> = items.iter().map(&place).collect();
    let low = [0, 1, 2].map(|axis| {
        points
            .iter()
            .map(|point| point[axis])
            .fold(f64::INFINITY, f64::min)
    });
    let mut size = diagonal(&points) / MOST as f64;
    loop {
        let mut cells = std::collections::BTreeMap::new();
        let has_too_many = items.iter().zip(&points).any(|(item, point)| {
            let cell = [0, 1, 2].map(|axis| ((point[axis] - low[axis]) / size).floor() as i64);
            let kept = cells.entry(cell).or_insert(item);
            if weight(item).total_cmp(&weight(kept)).is_gt() {
                *kept = item;
            }
            // A cell that is not finite holds all: the loop ends.
            cells.len() > MOST && size.is_finite()
        });
        if !has_too_many {
            return cells.into_values().collect();
        }
        size *= 1.25;
    }
}

/// Points where an effect at a place acts.
fn anchors(layout: &Layout, place: &Place) -> Vec<Point> {
    let middle = |rod: &Rod| {
        let [a, b] = rod.ends_m;
        [0, 1, 2].map(|axis| 0.5 * (a[axis] + b[axis]))
    };
    let carts = |keep: &dyn Fn(&str) -> bool| {
        let rails = layout.tracks.iter().filter(|rail| keep(&rail.name));
        rails.map(|rail| rail.cart_m).collect::<Vec<_>>()
    };
    let links = |keep: &dyn Fn(&Rod) -> bool| {
        let rods = layout.links.iter().filter(|rod| keep(rod));
        rods.map(middle).collect::<Vec<_>>()
    };
    let cranks = |keep: &dyn Fn(&str) -> bool| {
        let cranks = layout
            .tracks
            .iter()
            .filter(|rail| rail.is_crank && keep(&rail.name));
        cranks.map(|rail| rail.cart_m).collect::<Vec<_>>()
    };
    let feet = |keep: &dyn Fn(&Rod) -> bool| {
        let rods = layout.links.iter().filter(|rod| keep(rod));
        rods.map(|rod| rod.ends_m[0])
            .collect::<Vec<_>>()
            .into_iter()
    };
    match place {
        Place::Cart(name) | Place::CartFrom(name, _) | Place::Crank(name) => {
            carts(&|own| own == name)
        }
        Place::Link(name) | Place::Cluster(name) => {
            links(&|rod| rod.name == *name || rod.cluster == *name)
        }
        Place::AllCarts => carts(&|_| true),
        Place::AllCranks => cranks(&|_| true),
        Place::BaseJoint(name) => {
            let joints = feet(&|rod| rod.name == *name);
            joints.chain(cranks(&|own| own == name)).collect()
        }
        Place::AllBaseJoints => {
            let joints = feet(&|rod| rod.track.is_none());
            joints.chain(cranks(&|_| true)).collect()
        }
        Place::AllLinks => links(&|_| true),
        Place::Tcp => vec![layout.tcp_m],
        Place::Command(number) => {
            let index = number.wrapping_sub(1);
            let driven = links(&|rod| rod.driven_by == Some(index));
            if driven.is_empty() {
                let rail = layout.tracks.get(index);
                rail.map(|rail| rail.cart_m).into_iter().collect()
            } else {
                driven
            }
        }
        Place::Several(places) => places
            .iter()
            .flat_map(|place| anchors(layout, place))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_round_and_not_above() {
        for (value, expected) in [(1.0, 1.0), (4.9, 2.0), (730.0, 500.0), (0.06, 0.05)] {
            assert!(
                (round_down(value) / expected - 1.0).abs() < 1e-12,
                "{value}"
            );
        }
        assert!(round_down(0.0).is_nan() && round_down(f64::INFINITY).is_nan());
    }

    #[test]
    fn of_many_poses_the_spread_and_the_worst_stay() {
        let poses: Vec<Point> = (0..20_000_u32)
            .map(|k| [0.618, 0.414, 0.732].map(|step| (f64::from(k) * step).fract()))
            .collect();
        let weight = |point: &Point| if *point == poses[777] { 9.0 } else { point[0] };
        let kept = thinned(&poses, |point| *point, weight);
        assert!(
            kept.len() <= MOST && kept.len() > MOST / 4,
            "{}",
            kept.len()
        );
        assert!(kept.contains(&&poses[777]));
        // No corner is left empty: every item has one that stays nearby.
        for pose in poses.iter().step_by(97) {
            let distance = |other: &Point| diagonal(&[*pose, *other]);
            let nearest = kept.iter().map(|other| distance(other)).fold(9.0, f64::min);
            assert!(nearest < 0.45, "{nearest}");
        }
        assert_eq!(thinned(&poses[..9], |point| *point, |_| 0.0).len(), 9);
    }
}

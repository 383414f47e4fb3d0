//! From space to paper: an orthographic projection from a side.

use crate::number;

/// Width and height of the drawing.
pub(super) const SIZE: [f64; 2] = [680.0, 470.0];
/// Free room around it, for names.
const MARGIN: [f64; 2] = [58.0, 30.0];

/// A point in space (m), z upwards.
pub(super) type Point = [f64; 3];

/// A side from which the machine is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct View {
    /// Direction towards the eye, about z from x (rad).
    pub(super) azimuth: f64,
    /// The same above the horizontal (rad).
    pub(super) elevation: f64,
    /// The point in the middle of the paper.
    pub(super) centre: Point,
    /// Units of the paper per metre.
    pub(super) scale: f64,
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl View {
    /// Unit vectors to the right and upwards on the paper, and towards the eye.
    fn axes(&self) -> [Point; 3] {
        let (sa, ca) = self.azimuth.sin_cos();
        let (se, ce) = self.elevation.sin_cos();
        [
            [-sa, ca, 0.0],
            [-se * ca, -se * sa, ce],
            [ce * ca, ce * sa, se],
        ]
    }

    /// Place on the paper; y counts downwards.
    pub(super) fn project(&self, point: Point) -> [f64; 2] {
        let [right, up, _] = self.axes();
        let offset = [0, 1, 2].map(|axis| point[axis] - self.centre[axis]);
        [
            0.5 * SIZE[0] + self.scale * dot(right, offset),
            0.5 * SIZE[1] - self.scale * dot(up, offset),
        ]
    }

    /// Distance towards the eye (m), to draw first what is behind.
    pub(super) fn depth(&self, point: Point) -> f64 {
        let [_, _, towards] = self.axes();
        dot(towards, point)
    }

    /// From a direction, so that all points fit on the paper.
    pub(super) fn fitted(azimuth: f64, elevation: f64, points: &[Point]) -> Self {
        let unit = Self {
            azimuth,
            elevation,
            centre: [0.0; 3],
            scale: 1.0,
        };
        let [right, up, _] = unit.axes();
        let extent = |axis: Point| number::extent(points.iter().map(|&point| dot(axis, point)));
        let (across, upwards) = (extent(right), extent(up));
        let room = [SIZE[0] - 2.0 * MARGIN[0], SIZE[1] - 2.0 * MARGIN[1]];
        let scale = (room[0] / (across.1 - across.0)).min(room[1] / (upwards.1 - upwards.0));
        // Of the points that project to the middle, the one in the middle of the depths.
        let [_, _, towards] = unit.axes();
        let deep = extent(towards);
        let middle = [across, upwards, deep].map(|(low, high)| 0.5 * (low + high));
        let centre =
            [0, 1, 2].map(|k| right[k] * middle[0] + up[k] * middle[1] + towards[k] * middle[2]);
        Self {
            centre,
            scale: if scale.is_finite() { scale } else { 1.0 },
            ..unit
        }
    }

    /// From the side on which parts with names stand furthest apart on paper: of all views from all round, the one that
    /// makes the smallest distance between two of them largest. Sides near an axis of the frame are left out: grids of poses
    /// and two of the axes would be seen end on.
    pub(super) fn clearest(named: &[Point], points: &[Point]) -> Self {
        /// Seen from so far above (rad): the plane of the base opens to two fifths of its depth, as drawings in three
        /// axes have it.
        const ELEVATION: f64 = 0.44;
        /// Directions around the machine among which the one with the most to see is chosen, 7.5° apart.
        const SIDES: u32 = 48;
        /// Least angle to an axis (rad), so that no axis runs into the paper.
        const OBLIQUE: f64 = 0.26;
        let sides = (0..SIDES)
            .map(|side| std::f64::consts::TAU * (f64::from(side) + 0.5) / f64::from(SIDES));
        let views = sides
            .filter(|azimuth| (2.0 * azimuth).sin().abs() >= (2.0 * OBLIQUE).sin())
            .map(|azimuth| Self::fitted(azimuth, ELEVATION, points));
        let apart = |view: &Self| {
            let places: Vec<[f64; 2]> = named.iter().map(|&point| view.project(point)).collect();
            let pairs = places.iter().enumerate().flat_map(|(index, a)| {
                places[..index]
                    .iter()
                    .map(move |b| (a[0] - b[0]).hypot(a[1] - b[1]))
            });
            pairs.fold(f64::INFINITY, f64::min)
        };
        views
            .max_by(|a, b| {
                apart(a)
                    .total_cmp(&apart(b))
                    .then(b.azimuth.total_cmp(&a.azimuth))
            })
            .unwrap_or_else(|| Self::fitted(-1.0, ELEVATION, points))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(azimuth: f64, elevation: f64) -> View {
        View {
            azimuth,
            elevation,
            centre: [0.0; 3],
            scale: 100.0,
        }
    }

    fn near(found: [f64; 2], expected: [f64; 2]) {
        let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
        assert!(off < 1e-9, "{found:?} {expected:?}");
    }

    #[test]
    fn from_above_and_from_the_front_it_is_plan_and_elevation() {
        let point = [0.3, -0.7, 1.1];
        // From the front, against y: x to the right, z up.
        let front = view(-std::f64::consts::FRAC_PI_2, 0.0).project(point);
        near(front, [340.0 + 30.0, 235.0 - 110.0]);
        // From above with the same heading: x to the right, y up.
        let plan = view(-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2).project(point);
        near(plan, [340.0 + 30.0, 235.0 + 70.0]);
    }

    /// The isometric projection: axes 120° apart, all shortened to the root of two thirds.
    #[test]
    fn the_isometric_view_is_that_of_the_textbook() {
        let view = view(std::f64::consts::FRAC_PI_4, (1.0 / 3.0_f64.sqrt()).asin());
        let shortened = 100.0 * (2.0_f64 / 3.0).sqrt();
        for (axis, degrees) in [(0, 210.0_f64), (1, 330.0), (2, 90.0)] {
            let mut point = [0.0; 3];
            point[axis] = 1.0;
            let (sine, cosine) = degrees.to_radians().sin_cos();
            near(
                view.project(point),
                [340.0 + shortened * cosine, 235.0 - shortened * sine],
            );
        }
    }

    #[test]
    fn everything_fits_and_fills_one_direction() {
        let points = [[3.0, 1.0, 0.0], [4.0, 2.0, 5.0], [3.5, -1.0, 2.0]];
        for azimuth in [0.1, 1.4, 4.0] {
            let view = View::fitted(azimuth, 0.4, &points);
            let places = points.map(|point| view.project(point));
            let span = |axis: usize| {
                let values = places.map(|place| place[axis]);
                (
                    values.iter().copied().fold(f64::INFINITY, f64::min),
                    values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                )
            };
            let room = [0, 1].map(|axis| {
                let (low, high) = span(axis);
                assert!((low + high - SIZE[axis]).abs() < 1e-9, "centred");
                low - MARGIN[axis]
            });
            let least = room[0].min(room[1]);
            assert!(least.abs() < 1e-9, "{room:?}");
        }
    }

    #[test]
    fn what_is_nearer_has_more_depth() {
        let view = view(0.3, 0.5);
        assert!(view.depth([1.0, 0.2, 0.5]) > view.depth([0.0; 3]));
        assert!(view.depth([0.0, 0.0, 1.0]) > view.depth([0.0; 3]));
    }

    #[test]
    fn the_clearest_side_is_that_on_which_nothing_hides_anything() {
        // Two posts along y on a round base, which keeps the scale: seen along y one post hides the other.
        let posts = [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
        let points: Vec<Point> = (0..360_u32)
            .map(|degrees| {
                let (sine, cosine) = f64::from(degrees).to_radians().sin_cos();
                [cosine, sine, 0.0]
            })
            .collect();
        let view = View::clearest(&posts, &points);
        assert!(view.azimuth.cos().abs() > 0.9, "{view:?}");
        let [one, other] = posts.map(|post| view.project(post));
        let apart = (one[0] - other[0]).hypot(one[1] - other[1]);
        assert!(apart > 0.9 * (SIZE[0] - 2.0 * MARGIN[0]), "{apart}");
    }
}

//! The arm in space: where its joints stand at a pose, and along which lines its carts run.
//!
//! Dimensions alone: effects displace joints by micrometres, which nobody sees in a drawing.

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3};
use tau_robot::robot::{CrankValue, Formula, Input, Instance, Owner, Readable, TrackShape, Value};

use super::{Machine, Pose, xyz};

/// Points of a line across the commands of a piecewise track or a crank: the drawing shows its bends, of which a track
/// has a few.
const PATH_POINTS: usize = 33;

/// The joints of a machine at one pose, in the measurement frame (m).
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Name of the variant.
    pub variant: String,
    /// The TCP.
    pub tcp_m: [f64; 3],
    /// Tracks in order of declaration, with their carts.
    pub tracks: Vec<Rail>,
    /// Links, or one in place of each cluster where the arm is reduced.
    pub links: Vec<Rod>,
    /// Outline of the plate: its joints seen along the direction in which they spread least, those inside left out.
    /// Empty where the arm is reduced.
    pub plate_m: Vec<[f64; 3]>,
    /// The same of the joints on the fixed base, where there are any.
    pub base_m: Vec<[f64; 3]>,
}

/// A track with the cart on it, or a crank.
#[derive(Debug, Clone, PartialEq)]
pub struct Rail {
    /// Name of the track.
    pub name: String,
    /// True for a crank in place of a cart: its joints run on arcs.
    pub is_crank: bool,
    /// The line of the cart's reference point, the mean of its joints, from the lowest command to the highest.
    pub line_m: Vec<[f64; 3]>,
    /// The reference point.
    pub cart_m: [f64; 3],
    /// Outline of the cart: its joints, as those of the plate.
    pub joints_m: Vec<[f64; 3]>,
}

/// A link.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Name of the link, or of the cluster.
    pub name: String,
    /// Name of its cluster.
    pub cluster: String,
    /// Index of its track; `None` on the fixed base.
    pub track: Option<usize>,
    /// Index of the command that drives its length, where one does.
    pub driven_by: Option<usize>,
    /// The joint on the cart or the base, and the joint on the plate.
    pub ends_m: [[f64; 3]; 2],
}

/// A joint on a cart or the base, and how it moves.
struct Joint<'a> {
    machine: &'a Machine,
    track: Option<usize>,
    /// Axis and centre of the crank that it turns with.
    crank: Option<[Vector3<f64>; 2]>,
    offset: Vector3<f64>,
    direction: Vector3<f64>,
    rotation: Vector3<f64>,
}

impl Joint<'_> {
    fn at(&self, command: f64) -> Vector3<f64> {
        let Some(track) = self.track else {
            return self.offset;
        };
        if let Some([axis, centre]) = self.crank {
            return centre + Rotation3::new(axis * command) * (self.offset - centre);
        }
        match self.machine.measured_path(track) {
            Some(path) => self.offset + xyz(self.rotation.into()) * path.at(command),
            None => self.offset + self.direction * command,
        }
    }
}

impl Machine {
    /// Place (m) at q = 0 of each joint that rides on a track's cart, and its motion per command, a measured path straight
    /// between its ends, whether they are parameters or follow from formulas; in order of link or cluster. None on a crank.
    pub fn joint_lines(&self, track: usize) -> Vec<[Vector3<f64>; 2]> {
        let path = self.measured_path(track);
        let own = self.closure_instances().map(|closure| self.joint(closure));
        own.filter(|joint| joint.track == Some(track) && joint.crank.is_none())
            .map(|joint| {
                let direction = path.map_or(joint.direction, |path| {
                    let (first, last) = path.range();
                    let chord = (path.at(last) - path.at(first)) / (last - first);
                    xyz(joint.rotation.into()) * chord
                });
                [joint.offset, direction]
            })
            .collect()
    }

    /// The joint of a closure on its cart, its crank or the base.
    fn joint(&self, closure: &Instance) -> Joint<'_> {
        let track = self.track_of(closure);
        Joint {
            machine: self,
            track,
            crank: track.and_then(|track| self.crank(track)),
            offset: self.value(closure, Value::TrackOffset),
            direction: self.value(closure, Value::TrackDirection),
            rotation: self.dimension(closure, "track_rotation"),
        }
    }

    /// The joint of a closure on its cart, its crank or the base, and that on the plate, at a pose and its commands (m).
    pub(crate) fn ends(
        &self,
        closure: &Instance,
        pose: &Pose,
        commands_m: &[f64],
    ) -> [Vector3<f64>; 2] {
        let joint = self.joint(closure);
        let command = joint.track.and_then(|track| commands_m.get(track));
        let plate = pose.position + pose.rotation * self.value(closure, Value::PlateJoint);
        [joint.at(command.copied().unwrap_or(0.0)), plate]
    }

    /// The joints at a pose and its commands (m); `ranges_m` are the lowest and highest of each command, between which
    /// tracks are drawn.
    pub fn layout(&self, pose: &Pose, commands_m: &[f64], ranges_m: &[(f64, f64)]) -> Layout {
        let command = |track: Option<usize>| track.and_then(|track| commands_m.get(track)).copied();
        let mut links = Vec::new();
        let mut joints = Vec::new();
        for closure in self.closure_instances() {
            let (link, cluster) = match self.variant.arm {
                tau_robot::robot::Arm::Full => {
                    let link = &self.robot.links[closure.of];
                    (Some(link), link.cluster)
                }
                tau_robot::robot::Arm::Reduced => (None, closure.of),
            };
            let cluster = &self.robot.clusters[cluster];
            links.push(Rod {
                name: self.closure_name(closure).to_owned(),
                cluster: cluster.name.clone(),
                track: cluster.track,
                driven_by: link.and_then(|link| link.actuated_by),
                ends_m: self.ends(closure, pose, commands_m).map(Into::into),
            });
            joints.push(self.joint(closure));
        }
        let tracks = (self.robot.tracks.iter().enumerate())
            .filter_map(|(track, name)| {
                let own: Vec<&Joint<'_>> = (joints.iter())
                    .filter(|joint| joint.track == Some(track))
                    .collect();
                let reference = |command: f64| {
                    let sum: Vector3<f64> = own.iter().map(|joint| joint.at(command)).sum();
                    sum / own.len() as f64
                };
                if own.is_empty() {
                    return None;
                }
                let now = command(Some(track))?;
                let (low, high) = ranges_m.get(track).copied().unwrap_or((now, now));
                let at = |step: usize| low + (high - low) * step as f64 / (PATH_POINTS - 1) as f64;
                let is_crank = self.robot.is_crank(track);
                let is_straight =
                    !is_crank && self.variant.tracks[track].shape == TrackShape::Linear;
                let steps: Vec<usize> = if is_straight {
                    vec![0, PATH_POINTS - 1]
                } else {
                    (0..PATH_POINTS).collect()
                };
                Some(Rail {
                    name: name.clone(),
                    is_crank,
                    line_m: (steps.into_iter())
                        .map(|step| reference(at(step)).into())
                        .collect(),
                    cart_m: reference(now).into(),
                    joints_m: outline(own.iter().map(|joint| joint.at(now))),
                })
            })
            .collect();
        let ends = |end: usize, keep: &dyn Fn(&Rod) -> bool| {
            let rods = links.iter().filter(|rod| keep(rod));
            outline(rods.map(|rod| Vector3::from(rod.ends_m[end])))
        };
        let is_full = self.turns();
        Layout {
            variant: self.variant.name.clone(),
            tcp_m: pose.position_m(),
            plate_m: ends(1, &|_| is_full),
            base_m: ends(0, &|rod| rod.track.is_none()),
            tracks,
            links,
        }
    }

    /// Length (m) of the link or cluster of a closure, effects left out, as their formulas read it: it may follow from a
    /// formula of the commands; of a drive that counts from a zero of its own it is that at command zero.
    pub fn length_m(&self, closure: &Instance, commands: &[f64]) -> f64 {
        let (owner, formula, drive) = match self.variant.arm {
            tau_robot::robot::Arm::Full => (
                Owner::Link(closure.of),
                self.robot.formula_of(closure.of, Value::Length),
                self.robot.links[closure.of].actuated_by,
            ),
            tau_robot::robot::Arm::Reduced => (Owner::Cluster(closure.of), None, None),
        };
        let Some(formula) = formula else {
            let index = self.variant.parameter(owner, Value::Length.name(), None);
            return index.map_or(f64::NAN, |index| self.values[index]);
        };
        let leaf = |part: &Formula| match *part {
            Formula::Read(Readable::Command) => commands.get(drive?).copied(),
            Formula::OfLink(other, k) => Some(self.value(closure, other)[k]),
            _ => self.of_robot(part),
        };
        formula.value(&leaf).unwrap_or(f64::NAN)
    }

    /// A vector of the link of a closure that is no parameter of its own to fit: from a formula, or held; `None` where
    /// there is none.
    pub fn described(&self, closure: &Instance, value: Value) -> Option<[f64; 3]> {
        let is_full = self.variant.arm == tau_robot::robot::Arm::Full;
        let has = |value: Value| {
            let formula = self.robot.formula_of(closure.of, value);
            let own = Owner::Link(closure.of);
            formula.is_some() || self.variant.parameter(own, value.name(), Some(0)).is_some()
        };
        (is_full && has(value)).then(|| self.value(closure, value).into())
    }

    /// Joint (m) of a closure on the base, or on its cart or crank at command zero, effects left out.
    pub fn base_joint_m(&self, closure: &Instance) -> [f64; 3] {
        self.value(closure, Value::TrackOffset).into()
    }

    /// Centre (m) of the crank of a track, effects left out.
    pub fn crank_centre_m(&self, track: usize) -> Option<[f64; 3]> {
        self.crank(track).map(|[_, centre]| centre.into())
    }

    /// A vector of a link or cluster, which may follow from a formula.
    fn value(&self, closure: &Instance, value: Value) -> Vector3<f64> {
        let formula = match self.variant.arm {
            tau_robot::robot::Arm::Full => self.robot.formula_of(closure.of, value),
            tau_robot::robot::Arm::Reduced => None,
        };
        match formula {
            Some(Formula::Vector(components)) => Vector3::from_fn(|k, _| {
                let leaf = |part: &Formula| match *part {
                    Formula::OfLink(other, k) => Some(self.value(closure, other)[k]),
                    _ => self.of_robot(part),
                };
                components[k].value(&leaf).unwrap_or(0.0)
            }),
            _ => self.dimension(closure, value.name()),
        }
    }

    /// A component of a parameter of the machine.
    fn of_robot(&self, leaf: &Formula) -> Option<f64> {
        let Formula::OfRobot(index, component) = *leaf else {
            return None;
        };
        let parameter = self.robot.model.parameters.get(index)?;
        let component = (parameter.components > 1).then_some(component);
        let index = (self.variant).parameter(Owner::Robot, &parameter.name, component)?;
        self.values.get(index).copied()
    }

    /// Axis and centre of a crank.
    fn crank(&self, track: usize) -> Option<[Vector3<f64>; 2]> {
        let crank = self.robot.model.tracks.get(track)?.crank.as_ref()?;
        Some([CrankValue::Axis, CrankValue::Centre].map(|value| {
            Vector3::from_fn(|k, _| match crank.formula(value) {
                Some(Formula::Vector(components)) => components[k]
                    .value(&|leaf| self.of_robot(leaf))
                    .unwrap_or(0.0),
                _ => {
                    let owner = Owner::Crank(track);
                    let index = self.variant.parameter(owner, value.name(), Some(k));
                    index.map_or(0.0, |index| self.values[index])
                }
            })
        }))
    }

    /// A vector that a closure depends on; zero where the variant does not have it.
    fn dimension(&self, closure: &Instance, quantity: &str) -> Vector3<f64> {
        let component = |k: usize| {
            let held = closure.inputs.iter().filter_map(|input| match *input {
                Input::Held(index) => Some(index),
                _ => None,
            });
            let mut indices = closure.parameters.iter().copied().chain(held);
            let found = indices.find(|&index| {
                let parameter = &self.variant.parameters[index];
                let is_dimension = matches!(
                    parameter.owner,
                    Owner::Link(of) | Owner::Cluster(of) if of == closure.of
                ) || matches!(parameter.owner, Owner::Track(_));
                is_dimension && parameter.quantity == quantity && parameter.component == Some(k)
            });
            found.map_or(0.0, |index| self.values[index])
        };
        Vector3::new(component(0), component(1), component(2))
    }
}

/// The convex hull of points, seen along the direction in which they spread least, in turn. One or two points are all
/// of it.
fn outline(points: impl Iterator<Item = Vector3<f64>>) -> Vec<[f64; 3]> {
    let points: Vec<Vector3<f64>> = points.collect();
    if points.len() < 3 {
        return points.into_iter().map(Into::into).collect();
    }
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let spread: Matrix3<f64> = (points.iter())
        .map(|point| (point - mean) * (point - mean).transpose())
        .sum();
    let eigen = SymmetricEigen::new(spread);
    let least = eigen.eigenvalues.imin();
    let [u, v] = [(least + 1) % 3, (least + 2) % 3]
        .map(|column| eigen.eigenvectors.column(column).into_owned());
    let mut flat: Vec<(f64, f64, Vector3<f64>)> = (points.iter())
        .map(|point| ((point - mean).dot(&u), (point - mean).dot(&v), *point))
        .collect();
    flat.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    // Andrew's monotone chain: the lower half from the left, the upper half back.
    let half = |points: &mut dyn Iterator<Item = (f64, f64, Vector3<f64>)>| {
        let mut chain: Vec<(f64, f64, Vector3<f64>)> = Vec::new();
        for next in points {
            while let [.., a, b] = chain.as_slice() {
                let turn = (b.0 - a.0) * (next.1 - a.1) - (b.1 - a.1) * (next.0 - a.0);
                if turn > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(next);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut flat.iter().copied());
    hull.extend(half(&mut flat.iter().rev().copied()));
    hull.into_iter().map(|(_, _, point)| point.into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outline_goes_round_and_leaves_out_what_is_inside() {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)];
        let inside = (0.9, 0.6);
        // In a plane that is tilted, in no order.
        let lift = |(x, y): (f64, f64)| Vector3::new(x, y, 0.3 * x - 0.2 * y);
        let order = [2, 4, 0, 3, 1].map(|k| if k == 4 { inside } else { corners[k] });
        let hull = outline(order.into_iter().map(lift));
        assert_eq!(hull.len(), 4);
        let length: f64 = (0..4)
            .map(|k| (Vector3::from(hull[k]) - Vector3::from(hull[(k + 1) % 4])).norm())
            .sum();
        let side = |a: usize, b: usize| (lift(corners[a]) - lift(corners[b])).norm();
        let expected = side(0, 1) + side(1, 2) + side(2, 3) + side(3, 0);
        assert!((length - expected).abs() < 1e-12, "{length} {expected}");
    }

    #[test]
    fn two_joints_are_a_line() {
        let points = [Vector3::x(), Vector3::y()];
        assert_eq!(
            outline(points.into_iter()),
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        );
    }
}

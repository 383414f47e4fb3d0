//! The motion of a cart: paths of its joints, and what effects add.
//!
//! A track's frame is v̂, ẑ × v̂ normalised, and the third. Each link's path has its own v̂; directions on one cart
//! differ by parts in ten thousand, which matters for no displacement of less than a millimetre. A cart's rotation vector
//! is the small one that explains, by least squares, how its joints' paths differ: one joint has none, and with two the
//! rotation about the line between them is taken as none.
//!
//! The segment of a piecewise track is data: its end points, relative to the path's point at q = 0, and the
//! interpolation weight, which is prepared work. So `track_offset` means the same, and takes the same prior, in linear
//! and piecewise variants. `track_rotation` are angles about x, y, z, small ones on top of a registration of set 2.

use tau_model_dsl::model::{Arm, CrankValue, Place, Target, TrackShape, Value};
use tau_runtime::{Input, Owner};

use super::Context;
use super::formula::Scope;
use crate::graph::{Elementary, Expr, Stage};
use crate::vector::{self, Rotation, Vector};

/// Displacement of a cart by effects, in its track's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Displacement {
    /// Along, horizontal, vertical (m).
    pub(super) shift: Vector,
    /// Roll, pitch, yaw (rad).
    pub(super) turn: Vector,
}

/// The path of one joint.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    /// Position at the command, without effects (m).
    pub(super) position: Vector,
    /// Displacement since q = 0 (m).
    pub(super) travel: Vector,
    /// Position at q = 0 (m).
    pub(super) offset: Vector,
    /// Direction of travel, not normalised.
    pub(super) direction: Vector,
}

impl Context<'_> {
    /// Links or clusters whose joints ride on a cart.
    pub(super) fn joints(&self, track: usize) -> Vec<Owner> {
        match self.variant.arm {
            Arm::Full => self
                .model
                .links_of_track(track)
                .into_iter()
                .map(Owner::Link)
                .collect(),
            Arm::Reduced => self
                .model
                .clusters_of_track(track)
                .into_iter()
                .map(Owner::Cluster)
                .collect(),
        }
    }

    /// Owner of the direction or rotation of a joint's path.
    fn path_owner(&self, joint: Owner, track: usize) -> Owner {
        match (self.variant.arm, self.variant.tracks[track].per_link) {
            (Arm::Full, false) => Owner::Track(track),
            _ => joint,
        }
    }

    /// The path of a joint (eqs. 2 and 4).
    pub(super) fn path(&mut self, joint: Owner, track: usize) -> Path {
        let offset = self.vector_value(joint, Value::TrackOffset);
        let q = self.driven(track);
        let (travel, direction) = match self.variant.tracks[track].shape {
            TrackShape::Linear => {
                let direction = self.direction_of(joint);
                (vector::scale(&mut self.g, q, direction), direction)
            }
            TrackShape::Piecewise => {
                let (point, direction) = self.segment(track, q);
                let owner = self.path_owner(joint, track);
                let angles = self.vector_parameter(owner, "track_rotation");
                let rotation = Rotation::xyz(angles);
                let travel = rotation.apply(&mut self.g, point, "path");
                let direction = rotation.apply(&mut self.g, direction, "direction");
                (travel, direction)
            }
            TrackShape::Crank => self.turned(track, q, offset),
        };
        let position = vector::add(&mut self.g, offset, travel);
        Path {
            position,
            travel,
            offset,
            direction,
        }
    }

    /// Direction of a joint's straight path: its own, or that of its cart.
    pub(super) fn direction_of(&mut self, joint: Owner) -> Vector {
        let track = match joint {
            Owner::Link(link) => self.model.clusters[self.model.links[link].cluster].track,
            Owner::Cluster(cluster) => self.model.clusters[cluster].track,
            _ => None,
        };
        match (self.formula_of(joint, Value::TrackDirection), track) {
            (None, Some(track)) => {
                let owner = self.path_owner(joint, track);
                self.vector_parameter(owner, "track_direction")
            }
            _ => self.vector_value(joint, Value::TrackDirection),
        }
    }

    /// Displacement of a joint on a crank since q = 0, by Rodrigues' formula, and its direction of travel.
    fn turned(&mut self, track: usize, q: Expr, offset: Vector) -> (Vector, Vector) {
        let axis = self.crank_value(track, CrankValue::Axis);
        let centre = self.crank_value(track, CrankValue::Centre);
        let g = &mut self.g;
        let square = vector::dot(g, axis, axis);
        let size = g.apply(Elementary::Sqrt, square);
        let unit = axis.map(|component| g.divide(component, size));
        let angle = g.multiply(size, q);
        g.name(angle, "angle");
        let (sine, cosine) = (
            g.apply(Elementary::Sin, angle),
            g.apply(Elementary::Cos, angle),
        );
        let arm = vector::subtract(g, offset, centre);
        let height = vector::dot(g, unit, arm);
        let along = vector::scale(g, height, unit);
        let outward = vector::subtract(g, arm, along);
        let sideways = vector::cross(g, unit, arm);
        let one = g.constant(1.0);
        let back = g.subtract(cosine, one);
        let (inward, swing) = (
            vector::scale(g, back, outward),
            vector::scale(g, sine, sideways),
        );
        let travel = vector::add(g, inward, swing);
        let (inward, swing) = (
            vector::scale(g, sine, outward),
            vector::scale(g, cosine, sideways),
        );
        let direction = vector::subtract(g, swing, inward);
        (travel, direction)
    }

    /// Point and slope of the measured path at a command. The segment is data, so at a knot the
    /// derivative is that of the side from which the segment was chosen.
    fn segment(&mut self, track: usize, q: Expr) -> (Vector, Vector) {
        let start = self.vector_datum(|component| Input::SegmentStart { track, component });
        let end = self.vector_datum(|component| Input::SegmentEnd { track, component });
        let start_q = self.datum(Input::SegmentStartCommand(track));
        let end_q = self.datum(Input::SegmentEndCommand(track));
        let g = &mut self.g;
        let (length, along) = (g.subtract(end_q, start_q), g.subtract(q, start_q));
        let step = vector::subtract(g, end, start);
        let slope = step.map(|component| g.divide(component, length));
        let advance = vector::scale(g, along, slope);
        let point = vector::add(g, start, advance);
        for ((&p, &s), axis) in point.iter().zip(&slope).zip(["x", "y", "z"]) {
            if g.stage(p) == Stage::Data {
                g.name(p, format!("point_{axis}"));
            }
            g.name(s, format!("slope_{axis}"));
        }
        (point, slope)
    }

    /// Unit vectors of a track's frame: v̂, ẑ × v̂ normalised, and the third.
    ///
    /// On a track within 25° of vertical ẑ × v̂ says nothing, and x̂ takes the place of ẑ.
    pub(super) fn frame(&mut self, direction: Vector) -> [Vector; 3] {
        let g = &mut self.g;
        let along = vector::normalize(g, direction);
        let steepness = g.multiply(along[2], along[2]);
        let limit = g.constant(0.82);
        let (zero, one) = (g.constant(0.0), g.constant(1.0));
        let reference = [
            g.select(steepness, limit, zero, one),
            zero,
            g.select(steepness, limit, one, zero),
        ];
        let across = vector::cross(g, reference, along);
        let horizontal = vector::normalize(g, across);
        let vertical = vector::cross(g, along, horizontal);
        [along, horizontal, vertical]
    }

    /// Displacement of a cart by the variant's effects; `None` where they add nothing.
    pub(super) fn displacement(&mut self, track: usize, at_tcp: bool) -> Option<Displacement> {
        let zero = self.g.constant(0.0);
        let mut total = Displacement {
            shift: [zero; 3],
            turn: [zero; 3],
        };
        let variant = self.variant;
        for (index, used) in variant.effects.iter().enumerate() {
            let source = match used.place {
                Place::Cart {
                    track: place,
                    source,
                } if place == track => source,
                Place::AllCarts if self.model.tracks[track].crank.is_none() => None,
                _ => continue,
            };
            let scope = Scope {
                command: Some(track),
                track: Some(track),
                source,
                at_tcp,
                ..Scope::default()
            };
            for (target, value) in self.terms(index, scope) {
                let slot = match target {
                    Target::Along => &mut total.shift[0],
                    Target::Horizontal => &mut total.shift[1],
                    Target::Vertical => &mut total.shift[2],
                    Target::Roll => &mut total.turn[0],
                    Target::Pitch => &mut total.turn[1],
                    Target::Yaw => &mut total.turn[2],
                    Target::Length
                    | Target::Joint
                    | Target::Position
                    | Target::Command
                    | Target::Shift => {
                        unreachable!("the checker admits only cart targets on a cart")
                    }
                };
                *slot = self.g.add(*slot, value[0]);
            }
        }
        let is_zero = |v: &Vector| v.iter().all(|&component| self.g.is_zero(component));
        (!is_zero(&total.shift) || !is_zero(&total.turn)).then_some(total)
    }

    /// Target and amount of each term of an effect of the variant.
    pub(super) fn terms(&mut self, index: usize, scope: Scope) -> Vec<(Target, Vec<Expr>)> {
        let effect = self.variant.effects[index].effect;
        let terms = self.model.effects[effect].terms.iter();
        terms
            .map(|term| (term.target, self.of_effect(index, &term.formula, scope)))
            .collect()
    }

    /// Mean of the joints' positions at q = 0: the cart's reference point.
    pub(super) fn reference(&mut self, track: usize) -> Vector {
        let offsets: Vec<Vector> = self
            .joints(track)
            .into_iter()
            .map(|joint| self.vector_value(joint, Value::TrackOffset))
            .collect();
        vector::mean(&mut self.g, &offsets)
    }

    /// A joint's position at the command, effects included. `pose` residuals see the TCP.
    pub(super) fn joint_position(&mut self, joint: Owner, track: usize) -> Vector {
        let path = self.path(joint, track);
        let Some(displacement) = self.displacement(track, true) else {
            return path.position;
        };
        let frame = self.frame(path.direction);
        let mut position = path.position;
        for (axis, amount) in frame.iter().zip(displacement.shift) {
            let shift = vector::scale(&mut self.g, amount, *axis);
            position = vector::add(&mut self.g, position, shift);
        }
        if displacement
            .turn
            .iter()
            .any(|&angle| !self.g.is_zero(angle))
        {
            let reference = self.reference(track);
            let g = &mut self.g;
            let arm = vector::subtract(g, path.offset, reference);
            let turn = combine(g, displacement.turn, &frame);
            let shift = vector::cross(g, turn, arm);
            position = vector::add(g, position, shift);
        }
        position
    }

    /// Reference point of a cart at the command, and its rotation vector since q = 0, both with effects.
    ///
    /// The point is the mean path of the joints; the rotation is the one that explains, in the sense
    /// of least squares, how the joints' paths differ from the mean.
    pub(super) fn cart_motion(&mut self, track: usize) -> (Vector, Vector) {
        let joints = self.joints(track);
        let paths: Vec<Path> = joints
            .into_iter()
            .map(|joint| self.path(joint, track))
            .collect();
        let displacement = self.displacement(track, false);
        let g = &mut self.g;
        let positions: Vec<Vector> = paths.iter().map(|path| path.position).collect();
        let mut point = vector::mean(g, &positions);
        let mut rotation = implied_rotation(g, &paths);
        if let Some(displacement) = displacement {
            let directions: Vec<Vector> = paths.iter().map(|path| path.direction).collect();
            let direction = vector::mean(g, &directions);
            let frame = self.frame(direction);
            let g = &mut self.g;
            let shift = combine(g, displacement.shift, &frame);
            let turn = combine(g, displacement.turn, &frame);
            point = vector::add(g, point, shift);
            rotation = vector::add(g, rotation, turn);
        }
        (point, rotation)
    }
}

fn combine(g: &mut crate::graph::Graph, amounts: Vector, frame: &[Vector; 3]) -> Vector {
    let mut total = vector::zero(g);
    for (axis, amount) in frame.iter().zip(amounts) {
        let part = vector::scale(g, amount, *axis);
        total = vector::add(g, total, part);
    }
    total
}

/// The small rotation ω that minimises Σ‖ω × sᵢ − δᵢ‖², with sᵢ the joints' lever arms from their mean
/// and δᵢ their travel beyond the mean travel.
///
/// One joint says nothing; two leave the rotation about their connecting line open (taken as none);
/// three or more give (Σ |sᵢ|² I − sᵢ sᵢᵀ) ω = Σ sᵢ × δᵢ, solved by the adjugate.
fn implied_rotation(g: &mut crate::graph::Graph, paths: &[Path]) -> Vector {
    let offsets: Vec<Vector> = paths.iter().map(|path| path.offset).collect();
    let travels: Vec<Vector> = paths.iter().map(|path| path.travel).collect();
    if travels.windows(2).all(|pair| pair[0] == pair[1]) {
        return vector::zero(g);
    }
    if let ([s1, s2], [t1, t2]) = (offsets.as_slice(), travels.as_slice()) {
        let (arm, difference) = (vector::subtract(g, *s1, *s2), vector::subtract(g, *t1, *t2));
        let moment = vector::cross(g, arm, difference);
        let square = vector::dot(g, arm, arm);
        return moment.map(|component| g.divide(component, square));
    }
    let mean_offset = vector::mean(g, &offsets);
    let mean_travel = vector::mean(g, &travels);
    let mut moment = vector::zero(g);
    let zero = g.constant(0.0);
    let mut inertia = [[zero; 3]; 3];
    for (offset, travel) in offsets.iter().zip(&travels) {
        let arm = vector::subtract(g, *offset, mean_offset);
        let difference = vector::subtract(g, *travel, mean_travel);
        let part = vector::cross(g, arm, difference);
        moment = vector::add(g, moment, part);
        let square = vector::dot(g, arm, arm);
        for row in 0..3 {
            for column in row..3 {
                let product = g.multiply(arm[row], arm[column]);
                let entry = if row == column {
                    g.subtract(square, product)
                } else {
                    g.negate(product)
                };
                inertia[row][column] = g.add(inertia[row][column], entry);
                inertia[column][row] = inertia[row][column];
            }
        }
    }
    // Rows of the adjugate of a symmetric matrix are the cross products of its rows.
    let adjugate = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| vector::cross(g, inertia[i], inertia[j]));
    let determinant = vector::dot(g, inertia[0], adjugate[0]);
    adjugate.map(|row| {
        let numerator = vector::dot(g, row, moment);
        g.divide(numerator, determinant)
    })
}

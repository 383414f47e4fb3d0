//! The residuals once more, written directly from the equations with dual numbers.
//!
//! Shares no code with the generator beyond the description's model: matrices instead of turns, a
//! formula walker of its own, forward derivatives instead of reverse ones.

mod forces;
mod matrices;

use std::collections::BTreeMap;

use num_dual::{Dual64, DualNum};
use tau::robot::{Arm, Input, Instance, Owner, ResidualKind, TrackShape, Variant};
use tau_model_dsl::model::{
    self, BinaryOperator, Formula, Function, Model, Place, Readable, Target,
};

use matrices::{
    V, about_x, about_y, about_z, apply, columns, cross, dot, frame, implied, mean, minus, plus,
    product, rotated, transpose, unit,
};

/// Values of all data by what they are, and of all parameters of a variant.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    /// Data.
    pub(crate) data: BTreeMap<Input, f64>,
    /// Parameters, by index in the variant's table.
    pub(crate) parameters: Vec<f64>,
}

/// Variables of a derivative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum By {
    /// A parameter of the variant.
    Parameter(usize),
    /// Plate translation.
    Translation(usize),
    /// Plate rotation vector.
    Rotation(usize),
    /// A command.
    Command(usize),
}

/// Residuals and their derivatives by one variable.
pub(crate) fn residuals(
    model: &Model,
    variant: &Variant,
    instance: &Instance,
    point: &Point,
    by: By,
) -> Vec<Dual64> {
    let reference = Reference {
        model,
        variant,
        described: model
            .variant(&variant.name)
            .expect("a variant of the model"),
        point,
        by,
    };
    match instance.kind {
        ResidualKind::Closure | ResidualKind::ClosureByPose => vec![reference.closure(instance.of)],
        ResidualKind::CartPose => reference.target(instance.of, 2),
        ResidualKind::CartPosition => reference.target(instance.of, 3),
        ResidualKind::TrackerError => vec![reference.tracker_error(instance.of)],
    }
}

struct Reference<'a> {
    model: &'a Model,
    variant: &'a Variant,
    described: &'a model::Variant,
    point: &'a Point,
    by: By,
}

#[derive(Clone, Copy)]
struct Scope {
    effect: usize,
    command: Option<usize>,
    track: Option<usize>,
    source: Option<usize>,
    link: Option<usize>,
    length_of: Option<Owner>,
    at_zero: bool,
    set_one: bool,
}

struct Joint {
    offset: V,
    travel: V,
    direction: V,
}

impl Reference<'_> {
    fn seed(&self, value: f64, by: By) -> Dual64 {
        Dual64::new(value, if self.by == by { 1.0 } else { 0.0 })
    }

    fn parameter(&self, owner: Owner, quantity: &str, component: Option<usize>) -> Dual64 {
        let index = self
            .variant
            .parameter(owner, quantity, component)
            .unwrap_or_else(|| {
                panic!(
                    "{owner:?} {quantity} {component:?} is not in {}",
                    self.variant.name
                )
            });
        self.seed(self.point.parameters[index], By::Parameter(index))
    }

    fn vector(&self, owner: Owner, quantity: &str) -> V {
        [0, 1, 2].map(|c| self.parameter(owner, quantity, Some(c)))
    }

    fn datum(&self, input: Input) -> Dual64 {
        let value = self.point.data[&input];
        match input {
            Input::Command(command) => self.seed(value, By::Command(command)),
            Input::Position(component) => self.seed(value, By::Translation(component)),
            _ => Dual64::from(value),
        }
    }

    fn joints(&self, track: usize) -> Vec<Owner> {
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

    /// The formula of a link's value, if it is one.
    fn derived(&self, owner: Owner, value: model::Value) -> Option<&Formula> {
        match owner {
            Owner::Link(link) => self.model.links[link].defaults.formula(value),
            _ => None,
        }
    }

    fn of_link(&self, owner: Owner) -> Scope {
        let link = match owner {
            Owner::Link(link) => Some(link),
            _ => None,
        };
        Scope {
            effect: usize::MAX,
            command: link.and_then(|link| self.model.links[link].actuated_by),
            track: None,
            source: None,
            link,
            length_of: Some(owner),
            at_zero: false,
            set_one: true,
        }
    }

    fn length(&self, owner: Owner) -> Dual64 {
        match self.derived(owner, model::Value::Length) {
            Some(formula) => self.formula(formula, self.of_link(owner)),
            None => self.parameter(owner, "length", None),
        }
    }

    fn value(&self, owner: Owner, value: model::Value) -> V {
        match self.derived(owner, value) {
            Some(Formula::Vector(parts)) => {
                [0, 1, 2].map(|k| self.formula(&parts[k], self.of_link(owner)))
            }
            Some(other) => panic!("{other:?} is no vector"),
            None => self.vector(owner, value.name()),
        }
    }

    fn crank(&self, track: usize, value: model::CrankValue) -> V {
        let crank = self.model.tracks[track].crank.as_ref().unwrap();
        match crank.formula(value) {
            Some(Formula::Vector(parts)) => {
                let nowhere = Scope {
                    command: None,
                    length_of: None,
                    ..self.of_link(Owner::Robot)
                };
                [0, 1, 2].map(|k| self.formula(&parts[k], nowhere))
            }
            Some(other) => panic!("{other:?} is no vector"),
            None => self.vector(Owner::Crank(track), value.name()),
        }
    }

    fn joint(&self, owner: Owner, track: usize) -> Joint {
        let shared = self.variant.arm == Arm::Full && !self.variant.tracks[track].per_link;
        let path = if shared { Owner::Track(track) } else { owner };
        let offset = self.value(owner, model::Value::TrackOffset);
        let q = self.datum(Input::Command(track));
        let (travel, direction) = match self.variant.tracks[track].shape {
            TrackShape::Linear => {
                let direction = match self.derived(owner, model::Value::TrackDirection) {
                    Some(_) => self.value(owner, model::Value::TrackDirection),
                    None => self.vector(path, "track_direction"),
                };
                (direction.map(|v| v * q), direction)
            }
            TrackShape::Piecewise => {
                let start =
                    [0, 1, 2].map(|component| self.datum(Input::SegmentStart { track, component }));
                let end =
                    [0, 1, 2].map(|component| self.datum(Input::SegmentEnd { track, component }));
                let (q0, q1) = (
                    self.datum(Input::SegmentStartCommand(track)),
                    self.datum(Input::SegmentEndCommand(track)),
                );
                let weight = (q - q0) / (q1 - q0);
                let point =
                    [0, 1, 2].map(|i| start[i] * (Dual64::from(1.0) - weight) + end[i] * weight);
                let slope = [0, 1, 2].map(|i| (end[i] - start[i]) / (q1 - q0));
                let [a, b, c] = self.vector(path, "track_rotation");
                let rotation = product(&product(&about_z(c), &about_y(b)), &about_x(a));
                (apply(&rotation, point), apply(&rotation, slope))
            }
            // By the exponential of the axis' cross product matrix: I + sin S + (1 − cos) S².
            TrackShape::Crank => {
                let axis = self.crank(track, model::CrankValue::Axis);
                let angle = dot(axis, axis).sqrt() * q;
                let unit = unit(axis);
                let arm = minus(offset, self.crank(track, model::CrankValue::Centre));
                let once = cross(unit, arm);
                let twice = cross(unit, once);
                let (sine, cosine) = (angle.sin(), angle.cos());
                let travel =
                    [0, 1, 2].map(|k| once[k] * sine + twice[k] * (Dual64::from(1.0) - cosine));
                let direction = [0, 1, 2].map(|k| once[k] * cosine + twice[k] * sine);
                (travel, direction)
            }
        };
        Joint {
            offset,
            travel,
            direction,
        }
    }

    /// Shift along, horizontal, vertical and roll, pitch, yaw of a cart.
    fn displacement(&self, track: usize, set_one: bool) -> [Dual64; 6] {
        let mut total = [Dual64::from(0.0); 6];
        for (effect, used) in self.described.effects.iter().enumerate() {
            let source = match used.place {
                Place::Cart {
                    track: place,
                    source,
                } if place == track => source,
                Place::AllCarts if self.model.tracks[track].crank.is_none() => None,
                _ => continue,
            };
            let scope = Scope {
                effect,
                command: Some(track),
                track: Some(track),
                source,
                link: None,
                length_of: None,
                at_zero: false,
                set_one,
            };
            for term in &self.model.effects[used.effect].terms {
                let slot = match term.target {
                    Target::Along => 0,
                    Target::Horizontal => 1,
                    Target::Vertical => 2,
                    Target::Roll => 3,
                    Target::Pitch => 4,
                    Target::Yaw => 5,
                    other => panic!("{other:?} on a cart"),
                };
                total[slot] += self.formula(&term.formula, scope);
            }
        }
        total
    }

    fn closure(&self, of: usize) -> Dual64 {
        let (owner, cluster) = match self.variant.arm {
            Arm::Full => (Owner::Link(of), self.model.links[of].cluster),
            Arm::Reduced => (Owner::Cluster(of), of),
        };
        let full = self.variant.arm == Arm::Full;
        let track = self.model.clusters[cluster].track;
        let actuated = if full {
            self.model.links[of].actuated_by
        } else {
            None
        };
        let mut length = self.length(owner);
        let mut tcp = [0, 1, 2].map(|i| self.datum(Input::Position(i)));
        let plate = self.model.plate;
        let mut joint = if full && !plate.is_point() {
            self.value(owner, model::Value::PlateJoint)
        } else {
            [Dual64::from(0.0); 3]
        };
        for (effect, used) in self.described.effects.iter().enumerate() {
            let applies = match used.place {
                Place::Link(link) if full => link == of,
                Place::Link(link) => self.model.links[link].cluster == of,
                Place::AllLinks => {
                    let subject = self.model.effects[used.effect].subject;
                    let links = self.model.links.iter().enumerate();
                    let mut own = links.filter(
                        |(link, own)| {
                            if full { *link == of } else { own.cluster == of }
                        },
                    );
                    own.any(|(_, own)| subject.admits(own))
                }
                Place::Tcp => true,
                _ => false,
            };
            if !applies {
                continue;
            }
            let scope = Scope {
                effect,
                command: track.or(actuated),
                track,
                source: None,
                link: if full {
                    Some(of)
                } else {
                    self.model.links_of_cluster(of).first().copied()
                },
                length_of: Some(owner),
                at_zero: false,
                set_one: true,
            };
            for term in &self.model.effects[used.effect].terms {
                match (&term.target, &term.formula) {
                    (Target::Length, formula) => length += self.formula(formula, scope),
                    (Target::Joint, Formula::Vector(parts)) => {
                        for (sum, part) in joint.iter_mut().zip(parts.iter()) {
                            *sum += self.formula(part, scope);
                        }
                    }
                    (Target::Position, Formula::Vector(parts)) => {
                        for (sum, part) in tcp.iter_mut().zip(parts.iter()) {
                            *sum -= self.formula(part, scope);
                        }
                    }
                    other => panic!("{other:?}"),
                }
            }
        }
        if let Some(command) = actuated
            && self.derived(owner, model::Value::Length).is_none()
        {
            length += self.datum(Input::Command(command));
        }
        let base = match track {
            None => self.value(owner, model::Value::TrackOffset),
            Some(track) => {
                let path = self.joint(owner, track);
                let mut base = plus(path.offset, path.travel);
                let moved = self.displacement(track, true);
                if self.displaced(track) {
                    let frame = frame(path.direction);
                    let offsets: Vec<V> = self
                        .joints(track)
                        .into_iter()
                        .map(|joint| self.value(joint, model::Value::TrackOffset))
                        .collect();
                    let arm = minus(path.offset, mean(&offsets));
                    base = plus(
                        base,
                        apply(&columns(&frame), [moved[0], moved[1], moved[2]]),
                    );
                    let turn = apply(&columns(&frame), [moved[3], moved[4], moved[5]]);
                    base = plus(base, cross(turn, arm));
                }
                base
            }
        };
        let mut point = tcp;
        if plate.is_in_plane() {
            point[2] = Dual64::from(0.0);
        }
        if full && !plate.is_point() {
            let [alpha, mut beta, gamma] = [0, 1, 2].map(|i| self.datum(Input::Angle(i)));
            let mut turn = [0, 1, 2].map(|i| self.seed(0.0, By::Rotation(i)));
            if plate.is_in_plane() {
                beta = Dual64::from(0.0);
                turn = [beta, beta, turn[2]];
            }
            let rotation = product(&product(&about_z(alpha), &about_y(beta)), &about_z(gamma));
            let arm = apply(&rotation, joint);
            point = plus(point, plus(arm, cross(turn, arm)));
        }
        let rod = minus(point, base);
        length * length - dot(rod, rod)
    }

    fn tracker_error(&self, axis: usize) -> Dual64 {
        let mut total = Dual64::from(0.0);
        for (effect, used) in self.described.effects.iter().enumerate() {
            let scope = Scope {
                effect,
                command: None,
                link: None,
                length_of: None,
                ..self.of_link(Owner::Robot)
            };
            if used.place != Place::Tcp {
                continue;
            }
            for term in &self.model.effects[used.effect].terms {
                match &term.formula {
                    Formula::Vector(parts) => total += self.formula(&parts[axis], scope),
                    other => panic!("{other:?} is no vector"),
                }
            }
        }
        total
    }

    fn displaced(&self, track: usize) -> bool {
        self.described.effects.iter().any(|used| match used.place {
            Place::Cart { track: place, .. } => place == track,
            Place::AllCarts => self.model.tracks[track].crank.is_none(),
            _ => false,
        })
    }

    fn target(&self, track: usize, set: u8) -> Vec<Dual64> {
        let joints: Vec<Joint> = self
            .joints(track)
            .into_iter()
            .map(|owner| self.joint(owner, track))
            .collect();
        let offsets: Vec<V> = joints.iter().map(|joint| joint.offset).collect();
        let travels: Vec<V> = joints.iter().map(|joint| joint.travel).collect();
        let mut point = plus(mean(&offsets), mean(&travels));
        let shared = self.variant.arm == Arm::Full && !self.variant.tracks[track].per_link;
        let mut turn = if shared {
            [Dual64::from(0.0); 3]
        } else {
            implied(&offsets, &travels)
        };
        if self.displaced(track) {
            let directions: Vec<V> = joints.iter().map(|joint| joint.direction).collect();
            let frame = columns(&frame(mean(&directions)));
            let moved = self.displacement(track, false);
            point = plus(point, apply(&frame, [moved[0], moved[1], moved[2]]));
            turn = plus(turn, apply(&frame, [moved[3], moved[4], moved[5]]));
        }
        let owner = Owner::Target { set, track };
        let mounting = self.vector(owner, "position");
        let [a, b, c] = self.vector(Owner::Frame(set), "rotation");
        let seen_from = product(&product(&about_z(c), &about_y(b)), &about_x(a));
        let turned = rotated(turn);
        let position = plus(point, apply(&turned, mounting));
        let predicted = plus(
            apply(&seen_from, position),
            self.vector(Owner::Frame(set), "translation"),
        );
        let measured = [0, 1, 2].map(|i| Dual64::from(self.point.data[&Input::Position(i)]));
        let mut result = minus(predicted, measured).to_vec();
        if set == 2 {
            let [a, b, c] = self.vector(owner, "rotation");
            let mounted = product(&product(&about_z(c), &about_y(b)), &about_x(a));
            let [alpha, beta, gamma] = [0, 1, 2].map(|i| self.datum(Input::Angle(i)));
            let measured = product(&product(&about_z(alpha), &about_y(beta)), &about_z(gamma));
            let error = product(
                &product(&product(&seen_from, &turned), &mounted),
                &transpose(&measured),
            );
            for (i, j) in [(2, 1), (0, 2), (1, 0)] {
                result.push((error[i][j] - error[j][i]) * 0.5);
            }
        }
        result
    }

    fn formula(&self, formula: &Formula, scope: Scope) -> Dual64 {
        let of = |f: &Formula| self.formula(f, scope);
        match formula {
            Formula::Number(value) => Dual64::from(*value),
            Formula::Parameter(index, component) => {
                let used = &self.described.effects[scope.effect];
                let parameter = &self.model.effects[used.effect].parameters[*index];
                if parameter.optional && !used.with.contains(index) {
                    return Dual64::from(parameter.nominal);
                }
                let component = (parameter.components == 3).then_some(*component);
                self.parameter(Owner::Effect(scope.effect), &parameter.name, component)
            }
            Formula::OfRobot(index, component) => {
                let parameter = &self.model.parameters[*index];
                let component = (parameter.components == 3).then_some(*component);
                self.parameter(Owner::Robot, &parameter.name, component)
            }
            Formula::OfLink(value, component) => {
                let owner = scope.length_of.unwrap();
                if *value == model::Value::Length {
                    self.length(owner)
                } else {
                    self.value(owner, *value)[*component]
                }
            }
            Formula::Negate(a) => -of(a),
            Formula::Binary(operator, a, b) => match operator {
                BinaryOperator::Add => of(a) + of(b),
                BinaryOperator::Subtract => of(a) - of(b),
                BinaryOperator::Multiply => of(a) * of(b),
                BinaryOperator::Divide => of(a) / of(b),
            },
            Formula::Power(a, n) => of(a).powi(*n),
            Formula::Call(function, arguments) => {
                let a = of(&arguments[0]);
                match function {
                    Function::Sin => a.sin(),
                    Function::Cos => a.cos(),
                    Function::Tan => a.tan(),
                    Function::Atan => a.atan(),
                    Function::Exp => a.exp(),
                    Function::Ln => a.ln(),
                    Function::Tanh => a.tanh(),
                    Function::Sqrt => a.sqrt(),
                    Function::Abs => {
                        if a.re < 0.0 {
                            -a
                        } else {
                            a
                        }
                    }
                    Function::Sign => Dual64::from(if a.re < 0.0 { -1.0 } else { 1.0 }),
                    Function::Min => {
                        let b = of(&arguments[1]);
                        if b.re < a.re { b } else { a }
                    }
                    Function::Max => {
                        let b = of(&arguments[1]);
                        if a.re < b.re { b } else { a }
                    }
                }
            }
            Formula::Read(readable) => match *readable {
                Readable::Command if scope.at_zero => Dual64::from(0.0),
                Readable::Command => self.datum(Input::Command(scope.command.unwrap())),
                Readable::CommandOf(track) => self.datum(Input::Command(track)),
                Readable::SourceCommand => self.datum(Input::Command(scope.source.unwrap())),
                Readable::Direction => self.datum(Input::Direction(scope.command.unwrap())),
                Readable::Time => self.datum(Input::Time),
                Readable::Temperature => self.datum(Input::Temperature),
                Readable::LoadAlong => self.load(scope.track.unwrap(), 0),
                Readable::LoadHorizontal => self.load(scope.track.unwrap(), 1),
                Readable::LoadVertical => self.load(scope.track.unwrap(), 2),
                Readable::Tension => self.tension(scope.link.unwrap()),
                Readable::Length => self.length(scope.length_of.unwrap()),
                Readable::PaidOut => {
                    let owner = scope.length_of.unwrap();
                    let at_zero = Scope {
                        at_zero: true,
                        ..self.of_link(owner)
                    };
                    let formula = self.derived(owner, model::Value::Length).unwrap();
                    self.length(owner) - self.formula(formula, at_zero)
                }
                Readable::Position(i) if scope.set_one => self.datum(Input::Position(i)),
                Readable::Position(i) => self.datum(Input::TcpPosition(i)),
            },
            Formula::Vector(_) => panic!("a vector inside a scalar"),
        }
    }
}

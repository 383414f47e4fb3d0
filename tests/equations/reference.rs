//! The residuals once more, written directly from the equations with dual numbers.
//!
//! Shares no code with the generator beyond the description's model: matrices instead of turns, a
//! formula walker of its own, forward derivatives instead of reverse ones.

mod formulas;
mod matrices;

use std::collections::BTreeMap;

use num_dual::{Dual64, DualNum};
use tau::robot::{Arm, Input, Instance, Owner, ResidualKind, TrackShape, Variant};
use tau_model_dsl::model::{self, CrankValue, Formula, Model, Place, Target, Value};

use formulas::Scope;
use matrices::{M, V, frame, implied, mean, norm, rotated, unit, zyx, zyz};

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
    let described = model.variant(&variant.name).expect("one of the model");
    let reference = Reference {
        model,
        variant,
        described,
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

impl Reference<'_> {
    fn seed(&self, value: f64, by: By) -> Dual64 {
        Dual64::new(value, if self.by == by { 1.0 } else { 0.0 })
    }

    fn parameter(&self, owner: Owner, quantity: &str, component: Option<usize>) -> Dual64 {
        let found = self.variant.parameter(owner, quantity, component);
        let index = found.unwrap_or_else(|| panic!("no {owner:?} {quantity} {component:?}"));
        self.seed(self.point.parameters[index], By::Parameter(index))
    }

    fn vector(&self, owner: Owner, quantity: &str) -> V {
        V::from_fn(|c, _| self.parameter(owner, quantity, Some(c)))
    }

    fn datum(&self, input: Input) -> Dual64 {
        let value = self.point.data[&input];
        match input {
            Input::Command(command) => self.seed(value, By::Command(command)),
            Input::Position(component) => self.seed(value, By::Translation(component)),
            _ => Dual64::from(value),
        }
    }

    fn data(&self, input: impl Fn(usize) -> Input) -> V {
        V::from_fn(|k, _| self.datum(input(k)))
    }

    fn is_full(&self) -> bool {
        self.variant.arm == Arm::Full
    }

    fn is_shared(&self, track: usize) -> bool {
        self.is_full() && !self.variant.tracks[track].per_link
    }

    fn joints(&self, track: usize) -> Vec<Owner> {
        let owners = |indices: Vec<usize>, owner: fn(usize) -> Owner| {
            indices.into_iter().map(owner).collect()
        };
        if self.is_full() {
            owners(self.model.links_of_track(track), Owner::Link)
        } else {
            owners(self.model.clusters_of_track(track), Owner::Cluster)
        }
    }

    /// The formula of a link's value, if it is one.
    fn derived(&self, owner: Owner, value: Value) -> Option<&Formula> {
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
            command: link.and_then(|link| self.model.links[link].actuated_by),
            link,
            length_of: Some(owner),
            set_one: true,
            ..Scope::default()
        }
    }

    fn length(&self, owner: Owner) -> Dual64 {
        self.length_by(owner, false)
    }

    fn length_by(&self, owner: Owner, driven: bool) -> Dual64 {
        let scope = Scope {
            driven,
            ..self.of_link(owner)
        };
        match self.derived(owner, Value::Length) {
            Some(formula) => self.formula(formula, scope),
            None => self.parameter(owner, "length", None),
        }
    }

    /// A command with all that effects add to it.
    fn driven(&self, command: usize) -> Dual64 {
        let mut driven = self.datum(Input::Command(command));
        let links = || self.model.links.iter().enumerate();
        let own = links().find(|(_, link)| link.actuated_by == Some(command));
        let is_crank = (self.model.tracks.get(command)).is_some_and(|own| own.crank.is_some());
        for (effect, used) in self.described.effects.iter().enumerate() {
            let found = &self.model.effects[used.effect];
            let acts = match used.place {
                Place::Crank(track) => track == command,
                Place::AllCranks => is_crank,
                Place::Link(link) => own.is_some_and(|(index, _)| index == link),
                Place::AllLinks => own.is_some_and(|(_, link)| found.subject.admits(link)),
                _ => false,
            };
            let link = own.map(|(index, _)| index);
            let scope = Scope {
                effect,
                command: Some(command),
                link,
                length_of: link.map(Owner::Link),
                set_one: true,
                ..Scope::default()
            };
            let terms = found.terms.iter();
            for term in terms.filter(|term| acts && term.target == Target::Command) {
                driven += self.formula(&term.formula, scope);
            }
        }
        driven
    }

    /// Displacement of a joint on the base or on a crank.
    fn shift(&self, owner: Owner, of: usize, track: Option<usize>) -> V {
        let crank = track.filter(|&track| self.model.tracks[track].crank.is_some());
        let mut shift = V::zeros();
        for (effect, used) in self.described.effects.iter().enumerate() {
            let acts = match used.place {
                Place::BaseJoint(link) if self.is_full() => link == of,
                Place::BaseJoint(link) => self.model.links[link].cluster == of,
                Place::CrankCentre(own) => crank == Some(own),
                Place::AllBaseJoints => track.is_none() || crank.is_some(),
                _ => false,
            };
            let scope = Scope {
                effect,
                command: crank.or(self.of_link(owner).command),
                base_of: Some(crank.map_or(owner, Owner::Crank)),
                set_one: true,
                ..Scope::default()
            };
            let terms = self.model.effects[used.effect].terms.iter();
            for term in terms.filter(|_| acts) {
                shift += self.formulas(&term.formula, scope);
            }
        }
        shift
    }

    fn value(&self, owner: Owner, value: Value) -> V {
        match self.derived(owner, value) {
            Some(formula) => self.formulas(formula, self.of_link(owner)),
            None => self.vector(owner, value.name()),
        }
    }

    fn crank(&self, track: usize, value: CrankValue) -> V {
        let crank = self.model.tracks[track].crank.as_ref().expect("a crank");
        match crank.formula(value) {
            Some(formula) => self.formulas(formula, Scope::default()),
            None => self.vector(Owner::Crank(track), value.name()),
        }
    }

    /// Offset, travel and direction of a joint that a cart carries.
    fn joint(&self, owner: Owner, track: usize) -> [V; 3] {
        let path = if self.is_shared(track) {
            Owner::Track(track)
        } else {
            owner
        };
        let offset = self.value(owner, Value::TrackOffset);
        let q = self.driven(track);
        let (travel, direction) = match self.variant.tracks[track].shape {
            TrackShape::Linear => {
                let direction = match self.derived(owner, Value::TrackDirection) {
                    Some(_) => self.value(owner, Value::TrackDirection),
                    None => self.vector(path, "track_direction"),
                };
                (direction * q, direction)
            }
            TrackShape::Piecewise => {
                let start = self.data(|component| Input::SegmentStart { track, component });
                let end = self.data(|component| Input::SegmentEnd { track, component });
                let q0 = self.datum(Input::SegmentStartCommand(track));
                let q1 = self.datum(Input::SegmentEndCommand(track));
                let slope = (end - start) / (q1 - q0);
                let rotation = zyx(self.vector(path, "track_rotation"));
                (rotation * (start + slope * (q - q0)), rotation * slope)
            }
            // By the exponential of the axis' cross product matrix: I + sin S + (1 − cos) S².
            TrackShape::Crank => {
                let axis = self.crank(track, CrankValue::Axis);
                let (sine, cosine) = (norm(axis) * q).sin_cos();
                let unit = unit(axis);
                let once = unit.cross(&(offset - self.crank(track, CrankValue::Centre)));
                let twice = unit.cross(&once);
                let travel = once * sine + twice * (Dual64::from(1.0) - cosine);
                (travel, once * cosine + twice * sine)
            }
        };
        [offset, travel, direction]
    }

    /// Shift along, horizontal, vertical and roll, pitch, yaw of a cart, if an effect acts on it.
    fn displacement(&self, track: usize, set_one: bool) -> Option<[V; 2]> {
        let mut total = None;
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
                set_one,
                ..Scope::default()
            };
            let [shift, turn] = total.get_or_insert([V::zeros(); 2]);
            for term in &self.model.effects[used.effect].terms {
                let slot = match term.target {
                    Target::Along => &mut shift[0],
                    Target::Horizontal => &mut shift[1],
                    Target::Vertical => &mut shift[2],
                    Target::Roll => &mut turn[0],
                    Target::Pitch => &mut turn[1],
                    Target::Yaw => &mut turn[2],
                    other => panic!("{other:?} on a cart"),
                };
                *slot += self.formula(&term.formula, scope);
            }
        }
        total
    }

    /// True if an effect acts on the link or the cluster of a closure.
    fn acts_on(&self, used: &model::EffectUse, of: usize) -> bool {
        let own = |link: usize| match self.variant.arm {
            Arm::Full => link == of,
            Arm::Reduced => self.model.links[link].cluster == of,
        };
        let subject = self.model.effects[used.effect].subject;
        let mut links = self.model.links.iter().enumerate();
        match used.place {
            Place::Link(link) => own(link),
            Place::AllLinks => links.any(|(link, found)| own(link) && subject.admits(found)),
            Place::Tcp => true,
            _ => false,
        }
    }

    fn closure(&self, of: usize) -> Dual64 {
        let (owner, cluster) = if self.is_full() {
            (Owner::Link(of), self.model.links[of].cluster)
        } else {
            (Owner::Cluster(of), of)
        };
        let track = self.model.clusters[cluster].track;
        let actuated = self.of_link(owner).command;
        let plate = self.model.plate;
        let has_joint = self.is_full() && !plate.is_point();
        let mut length = self.length_by(owner, true);
        let mut tcp = self.data(Input::Position);
        let mut joint = if has_joint {
            self.value(owner, Value::PlateJoint)
        } else {
            V::zeros()
        };
        for (effect, used) in self.described.effects.iter().enumerate() {
            if !self.acts_on(used, of) {
                continue;
            }
            let first = || self.model.links_of_cluster(of).first().copied();
            let scope = Scope {
                effect,
                command: track.or(actuated),
                track,
                link: if self.is_full() { Some(of) } else { first() },
                ..self.of_link(owner)
            };
            for term in &self.model.effects[used.effect].terms {
                match term.target {
                    Target::Length => length += self.formula(&term.formula, scope),
                    Target::Joint => joint += self.formulas(&term.formula, scope),
                    Target::Position => tcp -= self.formulas(&term.formula, scope),
                    Target::Command => {}
                    other => panic!("{other:?}"),
                }
            }
        }
        if let Some(command) = actuated
            && self.derived(owner, Value::Length).is_none()
        {
            length += self.driven(command);
        }
        let base = match track {
            None => self.value(owner, Value::TrackOffset),
            Some(track) => {
                let [own, travel, direction] = self.joint(owner, track);
                let moved = self.displacement(track, true).map(|[shift, turn]| {
                    let offset = |joint: Owner| self.value(joint, Value::TrackOffset);
                    let offsets: Vec<V> = self.joints(track).into_iter().map(offset).collect();
                    let frame = frame(direction);
                    frame * shift + (frame * turn).cross(&(own - mean(&offsets)))
                });
                own + travel + moved.unwrap_or_else(V::zeros)
            }
        };
        let base = base + self.shift(owner, of, track);
        if plate.is_in_plane() {
            tcp[2] = Dual64::from(0.0);
        }
        if has_joint {
            let mut angles = self.data(Input::Angle);
            let mut turn = V::from_fn(|i, _| self.seed(0.0, By::Rotation(i)));
            if plate.is_in_plane() {
                angles[1] = Dual64::from(0.0);
                turn = V::new(angles[1], angles[1], turn[2]);
            }
            let arm = zyz(angles) * joint;
            tcp += arm + turn.cross(&arm);
        }
        let rod = tcp - base;
        length * length - rod.dot(&rod)
    }

    fn tracker_error(&self, axis: usize) -> Dual64 {
        let used = self.described.effects.iter().enumerate();
        let mut total = Dual64::from(0.0);
        for (effect, used) in used.filter(|(_, used)| used.place == Place::Tcp) {
            let scope = Scope {
                effect,
                set_one: true,
                ..Scope::default()
            };
            for term in &self.model.effects[used.effect].terms {
                total += self.formulas(&term.formula, scope)[axis];
            }
        }
        total
    }

    fn target(&self, track: usize, set: u8) -> Vec<Dual64> {
        let owners = self.joints(track).into_iter();
        let joints: Vec<[V; 3]> = owners.map(|owner| self.joint(owner, track)).collect();
        let parts = [0, 1, 2].map(|part| joints.iter().map(|joint| joint[part]).collect());
        let [offsets, travels, directions]: [Vec<V>; 3] = parts;
        let mut point = mean(&offsets) + mean(&travels);
        let mut turn = if self.is_shared(track) {
            V::zeros()
        } else {
            implied(&offsets, &travels)
        };
        if let Some([shift, turned]) = self.displacement(track, false) {
            let frame = frame(mean(&directions));
            point += frame * shift;
            turn += frame * turned;
        }
        let owner = Owner::Target { set, track };
        let seen_from = zyx(self.vector(Owner::Frame(set), "rotation"));
        let turned: M = rotated(turn);
        let position = point + turned * self.vector(owner, "position");
        let predicted = seen_from * position + self.vector(Owner::Frame(set), "translation");
        let difference = predicted - self.data(Input::Position);
        let mut result: Vec<Dual64> = difference.iter().copied().collect();
        if set == 2 {
            let mounted = zyx(self.vector(owner, "rotation"));
            let measured = zyz(self.data(Input::Angle));
            let error = seen_from * turned * mounted * measured.transpose();
            for place in [(2, 1), (0, 2), (1, 0)] {
                result.push((error[place] - error[(place.1, place.0)]) * 0.5);
            }
        }
        result
    }
}

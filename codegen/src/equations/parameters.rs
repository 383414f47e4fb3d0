//! The table of a variant's parameters.

use tau_model_dsl::model::{
    Arm, CrankValue, Held, LinkDefaults, Model, Place, Quantity, TrackShape, Variant,
};
use tau_runtime::Owner;

/// A scalar parameter of a variant: the owned form of [`tau_runtime::Parameter`].
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Full name, such as `l1.track_offset.x`.
    pub name: String,
    /// Its owner.
    pub owner: Owner,
    /// `length`, `plate_joint`, `track_offset`, `track_direction`, `track_rotation`, `pull`, `translation`,
    /// `rotation`, `position`, or the name of an effect's parameter.
    pub quantity: String,
    /// Component 0, 1 or 2 of a vector.
    pub component: Option<usize>,
    /// SI unit, such as `m`, `rad`, `1`, `m/N`.
    pub unit: String,
    /// Nominal value from the description, SI, where it gives one.
    pub nominal: Option<f64>,
    /// One standard deviation of the prior from the description, SI.
    pub tolerance: Option<f64>,
    /// Range over which discovery searches it, SI.
    pub search: Option<(f64, f64)>,
}

impl Parameter {
    /// True if a variant holds it at its value.
    pub fn is_held(&self, model: &Model, variant: &Variant) -> bool {
        variant.holds.iter().any(|&held| match held {
            Held::Parameter(index) => {
                self.owner == Owner::Robot && self.quantity == model.parameters[index].name
            }
            Held::Link(link, value) => {
                self.owner == Owner::Link(link) && self.quantity == value.name()
            }
            Held::Crank(track, value) => {
                self.owner == Owner::Crank(track) && self.quantity == value.name()
            }
        })
    }
}

/// The tension (N) to which a link is pulled, where that is known to a tolerance: a parameter of each variant that reads a
/// force.
pub const PULL: &str = "pull";

/// Links that are pulled to a tension which is known to a tolerance, by index.
pub(super) fn uncertain_pulls(model: &Model) -> impl Iterator<Item = usize> {
    let links = model.links.iter().enumerate();
    links.filter_map(|(link, own)| own.uncertain_pull().map(|_| link))
}

/// All parameters of a variant: links or clusters, shared track directions, cranks, pulls, the robot's own, effects, then
/// the frames and targets of sets 2 and 3.
pub fn parameters(model: &Model, variant: &Variant) -> Vec<Parameter> {
    let mut table = Table {
        model,
        variant,
        parameters: vec![],
    };
    match variant.arm {
        Arm::Full => {
            table.links();
            table.shared_paths();
        }
        Arm::Reduced => table.clusters(),
    }
    table.cranks();
    table.pulls();
    table.of_robot();
    table.effects();
    table.frames();
    table.parameters
}

/// True if a link's direction follows from a formula, so that neither it nor its track has a parameter of it.
pub(super) fn has_given_direction(model: &Model, variant: &Variant, link: usize) -> bool {
    let link = &model.links[link];
    let track = model.clusters[link.cluster].track;
    let is_linear = track.is_some_and(|track| variant.tracks[track].shape == TrackShape::Linear);
    is_linear && link.defaults.track_direction.formula.is_some()
}

fn is_rail(model: &Model, track: usize) -> bool {
    model.tracks[track].crank.is_none()
}

/// Names of an effect's places, as the description writes them.
pub fn places(model: &Model, place: Place) -> Vec<String> {
    match place {
        Place::Cart { track, source } => std::iter::once(track)
            .chain(source)
            .map(|track| model.tracks[track].name.clone())
            .collect(),
        Place::Link(link) | Place::BaseJoint(link) => vec![model.links[link].name.clone()],
        Place::Crank(track) | Place::CrankCentre(track) => vec![model.tracks[track].name.clone()],
        Place::AllCarts | Place::AllLinks | Place::AllCranks | Place::AllBaseJoints => {
            vec!["all".into()]
        }
        Place::Tcp => vec!["tcp".into()],
    }
}

/// A scalar or a vector, listed by its components.
struct Entry<'a> {
    /// Its owner's name; empty for the robot.
    of: &'a str,
    owner: Owner,
    quantity: &'a str,
    unit: &'a str,
    components: usize,
    nominal: Option<&'a [f64]>,
    tolerance: Option<f64>,
    search: Option<(f64, f64)>,
}

impl<'a> Entry<'a> {
    /// One that the description says nothing of.
    fn unknown(of: &'a str, owner: Owner, (quantity, unit): (&'a str, &'a str), n: usize) -> Self {
        Self {
            of,
            owner,
            quantity,
            unit,
            components: n,
            nominal: None,
            tolerance: None,
            search: None,
        }
    }

    fn known<const N: usize>(self, quantity: &'a Quantity<N>) -> Self {
        Self {
            nominal: quantity.value.as_ref().map(<[f64; N]>::as_slice),
            tolerance: quantity.tolerance,
            ..self
        }
    }
}

struct Table<'a> {
    model: &'a Model,
    variant: &'a Variant,
    parameters: Vec<Parameter>,
}

impl Table<'_> {
    fn push(&mut self, entry: &Entry<'_>) {
        let Entry { of, quantity, .. } = entry;
        for component in 0..entry.components {
            let component = (entry.components > 1).then_some(component);
            let point = if of.is_empty() { "" } else { "." };
            let axis = component.map_or("", |component| [".x", ".y", ".z"][component]);
            let at = component.unwrap_or(0);
            self.parameters.push(Parameter {
                name: format!("{of}{point}{quantity}{axis}"),
                owner: entry.owner,
                quantity: (*quantity).to_owned(),
                component,
                unit: entry.unit.to_owned(),
                nominal: entry.nominal.and_then(|values| values.get(at).copied()),
                tolerance: entry.tolerance,
                search: entry.search,
            });
        }
    }

    /// A path of a track, of which a link may know the direction.
    fn path(&mut self, of: &str, owner: Owner, shape: TrackShape, direction: Option<&Quantity<3>>) {
        match shape {
            TrackShape::Linear => {
                let entry = Entry::unknown(of, owner, ("track_direction", "1"), 3);
                self.push(&match direction {
                    Some(direction) => entry.known(direction),
                    None => entry,
                });
            }
            TrackShape::Piecewise => self.push(&Entry {
                nominal: Some(&[0.0; 3]),
                ..Entry::unknown(of, owner, ("track_rotation", "rad"), 3)
            }),
            TrackShape::Crank => {}
        }
    }

    fn links(&mut self) {
        let Self { model, variant, .. } = *self;
        for (index, link) in model.links.iter().enumerate() {
            let owner = Owner::Link(index);
            let entry = |quantity, n| Entry::unknown(&link.name, owner, (quantity, "m"), n);
            let LinkDefaults {
                length,
                plate_joint,
                track_offset,
                track_direction,
            } = &link.defaults;
            if length.formula.is_none() {
                self.push(&entry("length", 1).known(length));
            }
            if !model.plate.is_point() && plate_joint.formula.is_none() {
                self.push(&entry("plate_joint", 3).known(plate_joint));
            }
            if track_offset.formula.is_none() {
                self.push(&entry("track_offset", 3).known(track_offset));
            }
            if let Some(track) = model.clusters[link.cluster].track
                && variant.tracks[track].per_link
                && !has_given_direction(model, variant, index)
            {
                let shape = variant.tracks[track].shape;
                self.path(&link.name, owner, shape, Some(track_direction));
            }
        }
    }

    /// Paths of tracks that all their links share.
    fn shared_paths(&mut self) {
        let Self { model, variant, .. } = *self;
        for (index, track) in model.tracks.iter().enumerate() {
            let links = model.links_of_track(index);
            let mut links = links.iter();
            let all_given = links.all(|&link| has_given_direction(model, variant, link));
            if !variant.tracks[index].per_link && is_rail(model, index) && !all_given {
                let shape = variant.tracks[index].shape;
                self.path(&track.name, Owner::Track(index), shape, None);
            }
        }
    }

    fn clusters(&mut self) {
        let Self { model, variant, .. } = *self;
        for (index, cluster) in model.clusters.iter().enumerate() {
            let owner = Owner::Cluster(index);
            let entry = |quantity, n| Entry::unknown(&cluster.name, owner, (quantity, "m"), n);
            self.push(&entry("length", 1));
            self.push(&entry("track_offset", 3));
            if let Some(track) = cluster.track.filter(|&track| is_rail(model, track)) {
                self.path(&cluster.name, owner, variant.tracks[track].shape, None);
            }
        }
    }

    fn cranks(&mut self) {
        for (index, track) in self.model.tracks.iter().enumerate() {
            let Some(crank) = &track.crank else {
                continue;
            };
            for value in CrankValue::ALL {
                let quantity = crank.quantity(value);
                if quantity.formula.is_none() {
                    let named = (value.name(), value.unit());
                    let entry = Entry::unknown(&track.name, Owner::Crank(index), named, 3);
                    self.push(&entry.known(quantity));
                }
            }
        }
    }

    fn pulls(&mut self) {
        let Self { model, variant, .. } = *self;
        let mut used = variant.effects.iter();
        if !used.any(|used| model.effects[used.effect].reads_forces()) {
            return;
        }
        for pulled in uncertain_pulls(model) {
            let link = &model.links[pulled];
            let [value, tolerance] = link.uncertain_pull().unwrap_or_default();
            self.push(&Entry {
                nominal: Some(&[value]),
                tolerance: Some(tolerance),
                ..Entry::unknown(&link.name, Owner::Link(pulled), (PULL, "N"), 1)
            });
        }
    }

    fn of_robot(&mut self) {
        for parameter in self.model.parameters.iter().filter(|own| !own.exact) {
            let unit = parameter.dimension.si_unit();
            let named = (parameter.name.as_str(), unit.as_str());
            self.push(&Entry {
                nominal: parameter.nominal.as_deref(),
                tolerance: parameter.tolerance,
                ..Entry::unknown("", Owner::Robot, named, parameter.components)
            });
        }
    }

    fn effects(&mut self) {
        let Self { model, variant, .. } = *self;
        for (index, used) in variant.effects.iter().enumerate() {
            let effect = &model.effects[used.effect];
            let name = format!("{}({})", effect.name, places(model, used.place).join(", "));
            let parameters = effect.parameters.iter().enumerate();
            for (_, parameter) in parameters.filter(|(at, parameter)| used.takes(*at, parameter)) {
                let unit = parameter.dimension.si_unit();
                let named = (parameter.name.as_str(), unit.as_str());
                self.push(&Entry {
                    nominal: Some(&[parameter.nominal; 3]),
                    tolerance: parameter.tolerance.map(|tol| used.tolerance_factor * tol),
                    search: parameter.search,
                    ..Entry::unknown(&name, Owner::Effect(index), named, parameter.components)
                });
            }
        }
    }

    /// Frames and targets of sets 2 and 3, which are measurements of carts.
    fn frames(&mut self) {
        let model = self.model;
        let rails = || (0..model.tracks.len()).filter(|&track| is_rail(model, track));
        if rails().next().is_none() {
            return;
        }
        for set in [2, 3] {
            let frame = format!("set{set}");
            let owner = Owner::Frame(set);
            self.push(&Entry::unknown(&frame, owner, ("translation", "m"), 3));
            self.push(&Entry::unknown(&frame, owner, ("rotation", "rad"), 3));
            for track in rails() {
                let owner = Owner::Target { set, track };
                let target = format!("{frame}.target({})", model.tracks[track].name);
                self.push(&Entry::unknown(&target, owner, ("position", "m"), 3));
                if set == 2 {
                    self.push(&Entry::unknown(&target, owner, ("rotation", "rad"), 3));
                }
            }
        }
    }
}

//! The table of a variant's parameters.

use tau_model_dsl::model::{
    Arm, CrankValue, Held, LinkDefaults, Model, Place, TrackShape, Variant,
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

/// All parameters of a variant: links or clusters, shared track directions, effects, then the frames
/// and targets of sets 2 and 3.
pub fn parameters(model: &Model, variant: &Variant) -> Vec<Parameter> {
    let mut table = Table::default();
    match variant.arm {
        Arm::Full => {
            for (index, link) in model.links.iter().enumerate() {
                let owner = Owner::Link(index);
                let LinkDefaults {
                    length,
                    plate_joint,
                    track_offset,
                    track_direction,
                } = &link.defaults;
                if length.formula.is_none() {
                    table.scalar(
                        &link.name,
                        owner,
                        "length",
                        "m",
                        length.value.map(|v| v[0]),
                        length.tolerance,
                    );
                }
                if !model.plate.is_point() && plate_joint.formula.is_none() {
                    table.vector(
                        &link.name,
                        owner,
                        "plate_joint",
                        "m",
                        plate_joint.value,
                        plate_joint.tolerance,
                    );
                }
                if track_offset.formula.is_none() {
                    table.vector(
                        &link.name,
                        owner,
                        "track_offset",
                        "m",
                        track_offset.value,
                        track_offset.tolerance,
                    );
                }
                if let Some(track) = model.clusters[link.cluster].track
                    && variant.tracks[track].per_link
                    && !has_given_direction(model, variant, index)
                {
                    table.path(
                        &link.name,
                        owner,
                        variant.tracks[track].shape,
                        Some(track_direction),
                    );
                }
            }
            for (index, track) in model.tracks.iter().enumerate() {
                let links = model.links_of_track(index);
                let all_given = links
                    .iter()
                    .all(|&link| has_given_direction(model, variant, link));
                if !variant.tracks[index].per_link && track.crank.is_none() && !all_given {
                    table.path(
                        &track.name,
                        Owner::Track(index),
                        variant.tracks[index].shape,
                        None,
                    );
                }
            }
        }
        Arm::Reduced => {
            for (index, cluster) in model.clusters.iter().enumerate() {
                let owner = Owner::Cluster(index);
                table.scalar(&cluster.name, owner, "length", "m", None, None);
                table.vector(&cluster.name, owner, "track_offset", "m", None, None);
                if let Some(track) = cluster.track.filter(|&track| is_rail(model, track)) {
                    table.path(&cluster.name, owner, variant.tracks[track].shape, None);
                }
            }
        }
    }
    for (index, track) in model.tracks.iter().enumerate() {
        let Some(crank) = &track.crank else {
            continue;
        };
        for value in CrankValue::ALL {
            let quantity = crank.quantity(value);
            if quantity.formula.is_none() {
                table.vector(
                    &track.name,
                    Owner::Crank(index),
                    value.name(),
                    value.unit(),
                    quantity.value,
                    quantity.tolerance,
                );
            }
        }
    }
    let mut used = variant.effects.iter();
    if used.any(|used| model.effects[used.effect].reads_forces()) {
        for pulled in uncertain_pulls(model) {
            let link = &model.links[pulled];
            let [value, tolerance] = link.uncertain_pull().unwrap_or_default();
            table.scalar(
                &link.name,
                Owner::Link(pulled),
                PULL,
                "N",
                Some(value),
                Some(tolerance),
            );
        }
    }
    for parameter in model.parameters.iter().filter(|own| !own.exact) {
        for component in 0..parameter.components {
            let nominal = parameter.nominal.as_ref();
            table.push(
                Parameter {
                    name: String::new(),
                    owner: Owner::Robot,
                    quantity: parameter.name.clone(),
                    component: (parameter.components > 1).then_some(component),
                    unit: parameter.dimension.si_unit(),
                    nominal: nominal.and_then(|values| values.get(component).copied()),
                    tolerance: parameter.tolerance,
                    search: None,
                },
                "",
            );
        }
    }
    for (index, used) in variant.effects.iter().enumerate() {
        let effect = &model.effects[used.effect];
        let name = format!("{}({})", effect.name, places(model, used.place).join(", "));
        let taken = effect.parameters.iter().enumerate();
        for (_, parameter) in taken.filter(|(at, parameter)| used.takes(*at, parameter)) {
            for component in 0..parameter.components {
                table.push(
                    Parameter {
                        name: String::new(),
                        owner: Owner::Effect(index),
                        quantity: parameter.name.clone(),
                        component: (parameter.components > 1).then_some(component),
                        unit: parameter.dimension.si_unit(),
                        nominal: Some(parameter.nominal),
                        tolerance: parameter.tolerance,
                        search: parameter.search,
                    },
                    &name,
                );
            }
        }
    }
    for set in [2, 3] {
        let frame = format!("set{set}");
        table.vector(&frame, Owner::Frame(set), "translation", "m", None, None);
        table.vector(&frame, Owner::Frame(set), "rotation", "rad", None, None);
        let rails = model.tracks.iter().enumerate();
        for (index, track) in rails.filter(|(_, track)| track.crank.is_none()) {
            let owner = Owner::Target { set, track: index };
            let target = format!("{frame}.target({})", track.name);
            table.vector(&target, owner, "position", "m", None, None);
            if set == 2 {
                table.vector(&target, owner, "rotation", "rad", None, None);
            }
        }
    }
    table.infos
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
        Place::Link(link) => vec![model.links[link].name.clone()],
        Place::AllCarts | Place::AllLinks => vec!["all".into()],
        Place::Tcp => vec!["tcp".into()],
    }
}

#[derive(Default)]
struct Table {
    infos: Vec<Parameter>,
}

impl Table {
    fn push(&mut self, mut info: Parameter, of: &str) {
        info.name = if of.is_empty() {
            info.quantity.clone()
        } else {
            format!("{of}.{}", info.quantity)
        };
        if let Some(component) = info.component {
            info.name.push_str([".x", ".y", ".z"][component]);
        }
        self.infos.push(info);
    }

    fn scalar(
        &mut self,
        of: &str,
        owner: Owner,
        quantity: &str,
        unit: &str,
        nominal: Option<f64>,
        tolerance: Option<f64>,
    ) {
        self.push(
            Parameter {
                name: String::new(),
                owner,
                quantity: quantity.into(),
                component: None,
                unit: unit.into(),
                nominal,
                tolerance,
                search: None,
            },
            of,
        );
    }

    fn vector(
        &mut self,
        of: &str,
        owner: Owner,
        quantity: &str,
        unit: &str,
        nominal: Option<[f64; 3]>,
        tolerance: Option<f64>,
    ) {
        for component in 0..3 {
            self.push(
                Parameter {
                    name: String::new(),
                    owner,
                    quantity: quantity.into(),
                    component: Some(component),
                    unit: unit.into(),
                    nominal: nominal.map(|value| value[component]),
                    tolerance,
                    search: None,
                },
                of,
            );
        }
    }

    fn path(
        &mut self,
        of: &str,
        owner: Owner,
        shape: TrackShape,
        direction: Option<&tau_model_dsl::model::Quantity<3>>,
    ) {
        match shape {
            TrackShape::Linear => self.vector(
                of,
                owner,
                "track_direction",
                "1",
                direction.and_then(|d| d.value),
                direction.and_then(|d| d.tolerance),
            ),
            TrackShape::Piecewise => {
                self.vector(of, owner, "track_rotation", "rad", Some([0.0; 3]), None);
            }
            TrackShape::Crank => {}
        }
    }
}

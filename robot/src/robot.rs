//! A robot and its variants at run time, whether compiled in or read from a `.tau` file.
//!
//! The tables are owned, unlike those of `tau_runtime`, which are statics of generated code: interpreted robots could
//! not lend statics without leaking them.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use tau_codegen::CompiledRobot;
use tau_codegen::compile::{CompiledVariant, effects};
pub use tau_codegen::equations::Parameter;
use tau_codegen::language;
use tau_codegen::language::model::{self, EffectUse, Model, Place};
pub use tau_codegen::language::model::{
    Arm, Cluster, CrankValue, Drive, Formula, Link, Plate, Readable, TrackModel, TrackShape, Value,
};
use tau_codes::files;
use tau_runtime as runtime;
pub use tau_runtime::{Input, Owner, ResidualFamily, ResidualKind};

use crate::input_error::{self, InputError};
pub use crate::link_key::LinkKey;

/// A robot: its structure and its variants.
#[derive(Clone, Default)]
pub struct Robot {
    /// Name in the description.
    pub name: String,
    /// Name of the description's file, or of the robot where there is none: errors name it.
    pub source: String,
    /// The whole description, in the language.
    pub description: String,
    /// Freedoms of the plate that the links hold.
    pub plate: Plate,
    /// Drive of each command; none for a robot made by hand.
    pub drives: Vec<Drive>,
    /// The description's model; empty for a robot made by hand.
    pub model: Arc<Model>,
    /// Names of the tracks and cranks; carts carry the same numbers, from 1.
    pub tracks: Vec<String>,
    /// Clusters in order of declaration.
    pub clusters: Vec<Cluster>,
    /// Links in order of declaration.
    pub links: Vec<Link>,
    /// Number of commands.
    pub commands: usize,
    /// Variants in order of declaration.
    pub variants: Arc<[Variant]>,
}

/// A choice of arm, tracks and effects, with its functions.
#[derive(Clone)]
pub struct Variant {
    /// Name in the description.
    pub name: String,
    /// Closure per link or per cluster.
    pub arm: Arm,
    /// One model per track.
    pub tracks: Vec<TrackModel>,
    /// Effects with their places, such as `("rack_pitch", ["two"])`.
    pub effects: Vec<(String, Vec<String>)>,
    /// All parameters.
    pub parameters: Vec<Parameter>,
    /// All residuals; see [`Variant::instances_of`].
    pub instances: Vec<Instance>,
}

/// The name alone: the description is pages long.
impl fmt::Debug for Robot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Robot");
        shown.field("name", &self.name).finish_non_exhaustive()
    }
}

/// The name alone, as of a [`Robot`].
impl fmt::Debug for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Variant");
        shown.field("name", &self.name).finish_non_exhaustive()
    }
}

/// A residual family applied to a link, a cluster or a cart.
#[derive(Debug, Clone)]
pub struct Instance {
    /// Kind of its residual.
    pub kind: ResidualKind,
    /// Index of the link (full arm), the cluster (reduced arm) or the track (sets 2 and 3).
    pub of: usize,
    /// The function.
    pub family: Arc<dyn ResidualFamily>,
    /// For each parameter of the family, its index in [`Variant::parameters`].
    pub parameters: Vec<usize>,
    /// For each datum of the family, what to fill in.
    pub inputs: Vec<Input>,
}

impl Instance {
    /// The same function in another variant, where parameters, also those that the variant holds, have other indices.
    #[must_use]
    pub fn renumbered(&self, index: impl Fn(usize) -> usize) -> Self {
        let mut own = self.clone();
        for parameter in &mut own.parameters {
            *parameter = index(*parameter);
        }
        for input in &mut own.inputs {
            if let Input::Held(parameter) = input {
                *parameter = index(*parameter);
            }
        }
        own
    }
}

/// The drives and the plate of a robot, by which its parts are called.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Architecture {
    /// Number of carts on tracks.
    pub carts: usize,
    /// Number of cranks.
    pub cranks: usize,
    /// Number of links of driven length.
    pub driven_lengths: usize,
    /// Freedoms of the plate.
    pub plate: Plate,
}

impl Robot {
    /// The drives and the plate.
    pub fn architecture(&self) -> Architecture {
        let driven = self.links.iter().filter(|link| link.actuated_by.is_some());
        let driven_lengths = driven.count();
        let cranks = (0..self.tracks.len())
            .filter(|&track| self.is_crank(track))
            .count();
        Architecture {
            carts: self.tracks.len() - cranks,
            cranks,
            driven_lengths,
            plate: self.plate,
        }
    }

    /// True if a crank stands where a track would.
    pub fn is_crank(&self, track: usize) -> bool {
        let track = self.model.tracks.get(track);
        track.is_some_and(|track| track.crank.is_some())
    }

    /// True if there are more links than freedoms of the plate, so that they fit at matching commands only.
    pub fn is_redundant(&self) -> bool {
        self.links.len() > self.plate.freedoms().len()
    }

    /// True if a command is an angle (rad), false for a length (m).
    pub fn is_angle(&self, command: usize) -> bool {
        (self.drives.get(command)).is_some_and(|drive| drive.is_angle)
    }

    /// Name of a command's column in tables, `q1_m` or `q1_rad`.
    pub fn command_column(&self, command: usize) -> String {
        command_column(command, self.is_angle(command))
    }

    /// Names of the columns of all commands.
    pub fn command_columns(&self) -> Vec<String> {
        (0..self.commands)
            .map(|command| self.command_column(command))
            .collect()
    }

    /// The formula that a value of a link is, where the description gives one: it then has no parameter of its own.
    pub fn formula_of(&self, link: usize, value: Value) -> Option<&Formula> {
        self.links.get(link)?.defaults.formula(value)
    }

    /// True if a value of a link is a parameter that a file or the description gives.
    pub fn has_parameter(&self, link: usize, key: LinkKey) -> bool {
        let track = (self.links.get(link)).and_then(|link| self.clusters.get(link.cluster)?.track);
        let on_crank = track.is_some_and(|track| self.is_crank(track));
        let exists = match key {
            LinkKey::Geometry(Value::PlateJoint) => !self.plate.is_point(),
            LinkKey::Geometry(Value::TrackDirection) => track.is_some() && !on_crank,
            LinkKey::Pull => {
                let link = self.links.get(link);
                link.is_some_and(|link| link.uncertain_pull().is_some())
            }
            LinkKey::Geometry(_) | LinkKey::TrackRotation => true,
        };
        let formula = match key {
            LinkKey::Geometry(value) => self.formula_of(link, value),
            LinkKey::TrackRotation | LinkKey::Pull => None,
        };
        exists && formula.is_none()
    }

    /// A robot as described, with variants.
    fn of(model: Model, description: &str, variants: Vec<Variant>) -> Self {
        Self {
            name: model.name.clone(),
            source: model.name.clone(),
            description: description.to_owned(),
            plate: model.plate,
            drives: model.drives(),
            tracks: model.tracks.iter().map(|own| own.name.clone()).collect(),
            clusters: model.clusters.clone(),
            links: model.links.clone(),
            commands: model.commands(),
            variants: variants.into(),
            model: Arc::new(model),
        }
    }

    /// A robot from its description, compiled at run time: its functions are interpreted.
    ///
    /// They give the same numbers, bit for bit, as the code that `tau_model!` or `tau generate` makes of
    /// the same text.
    ///
    /// # Errors
    /// All mistakes of the description.
    pub fn from_text(description: &str) -> Result<Self, InputError> {
        Self::parse(description, "description")
    }

    /// The same of a text that came from a file of a name.
    ///
    /// # Errors
    /// All mistakes of the description, in the file of that name.
    pub fn parse(description: &str, name: &str) -> Result<Self, InputError> {
        let model = language::check_text(description)
            .map_err(|errors| InputError::of_description(name, description, &errors))?;
        Ok(Self {
            source: name.to_owned(),
            ..Self::from(&tau_codegen::compile(&model, description))
        })
    }

    /// The robot of a `.tau` file.
    ///
    /// # Errors
    /// As [`Self::parse`]; the file is missing or can't be read.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = input_error::read(path, "the description of the robot (.tau)")?;
        Self::parse(&text, &path.display().to_string())
    }

    /// The variant of a name.
    pub fn variant(&self, name: &str) -> Option<&Variant> {
        self.variants.iter().find(|variant| variant.name == name)
    }

    /// The ordinary variant: `Full`, or else the last with all links and without effects. A discovery starts from it unless
    /// told otherwise, and a simulated machine is one that it can describe.
    pub fn base(&self) -> Option<&Variant> {
        self.variant("Full").or_else(|| {
            let is_plain =
                |variant: &&Variant| variant.arm == Arm::Full && variant.effects.is_empty();
            self.variants.iter().rfind(is_plain)
        })
    }

    /// The variant of a name that was given in `source`, a file or an option.
    ///
    /// # Errors
    /// There is none; the help names the one probably meant.
    pub fn find(&self, name: &str, source: &str) -> Result<&Variant, InputError> {
        let known = self.variants.iter().map(|variant| variant.name.as_str());
        let variant = self.variant(name);
        variant.ok_or_else(|| {
            InputError::unknown_name(files::NO_SUCH_VARIANT, source, "variant", name, known)
        })
    }

    /// A variant without the effects of the tracker: those on `tcp`, which are errors of the measurement and none of the
    /// machine. With their names and places, such as `tracker_drift(tcp)`.
    ///
    /// # Errors
    /// The variant is none of the robot's.
    pub fn of_machine_alone(
        &self,
        variant: &Variant,
    ) -> Result<(Variant, Vec<String>), InputError> {
        let left_out = variant.tracker_effects();
        if left_out.is_empty() {
            return Ok((variant.clone(), left_out));
        }
        let own = self.with_effects(variant, |_, effect| effect.place != Place::Tcp)?;
        Ok((own, left_out))
    }

    /// A variant without the effect of an index.
    ///
    /// # Errors
    /// As [`Self::of_machine_alone`].
    pub fn without_effect(&self, variant: &Variant, index: usize) -> Result<Variant, InputError> {
        self.with_effects(variant, |own, _| own != index)
    }

    /// The terms of an effect that acts on places, as they are written.
    pub fn terms_of(&self, effect: &str, places: &[String]) -> Vec<String> {
        let found = self.model.effect_at(effect, places);
        let found = found.and_then(|index| self.model.effects.get(index));
        (found.into_iter())
            .flat_map(|own| &own.terms)
            .map(|term| term.text.clone())
            .collect()
    }

    /// A variant with those of its effects, given with their indices, that are to be kept.
    fn with_effects(
        &self,
        variant: &Variant,
        keep: impl Fn(usize, &EffectUse) -> bool,
    ) -> Result<Variant, InputError> {
        let mut model = Model::clone(&self.model);
        model.variants.retain(|own| own.name == variant.name);
        for own in &mut model.variants {
            let mut indices = 0..;
            own.effects
                .retain(|effect| keep(indices.next().unwrap_or_default(), effect));
        }
        let compiled = Self::from(&tau_codegen::compile(&model, &self.description));
        Ok(compiled.find(&variant.name, &self.name)?.clone())
    }

    /// Indices of the links of a cluster.
    pub fn links_of_cluster(&self, cluster: usize) -> Vec<usize> {
        (0..self.links.len())
            .filter(|&link| self.links[link].cluster == cluster)
            .collect()
    }

    /// Indices of the links whose cluster rides on a track's cart.
    pub fn links_of_track(&self, track: usize) -> Vec<usize> {
        (0..self.links.len())
            .filter(|&link| self.clusters[self.links[link].cluster].track == Some(track))
            .collect()
    }
}

impl Variant {
    /// The instances of one kind, in order of link, cluster or track.
    pub fn instances_of(&self, kind: ResidualKind) -> impl Iterator<Item = &Instance> {
        self.instances
            .iter()
            .filter(move |instance| instance.kind == kind)
    }

    /// Commands whose drives' travel its residuals depend on, ascending.
    pub fn reads_travel(&self) -> Vec<usize> {
        let inputs = self.instances.iter().flat_map(|own| &own.inputs);
        let commands = inputs.filter_map(|input| match input {
            Input::TravelMiddle(command) => Some(*command),
            _ => None,
        });
        let mut commands: Vec<usize> = commands.collect();
        commands.sort_unstable();
        commands.dedup();
        commands
    }

    /// Effects of the tracker, with their place.
    pub fn tracker_effects(&self) -> Vec<String> {
        let of_tracker = self.effects.iter().filter(|(_, places)| places == &["tcp"]);
        of_tracker
            .map(|(effect, _)| format!("{effect}(tcp)"))
            .collect()
    }

    /// Freedoms of the plate that its closures hold, as columns of a motion: translation along x, y, z, then rotation
    /// about x, y, z. A reduced arm says nothing about orientation.
    pub fn freedoms(&self, plate: Plate) -> &'static [usize] {
        match self.arm {
            Arm::Full => plate.freedoms(),
            Arm::Reduced => plate.freedoms_of_tcp(),
        }
    }

    /// Index of a parameter by its owner, quantity and component.
    pub fn parameter(
        &self,
        owner: Owner,
        quantity: &str,
        component: Option<usize>,
    ) -> Option<usize> {
        self.parameters.iter().position(|parameter| {
            parameter.owner == owner
                && parameter.quantity == quantity
                && parameter.component == component
        })
    }

    /// Index of a parameter that is the variant's.
    ///
    /// # Panics
    /// The variant has no such parameter.
    pub fn index_of(&self, name: &str) -> usize {
        let index = self.parameters.iter().position(|own| own.name == name);
        index.unwrap_or_else(|| panic!("`{}` has no parameter `{name}`", self.name))
    }
}

/// Name of a command's column.
pub(crate) fn command_column(command: usize, is_angle: bool) -> String {
    let unit = if is_angle { "rad" } else { "m" };
    format!("q{}_{unit}", command + 1)
}

/// A family that is compiled in, behind the same pointer as one that is interpreted.
struct Static(&'static dyn ResidualFamily);

impl ResidualFamily for Static {
    fn shape(&self) -> runtime::Shape {
        self.0.shape()
    }
    fn pattern(&self) -> runtime::Pattern<'_> {
        self.0.pattern()
    }
    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        self.0.prepare(data, prepared);
    }
    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        self.0.value(prepared, parameters, residuals);
    }
    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.0.linearize(prepared, parameters, residuals, jacobian);
    }
    fn blocks(&self) -> Option<&dyn runtime::BlockFamily> {
        self.0.blocks()
    }
}

impl From<&runtime::Robot> for Robot {
    /// # Panics
    /// Generated code holds a description that this version of the language can't read: without it, drives and the plate would be
    /// taken for others.
    fn from(robot: &runtime::Robot) -> Self {
        // Tables of generated code hold what its functions need; all else stands in the description.
        let read = language::check_text(robot.description);
        let model = read.unwrap_or_else(|errors| {
            let name = robot.name;
            panic!(
                "the code of `{name}` carries a description that this version can't read; generate it again: {errors}"
            )
        });
        let variants = model.variants.iter().zip(robot.variants);
        let variants = variants.map(|own| Variant::generated(&model, own));
        let variants = variants.collect();
        Self::of(model, robot.description, variants)
    }
}

impl From<&CompiledRobot> for Robot {
    fn from(robot: &CompiledRobot) -> Self {
        let variants = robot.variants.iter().map(Variant::from).collect();
        Self::of(robot.model.clone(), &robot.description, variants)
    }
}

impl Variant {
    /// A variant of a model with its generated functions.
    fn generated(model: &Model, (own, tables): (&model::Variant, &runtime::Variant)) -> Self {
        let parameter = |own: &runtime::Parameter| Parameter {
            name: own.name.into(),
            owner: own.owner,
            quantity: own.quantity.into(),
            component: own.component,
            unit: own.unit.into(),
            nominal: own.nominal,
            tolerance: own.tolerance,
            search: own.search,
        };
        let instance = |own: &runtime::Instance| Instance {
            kind: own.kind,
            of: own.of,
            family: Arc::new(Static(own.family)),
            parameters: own.parameters.iter().map(|&index| index as usize).collect(),
            inputs: own.inputs.to_vec(),
        };
        Self {
            name: tables.name.into(),
            arm: own.arm,
            tracks: own.tracks.clone(),
            effects: effects(model, own),
            parameters: tables.parameters.iter().map(parameter).collect(),
            instances: tables.instances.iter().map(instance).collect(),
        }
    }
}

impl From<&CompiledVariant> for Variant {
    fn from(variant: &CompiledVariant) -> Self {
        let families: Vec<Arc<dyn ResidualFamily>> = variant
            .families
            .iter()
            .map(tau_codegen::Family::interpreted)
            .collect();
        Self {
            name: variant.name.clone(),
            arm: variant.arm,
            tracks: variant.tracks.clone(),
            effects: variant.effects.clone(),
            parameters: variant.parameters.clone(),
            instances: variant
                .instances
                .iter()
                .map(|i| Instance {
                    kind: i.kind,
                    of: i.of,
                    family: Arc::clone(&families[i.family]),
                    parameters: i.parameters.clone(),
                    inputs: i.inputs.clone(),
                })
                .collect(),
        }
    }
}

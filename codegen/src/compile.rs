//! A checked model, compiled: what the emitter prints and the interpreter runs.
//!
//! Links of the same form share one family; an instance says which parameters and data it takes. Names inside a
//! family are by role, so that equal code is equal text. Parameters that an effect may have (`optional param`) and a
//! variant does not take are constants of the expressions and cost nothing.

use std::sync::Arc;

use tau_model_dsl::Model;
use tau_model_dsl::model::{Arm, Place, TrackModel, Variant};
use tau_runtime::{self as runtime, Input, ResidualKind, Shape};

use crate::equations::{self, Context, Equations, Parameter, Staging};
use crate::graph::{Expr, Node};
use crate::interpret::Interpreted;
use crate::lower::Programs;

/// A robot with all its variants, compiled.
#[derive(Debug, Clone)]
pub struct CompiledRobot {
    /// The model it was compiled from.
    pub model: Model,
    /// The text of the description.
    pub description: String,
    /// Its variants, in order of declaration.
    pub variants: Vec<CompiledVariant>,
}

/// A variant, compiled.
#[derive(Debug, Clone)]
pub struct CompiledVariant {
    /// Name.
    pub name: String,
    /// Lines of its doc comment.
    pub docs: Vec<String>,
    /// Closure per link or per cluster.
    pub arm: Arm,
    /// One model per track.
    pub tracks: Vec<TrackModel>,
    /// Effects with their places.
    pub effects: Vec<(String, Vec<String>)>,
    /// All parameters.
    pub parameters: Vec<Parameter>,
    /// The distinct residual families.
    pub families: Vec<Family>,
    /// Residuals: families applied to links, clusters and carts.
    pub instances: Vec<CompiledInstance>,
}

/// A residual family: equations that one or more links, clusters or carts share.
#[derive(Debug, Clone)]
pub struct Family {
    /// Name, unique within the variant, in snake case.
    pub name: String,
    /// Kind of the residual.
    pub kind: ResidualKind,
    /// The equation, for documentation.
    pub equation: &'static str,
    /// Sizes of its slices.
    pub shape: Shape,
    /// Names of its data, in order.
    pub data: Vec<String>,
    /// Names of its parameters, in order.
    pub parameters: Vec<String>,
    /// Start of each row of the Jacobian.
    pub row_starts: Vec<u32>,
    /// Column of each entry of the Jacobian.
    pub columns: Vec<u32>,
    /// The code.
    pub programs: Programs,
}

/// A family applied to a link, a cluster or a cart.
#[derive(Debug, Clone)]
pub struct CompiledInstance {
    /// Kind of the residual.
    pub kind: ResidualKind,
    /// Index of the link, cluster or track; of an error of the tracker the axis.
    pub of: usize,
    /// Index in [`CompiledVariant::families`].
    pub family: usize,
    /// Index of each parameter in [`CompiledVariant::parameters`].
    pub parameters: Vec<usize>,
    /// Source of each datum.
    pub inputs: Vec<Input>,
}

impl Family {
    /// Lowers equations; the family has no name yet.
    fn of(equations: &Equations) -> Self {
        let programs = equations.lower();
        let name = |expr: Expr| match equations.graph.node(expr) {
            Node::Symbol(symbol) => equations.graph.symbols()[symbol.0 as usize].name.clone(),
            other => unreachable!("a variable is a symbol, not {other:?}"),
        };
        Self {
            name: String::new(),
            kind: equations.kind,
            equation: equations.equation,
            shape: equations.shape(programs.prepare.outputs.len()),
            data: equations
                .data
                .iter()
                .map(|&(_, symbol)| name(symbol))
                .collect(),
            parameters: equations
                .parameters
                .iter()
                .map(|&(_, symbol)| name(symbol))
                .collect(),
            row_starts: equations.jacobian.row_starts.clone(),
            columns: equations.jacobian.columns.clone(),
            programs,
        }
    }

    /// The family, to be run by the interpreter.
    pub fn interpreted(&self) -> Arc<dyn runtime::ResidualFamily> {
        Arc::new(Interpreted::new(
            self.shape,
            self.row_starts.clone(),
            self.columns.clone(),
            &self.programs,
        ))
    }

    /// True if another family has the same code, sizes and names.
    pub fn same_code(&self, other: &Self) -> bool {
        (self.kind, self.shape, &self.data, &self.parameters)
            == (other.kind, other.shape, &other.data, &other.parameters)
            && (&self.row_starts, &self.columns, &self.programs)
                == (&other.row_starts, &other.columns, &other.programs)
    }
}

/// Compiles a model; `description` is the text it came from.
pub fn compile(model: &Model, description: &str) -> CompiledRobot {
    let mut known = Known::default();
    CompiledRobot {
        model: model.clone(),
        description: description.to_owned(),
        variants: (0..model.variants.len())
            .map(|variant| compile_known(model, variant, |_, _| true, &mut known))
            .collect(),
    }
}

impl CompiledRobot {
    /// Compiles a model that may begin with the same variants: those are taken over.
    #[must_use]
    pub fn extended(self, model: &Model, description: &str) -> Self {
        let mut variants = self.variants;
        let same = (0..variants.len())
            .take_while(|&variant| is_same_variant(&self.model, model, variant))
            .count();
        variants.truncate(same);
        let mut known = Known::default();
        let further = (same..model.variants.len())
            .map(|variant| compile_known(model, variant, |_, _| true, &mut known));
        variants.extend(further);
        Self {
            model: model.clone(),
            description: description.to_owned(),
            variants,
        }
    }
}

/// True if two models have the same variant at an index; its effects may stand at other places in the
/// models.
fn is_same_variant(one: &Model, other: &Model, index: usize) -> bool {
    let (Some(of_one), Some(of_other)) = (one.variants.get(index), other.variants.get(index))
    else {
        return false;
    };
    let effects = |model: &Model, variant: &Variant| -> Vec<_> {
        let uses = variant.effects.iter();
        uses.map(|used| {
            let effect = model.effects[used.effect].clone();
            (effect, used.place, used.with.clone())
        })
        .collect()
    };
    (one.plate, &one.parameters) == (other.plate, &other.parameters)
        && (&one.tracks, &one.clusters, &one.links)
            == (&other.tracks, &other.clusters, &other.links)
        && of_one.holds == of_other.holds
        && (&of_one.name, &of_one.docs) == (&of_other.name, &of_other.docs)
        && (of_one.arm, &of_one.tracks) == (of_other.arm, &of_other.tracks)
        && effects(one, of_one) == effects(other, of_other)
}

/// Compiles those residuals of one variant, by its index, that are wanted, by their kind and the index
/// of their link, cluster, track or axis; the parameters are those of all.
pub fn compile_some(
    model: &Model,
    variant: usize,
    wanted: impl Fn(ResidualKind, usize) -> bool,
) -> CompiledVariant {
    compile_known(model, variant, wanted, &mut Known::default())
}

/// Families that were lowered already, with their equations.
type Known = Vec<(Equations, Family)>;

fn compile_known(
    model: &Model,
    variant: usize,
    wanted: impl Fn(ResidualKind, usize) -> bool,
    known: &mut Known,
) -> CompiledVariant {
    let variant = &model.variants[variant];
    let parameters = equations::parameters(model, variant);
    let context = || Context::new(model, variant, &parameters, Staging::Staged);
    let closures = match variant.arm {
        Arm::Full => model.links.len(),
        Arm::Reduced => model.clusters.len(),
    };
    let carts: Vec<usize> = (0..model.tracks.len())
        .filter(|&track| model.tracks[track].crank.is_none())
        .collect();
    let carts = || carts.iter().copied();
    let mut compiled = CompiledVariant {
        name: variant.name.clone(),
        docs: variant.docs.clone(),
        arm: variant.arm,
        tracks: variant.tracks.clone(),
        effects: effects(model, variant),
        families: vec![],
        instances: vec![],
        parameters: parameters.clone(),
    };
    for of in (0..closures).filter(|&of| wanted(ResidualKind::Closure, of)) {
        compiled.add(equations::closure(context(), of, false), known);
    }
    for of in (0..closures).filter(|&of| wanted(ResidualKind::ClosureByPose, of)) {
        compiled.add(equations::closure_by_pose(context(), of), known);
    }
    for of in carts().filter(|&of| wanted(ResidualKind::CartPose, of)) {
        compiled.add(equations::cart_pose(context(), of), known);
    }
    for of in carts().filter(|&of| wanted(ResidualKind::CartPosition, of)) {
        compiled.add(equations::cart_position(context(), of), known);
    }
    let axes = 0..if has_tracker_errors(variant) { 3 } else { 0 };
    for of in axes.filter(|&of| wanted(ResidualKind::TrackerError, of)) {
        compiled.add(equations::tracker_error(context(), of), known);
    }
    compiled.name_families(model);
    compiled
}

/// Effects of a variant with their places, as the description writes them.
pub fn effects(model: &Model, variant: &Variant) -> Vec<(String, Vec<String>)> {
    let uses = variant.effects.iter();
    uses.map(|used| {
        let name = model.effects[used.effect].name.clone();
        (name, equations::places(model, used.place))
    })
    .collect()
}

/// True if a variant has effects of the tracker.
fn has_tracker_errors(variant: &Variant) -> bool {
    let mut effects = variant.effects.iter();
    effects.any(|used| used.place == Place::Tcp)
}

impl CompiledVariant {
    /// Lowers equations and adds them, sharing the code of an equal family.
    fn add(&mut self, equations: Equations, known: &mut Known) {
        let family = known
            .iter()
            .find(|(other, _)| other.same_form(&equations))
            .map(|(_, family)| family.clone());
        let is_new = family.is_none();
        let family = family.unwrap_or_else(|| Family::of(&equations));
        let index = self
            .families
            .iter()
            .position(|own| own.same_code(&family))
            .unwrap_or_else(|| {
                self.families.push(family.clone());
                self.families.len() - 1
            });
        self.instances.push(CompiledInstance {
            kind: equations.kind,
            of: equations.of,
            family: index,
            parameters: equations
                .parameters
                .iter()
                .map(|&(parameter, _)| parameter)
                .collect(),
            inputs: equations.data.iter().map(|&(input, _)| input).collect(),
        });
        if is_new {
            known.push((equations, family));
        }
    }

    /// Names each family after its residual, and after the first link, cluster or cart that uses it where
    /// several families write the same residual.
    fn name_families(&mut self, model: &Model) {
        for index in 0..self.families.len() {
            let kind = self.families[index].kind;
            let base = match kind {
                ResidualKind::Closure => "closure",
                ResidualKind::ClosureByPose => "closure_by_pose",
                ResidualKind::CartPose => "cart_pose",
                ResidualKind::CartPosition => "cart_position",
                ResidualKind::TrackerError => "tracker_error",
            };
            let alone = self
                .families
                .iter()
                .filter(|family| family.kind == kind)
                .count()
                == 1;
            self.families[index].name = if alone {
                base.to_owned()
            } else {
                let first = self
                    .instances
                    .iter()
                    .find(|instance| instance.family == index)
                    .expect("every family was added for an instance");
                let of = match (kind, self.arm) {
                    (ResidualKind::TrackerError, _) => ["x", "y", "z"][first.of],
                    (ResidualKind::CartPose | ResidualKind::CartPosition, _) => {
                        model.tracks[first.of].name.as_str()
                    }
                    (_, Arm::Full) => &model.links[first.of].name,
                    (_, Arm::Reduced) => &model.clusters[first.of].name,
                };
                format!("{base}_{of}")
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use tau_model_dsl::check_text;

    use super::*;

    const TEXT: &str = "
        effect shift on cart { param gain: ratio tol 10 ppm; along += gain * q; }
        robot Short {
            track one;
            cluster arm on one { link a, b, c, d, e, f; }
            variant Plain { arm full; tracks linear per link; }
            variant Shifted = Plain + shift(one);
        }";

    /// Families taken over are those that would be compiled; families that differ are compiled.
    #[test]
    fn a_robot_extended_is_the_robot_compiled() {
        let before = compile(&check_text(TEXT).unwrap(), TEXT);
        let further = "
            effect wave on cart { param size: length tol 1 um; along += size * sin(q / 1 m); }"
            .to_owned()
            + &TEXT.replace("(one);", "(one); variant More = Shifted + wave(one);");
        for text in [further.clone(), further.replace("gain * q", "2 * gain * q")] {
            let model = check_text(&text).unwrap();
            let (fresh, extended) = (
                compile(&model, &text),
                before.clone().extended(&model, &text),
            );
            assert_eq!(format!("{extended:?}"), format!("{fresh:?}"));
        }
    }
}

//! From expressions to programs: regrouping, staging, choice of signs, instructions.
//!
//! 1. Turns are written out ([`Graph::expand_turns`]).
//! 2. Sums and products are flattened where nothing else reads them, grouped by stage so that
//!    data-only parts become one value, and common factors are taken out (`regroup`).
//! 3. Whatever depends on data alone and is read by parameter-dependent work becomes a *prepared*
//!    value, computed once per sample.
//! 4. Every sum may be stored with either sign; signs are chosen so that few negations remain, and the
//!    rest becomes straight-line code (`form`, `signs`, `instructions`).
//!
//! The stage is a property of an expression: constant, data or parameter-dependent by what it contains. The
//! closure equation with ten derivatives takes 56 operations per iteration once its data-only work is prepared,
//! 69 in one piece; a test pins the counts. Additions and multiplications stay apart and in one order: no back
//! end may fuse them, so that single samples, blocks and the interpreter agree bit for bit.

mod form;
mod instructions;
mod regroup;
mod signs;

use form::{Form, core};

use crate::graph::{Expr, ExprMap, Graph, Node, Stage};
use crate::program::{Program, RESERVED};

/// The programs of one residual family.
#[derive(Debug, Clone, PartialEq)]
pub struct Programs {
    /// Data to prepared values, once per sample.
    pub prepare: Program,
    /// Prepared values and parameters to residuals.
    pub value: Program,
    /// Prepared values and parameters to residuals followed by the Jacobian's entries.
    pub linearize: Program,
}

/// Lowers residuals and Jacobian entries of one family.
///
/// `data` and `parameters` are the family's symbols in the order of its slices. Data symbols that
/// were created with [`Stage::Parameter`] are not hoisted: that is how unstaged code is made.
pub fn lower(
    graph: &mut Graph,
    residuals: &[Expr],
    jacobian: &[Expr],
    data: &[Expr],
    parameters: &[Expr],
) -> Programs {
    let roots: Vec<Expr> = residuals.iter().chain(jacobian).copied().collect();
    let expanded = graph.expand_turns(&roots);
    let roots = regroup::regroup(graph, &expanded);
    let slots = prepared(graph, &roots);

    let mut inputs: ExprMap<usize> = ExprMap::new(graph);
    let mut names = Vec::new();
    for (position, &slot) in slots.iter().enumerate() {
        inputs.insert(slot, position);
        names.push(slot_name(graph, slot, position));
    }
    make_unique(&mut names);
    let slot_names = names.clone();
    for &parameter in parameters {
        inputs.insert(parameter, names.len());
        names.push(symbol_name(graph, parameter));
    }
    make_unique(&mut names);

    let linear = Form::new(graph, &roots, &inputs);
    let signs = signs::choose(&linear, slots.len());
    let linearize = instructions::emit(graph, &linear, &signs, &inputs, names.clone());

    // The value program must read the prepared values with the signs that the Jacobian chose.
    let residual_roots = &roots[..residuals.len()];
    let form = Form::new(graph, residual_roots, &inputs);
    let value_signs = signs::choose_with_inputs(&form, &signs.inputs);
    let value = instructions::emit(graph, &form, &value_signs, &inputs, names);

    let mut data_inputs: ExprMap<usize> = ExprMap::new(graph);
    for (position, &symbol) in data.iter().enumerate() {
        data_inputs.insert(symbol, position);
    }
    let data_names: Vec<String> = data
        .iter()
        .map(|&symbol| symbol_name(graph, symbol))
        .collect();
    let outputs: Vec<Expr> = slots
        .iter()
        .zip(&signs.inputs)
        .map(|(&slot, &negative)| if negative { graph.negate(slot) } else { slot })
        .collect();
    let form = Form::new(graph, &outputs, &data_inputs);
    let prepare_signs = signs::choose(&form, 0);
    let mut prepare = instructions::emit(graph, &form, &prepare_signs, &data_inputs, data_names);
    name_outputs(&mut prepare, &slot_names);
    Programs {
        prepare,
        value,
        linearize,
    }
}

/// Prepared values: data-only expressions that parameter-dependent ones, or results, read.
fn prepared(graph: &Graph, roots: &[Expr]) -> Vec<Expr> {
    let is_data = |expr: Expr| {
        graph.stage(expr) <= Stage::Data && !matches!(graph.node(expr), Node::Constant(_))
    };
    let mut slots = std::collections::BTreeSet::new();
    let mut collect = |expr: Expr| {
        let core = core(graph, expr).1;
        if is_data(core) {
            slots.insert(core);
        }
    };
    for &root in roots {
        collect(root);
    }
    for expr in graph.reachable(roots) {
        // A negation is not work of its own: its reader decides.
        if graph.stage(expr) == Stage::Parameter && !matches!(graph.node(expr), Node::Negate(_)) {
            graph.node(expr).children().for_each(&mut collect);
        }
    }
    slots.into_iter().collect()
}

fn symbol_name(graph: &Graph, expr: Expr) -> String {
    match graph.node(expr) {
        Node::Symbol(symbol) => graph.symbols()[symbol.0 as usize].name.clone(),
        other => unreachable!("inputs are symbols, not {other:?}"),
    }
}

fn slot_name(graph: &Graph, slot: Expr, position: usize) -> String {
    match graph.node(slot) {
        Node::Symbol(_) => symbol_name(graph, slot),
        _ => graph
            .name_of(slot)
            .map_or_else(|| format!("prepared_{position}"), str::to_owned),
    }
}

/// Appends numbers to names that occur before or that emitted code needs itself.
fn make_unique(names: &mut [String]) {
    let mut seen: std::collections::BTreeSet<String> = RESERVED.map(str::to_owned).into();
    for name in names {
        let base = name.clone();
        let mut suffix = 1;
        while !seen.insert(name.clone()) {
            suffix += 1;
            *name = format!("{base}_{suffix}");
        }
    }
}

/// Names the temporaries that are outputs after those outputs, where they have no name yet.
fn name_outputs(program: &mut Program, names: &[String]) {
    for (output, name) in program.outputs.iter().zip(names) {
        if let crate::program::Operand::Temporary(index) = output {
            program.names[*index].get_or_insert_with(|| name.clone());
        }
    }
}

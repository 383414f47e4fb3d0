//! From a checked model to residual equations.
//!
//! For each variant: a table of parameters, and for every link, cluster and cart the residuals
//! `closure`, `closure_by_pose`, `cart_pose` and `cart_position` as expressions. One cart motion,
//! effects included, stands behind all of them. Where a tracker has errors, `tracker_error` is these alone.

mod closure;
mod context;
mod drive;
pub(crate) mod formula;
mod motion;
mod parameters;
mod roles;
mod targets;
mod tracker;
mod value;

pub use closure::{closure, closure_by_pose};
pub(crate) use context::symbol;
pub use context::{Context, Staging};
pub use formula::Scope;
pub use parameters::{PULL, Parameter, parameters, places};
pub use targets::{cart_pose, cart_position};
pub use tracker::tracker_error;

use crate::graph::{Expr, Graph, Stage};
use crate::lower::{Programs, lower};
use tau_runtime::{Input, ResidualKind, Shape};

/// Residuals of one link, cluster or cart, differentiated, not yet lowered.
#[derive(Debug)]
pub struct Equations {
    /// Kind of the residual.
    pub kind: ResidualKind,
    /// Index of the link, cluster or track.
    pub of: usize,
    /// The graph that holds the expressions.
    pub graph: Graph,
    /// Data symbols, and what to fill in.
    pub data: Vec<(Input, Expr)>,
    /// Parameter symbols, with their index in the variant's table.
    pub parameters: Vec<(usize, Expr)>,
    /// The residuals.
    pub residuals: Vec<Expr>,
    /// The Jacobian's structural non-zeros: row starts, columns, entries.
    pub jacobian: SparseRows,
    /// The equation in words, for the documentation of generated code.
    pub equation: &'static str,
}

/// A sparse matrix of expressions in compressed rows.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SparseRows {
    /// Start of each row in `columns`, and their number at the end.
    pub row_starts: Vec<u32>,
    /// Column of each entry.
    pub columns: Vec<u32>,
    /// The entries.
    pub entries: Vec<Expr>,
}

impl SparseRows {
    /// Keeps the structural non-zeros of dense rows.
    pub fn from_dense(graph: &Graph, rows: &[Vec<Expr>]) -> Self {
        let mut sparse = Self {
            row_starts: vec![0],
            ..Self::default()
        };
        for row in rows {
            for (column, &entry) in row.iter().enumerate() {
                if !graph.is_zero(entry) {
                    sparse.columns.push(column as u32);
                    sparse.entries.push(entry);
                }
            }
            sparse.row_starts.push(sparse.columns.len() as u32);
        }
        sparse
    }
}

impl Equations {
    /// Sizes of the family's slices before lowering; `prepared` is known only afterwards.
    pub fn shape(&self, prepared: usize) -> Shape {
        Shape {
            data: self.data.len(),
            prepared,
            parameters: self.parameters.len(),
            residuals: self.residuals.len(),
        }
    }

    /// True if other equations lower to the same code: the links, clusters and carts of one form differ
    /// in what fills data and parameters alone.
    pub fn same_form(&self, other: &Self) -> bool {
        fn symbols<T>(of: &[(T, Expr)]) -> impl Iterator<Item = Expr> {
            of.iter().map(|&(_, symbol)| symbol)
        }
        self.kind == other.kind
            && self.graph == other.graph
            && symbols(&self.data).eq(symbols(&other.data))
            && symbols(&self.parameters).eq(symbols(&other.parameters))
            && self.residuals == other.residuals
            && self.jacobian == other.jacobian
    }

    /// Lowers to programs.
    pub fn lower(&self) -> Programs {
        let staged = |graph: &Graph, expr: Expr| graph.stage(expr) <= Stage::Data;
        let data: Vec<Expr> = self.data.iter().map(|&(_, symbol)| symbol).collect();
        // Data that are not staged are read like parameters, behind them.
        let mut variables: Vec<Expr> = self.parameters.iter().map(|&(_, symbol)| symbol).collect();
        variables.extend(
            data.iter()
                .copied()
                .filter(|&symbol| !staged(&self.graph, symbol)),
        );
        lower(
            &mut self.graph.clone(),
            &self.residuals,
            &self.jacobian.entries,
            &data,
            &variables,
        )
    }
}

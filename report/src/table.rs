//! A table of text cells, for terminal and page alike.

use super::number::fixed;

/// A column: its name, and the group and unit that it shares with its neighbours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    /// Common heading of neighbouring columns; empty for none.
    pub(super) group: String,
    pub(super) name: String,
}

/// A cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Cell {
    /// Words, aligned left.
    Text(String),
    /// A number in ASCII, aligned right.
    Number(String),
    /// Does not apply.
    Empty,
}

/// A table; its first column names the row.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) title: String,
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<Vec<Cell>>,
}

pub(super) fn columns(groups: &[(&str, &[&str])]) -> Vec<Column> {
    groups
        .iter()
        .flat_map(|(group, names)| {
            names.iter().map(|name| Column {
                group: (*group).to_owned(),
                name: (*name).to_owned(),
            })
        })
        .collect()
}

pub(super) fn text(value: &str) -> Cell {
    Cell::Text(value.to_owned())
}

pub(super) fn number(value: f64, decimals: usize) -> Cell {
    Cell::Number(fixed(value, decimals))
}

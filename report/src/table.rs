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

/// Mark of values that the data do not determine.
pub(super) const DRAWN: char = '*';

impl Cell {
    /// A number with that mark where it has to have it.
    pub(super) fn marked(self, is_drawn: bool) -> Self {
        match self {
            Self::Number(number) if is_drawn => Self::Number(format!("{number}{DRAWN}")),
            cell => cell,
        }
    }
}

/// A table; its first column names the row.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) title: String,
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Without the columns in which nothing stands in any row.
    pub(super) fn without_empty_columns(mut self) -> Self {
        let rows = &self.rows;
        let has_entry = |column: usize| {
            let mut cells = rows.iter().map(|row| row.get(column));
            rows.is_empty() || cells.any(|cell| !matches!(cell, None | Some(Cell::Empty)))
        };
        let kept: Vec<bool> = (0..self.columns.len()).map(has_entry).collect();
        let mut keep = kept.iter();
        self.columns.retain(|_| keep.next() != Some(&false));
        for row in &mut self.rows {
            let mut keep = kept.iter();
            row.retain(|_| keep.next() != Some(&false));
        }
        self
    }
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

//! A CSV table, as files of measurements and outputs are.

use std::fmt::{self, Display};

/// A table of text: a heading, and rows of as many cells. Rows count from 1 here, so that row `k` of the file of a
/// measurement stands in line `k + 1`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Table {
    /// Names of the columns.
    pub header: Vec<String>,
    /// Cells by row.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads a table; cells hold no commas.
    ///
    /// # Panics
    /// There is no heading, or a row has another number of cells.
    #[track_caller]
    pub fn parse(text: &str) -> Self {
        let mut lines = text
            .lines()
            .map(|line| line.split(',').map(str::to_owned).collect());
        let header: Vec<String> = lines.next().expect("a heading");
        let rows: Vec<Vec<String>> = lines.collect();
        for row in &rows {
            assert_eq!(row.len(), header.len(), "{row:?} under {header:?}");
        }
        Self { header, rows }
    }

    /// Index of a column.
    ///
    /// # Panics
    /// There is none of this name.
    #[track_caller]
    pub fn index(&self, column: &str) -> usize {
        let found = self.header.iter().position(|name| name == column);
        found.unwrap_or_else(|| panic!("no column `{column}` in {:?}", self.header))
    }

    /// A cell; rows count from 1.
    #[track_caller]
    pub fn cell(&self, row: usize, column: &str) -> &str {
        &self.rows[row - 1][self.index(column)]
    }

    /// A number; rows count from 1.
    ///
    /// # Panics
    /// The cell holds none.
    #[track_caller]
    pub fn number(&self, row: usize, column: &str) -> f64 {
        self.cell(row, column).parse().expect("a number")
    }

    /// The cells of a column.
    #[track_caller]
    pub fn cells(&self, column: &str) -> Vec<&str> {
        let k = self.index(column);
        self.rows.iter().map(|row| row[k].as_str()).collect()
    }

    /// The numbers of a column.
    ///
    /// # Panics
    /// A cell holds none.
    #[track_caller]
    pub fn numbers(&self, column: &str) -> Vec<f64> {
        let cells = self.cells(column);
        cells
            .iter()
            .map(|cell| cell.parse().expect("a number"))
            .collect()
    }

    /// Changes a cell; rows count from 1.
    #[track_caller]
    pub fn set(&mut self, row: usize, column: &str, value: impl Display) {
        let k = self.index(column);
        self.rows[row - 1][k] = value.to_string();
    }

    /// Adds to a number; rows count from 1.
    #[track_caller]
    pub fn add(&mut self, row: usize, column: &str, by: f64) {
        let value = self.number(row, column) + by;
        self.set(row, column, value);
    }

    /// Changes the numbers of a column; the change is handed the row, from 1, too.
    #[track_caller]
    pub fn map(&mut self, column: &str, change: impl Fn(usize, f64) -> f64) {
        for (row, value) in self.numbers(column).into_iter().enumerate() {
            self.set(row + 1, column, change(row + 1, value));
        }
    }

    /// Changes the numbers of some columns together, row by row, from 1.
    #[track_caller]
    pub fn map_together<const N: usize>(
        &mut self,
        columns: [&str; N],
        mut change: impl FnMut(usize, &mut [f64; N]),
    ) {
        for row in 1..=self.rows.len() {
            let mut values = columns.map(|column| self.number(row, column));
            change(row, &mut values);
            for (column, value) in columns.iter().zip(values) {
                self.set(row, column, value);
            }
        }
    }

    /// Multiplies columns.
    #[track_caller]
    pub fn scale(&mut self, columns: &[&str], factor: f64) {
        for column in columns {
            self.map(column, |_, value| factor * value);
        }
    }

    /// Adds to a column.
    #[track_caller]
    pub fn shift(&mut self, column: &str, by: f64) {
        self.map(column, |_, value| value + by);
    }

    /// Exchanges what two columns hold.
    #[track_caller]
    pub fn exchange(&mut self, one: &str, other: &str) {
        let [one, other] = [self.index(one), self.index(other)];
        for row in &mut self.rows {
            row.swap(one, other);
        }
    }

    /// Moves the cells of columns down by so many rows; those that leave the table come in at its top.
    #[track_caller]
    pub fn rotate(&mut self, columns: &[&str], by: usize) {
        let count = self.rows.len();
        for column in columns {
            let k = self.index(column);
            let cells: Vec<String> = self.rows.iter().map(|row| row[k].clone()).collect();
            for (row, cell) in cells.into_iter().enumerate() {
                self.rows[(row + by) % count][k] = cell;
            }
        }
    }

    /// Removes columns.
    #[track_caller]
    pub fn drop(&mut self, columns: &[&str]) {
        for column in columns {
            let k = self.index(column);
            self.header.remove(k);
            for row in &mut self.rows {
                row.remove(k);
            }
        }
    }

    /// Gives a column another name.
    #[track_caller]
    pub fn rename(&mut self, column: &str, name: &str) {
        let k = self.index(column);
        name.clone_into(&mut self.header[k]);
    }

    /// Adds a column; its cells are made of their row, from 1.
    pub fn append_column<T: Display>(&mut self, name: &str, cell: impl Fn(usize) -> T) {
        self.header.push(name.to_owned());
        for (row, cells) in self.rows.iter_mut().enumerate() {
            cells.push(cell(row + 1).to_string());
        }
    }

    /// Keeps the rows, from 1, for which it is true.
    pub fn keep(&mut self, mut is_kept: impl FnMut(usize) -> bool) {
        let mut row = 0;
        self.rows.retain(|_| {
            row += 1;
            is_kept(row)
        });
    }

    /// Appends a row.
    ///
    /// # Panics
    /// It has another number of cells.
    #[track_caller]
    pub fn append(&mut self, cells: &[impl Display]) {
        assert_eq!(cells.len(), self.header.len());
        self.rows
            .push(cells.iter().map(ToString::to_string).collect());
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for row in std::iter::once(&self.header).chain(&self.rows) {
            writeln!(f, "{}", row.join(","))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_do_what_they_are_called() {
        let mut table = Table::parse("pose,q,x\n1,0.5,7\n2,0.25,8\n3,1,9\n");
        table.exchange("q", "x");
        table.scale(&["x"], 2.0);
        table.shift("q", 1.0);
        table.rotate(&["x"], 1);
        table.keep(|row| row != 2);
        table.append(&["4", "0", "0"]);
        table.append_column("row", |row| row);
        table.set(1, "pose", "one");
        assert_eq!(
            table.to_string(),
            "pose,q,x,row\none,8,2,1\n3,10,0.5,2\n4,0,0,3\n"
        );
        table.drop(&["q", "row"]);
        table.rename("x", "y");
        assert_eq!(table.numbers("y"), [2.0, 0.5, 0.0]);
    }
}

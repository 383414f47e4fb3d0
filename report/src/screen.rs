//! Text for a terminal: sentences and tables, none of them wider than it.

use std::borrow::Cow;

use crate::number::printable;
use crate::table::{Cell, Table};

/// Longest line of a sentence: longer ones are hard to read.
const LONGEST: usize = 100;
/// Narrowest terminal that is laid out for.
const NARROWEST: usize = 40;
/// Between the columns of a table.
const GAP: usize = 2;

/// Text that is being laid out.
pub(crate) struct Screen {
    width: usize,
    text: String,
}

impl Screen {
    /// Nothing yet, for lines of so many characters.
    pub(crate) fn new(width: usize) -> Self {
        Self {
            width: width.max(NARROWEST),
            text: String::new(),
        }
    }

    /// The text, without control characters.
    pub(crate) fn into_text(self) -> String {
        printable(&self.text)
    }

    /// A sentence, broken between words.
    pub(crate) fn say(&mut self, sentence: &str) {
        self.say_within("", sentence);
    }

    /// A sentence of which every line is indented.
    pub(crate) fn say_within(&mut self, indent: &str, sentence: &str) {
        let longest = self.width.min(LONGEST);
        let mut line = indent.to_owned();
        for word in sentence.split_whitespace() {
            let needed = line.chars().count() + word.chars().count();
            if needed > longest && line.len() > indent.len() {
                self.line(&line);
                indent.clone_into(&mut line);
            }
            line += word;
            line.push(' ');
        }
        self.line(&line);
    }

    /// A line as it stands.
    pub(crate) fn line(&mut self, line: &str) {
        self.text += line.trim_end();
        self.text.push('\n');
    }

    /// An empty line.
    pub(crate) fn gap(&mut self) {
        self.text.push('\n');
    }

    /// A table in aligned columns. What is wider than the terminal continues below, under the same row names, broken
    /// between groups of columns, and between columns where a group alone is wider.
    pub(crate) fn table(&mut self, table: &Table) {
        let widths = widths(table);
        self.line(&table.title);
        let total = |first: usize, end: usize| -> usize {
            let columns = widths[first..end].iter().map(|width| width + GAP);
            widths[0] + columns.sum::<usize>()
        };
        let mut blocks: Vec<Vec<(usize, usize)>> = Vec::new();
        let mut first = 1;
        for group in groups(table) {
            for (start, end) in self.pieces(group, total) {
                match blocks.last_mut() {
                    Some(block) if total(first, end) <= self.width => block.push((start, end)),
                    _ => {
                        first = start;
                        blocks.push(vec![(start, end)]);
                    }
                }
            }
        }
        for groups in blocks {
            self.block(table, &widths, &groups);
        }
    }

    /// A group of columns, or the parts of it that fit.
    fn pieces(
        &self,
        (start, end): (usize, usize),
        total: impl Fn(usize, usize) -> usize,
    ) -> Vec<(usize, usize)> {
        let mut pieces = Vec::new();
        let mut first = start;
        for column in start..end {
            if column > first && total(first, column + 1) > self.width {
                pieces.push((first, column));
                first = column;
            }
        }
        pieces.push((first, end));
        pieces
    }

    fn block(&mut self, table: &Table, widths: &[usize], groups: &[(usize, usize)]) {
        let mut headings = " ".repeat(widths[0]);
        let mut names = format!("{:<1$}", table.columns[0].name, widths[0]);
        let mut rows: Vec<String> = table
            .rows
            .iter()
            .map(|row| format!("{:<1$}", cell_text(&row[0]), widths[0]))
            .collect();
        let gap = " ".repeat(GAP);
        for &(start, end) in groups {
            let span: usize = widths[start..end].iter().sum::<usize>() + GAP * (end - start - 1);
            let heading = format!("{gap}{:^span$}", table.columns[start].group);
            headings.push_str(&heading);
            for column in start..end {
                let width = widths[column];
                let left = table
                    .rows
                    .iter()
                    .any(|row| matches!(row[column], Cell::Text(_)));
                let pad = |text: &str| {
                    if left {
                        format!("{gap}{text:<width$}")
                    } else {
                        format!("{gap}{text:>width$}")
                    }
                };
                names += &pad(&table.columns[column].name);
                for (line, row) in rows.iter_mut().zip(&table.rows) {
                    *line += &pad(&cell_text(&row[column]));
                }
            }
        }
        let rule = "─".repeat(count(&names));
        if !headings.trim().is_empty() {
            self.line(&headings);
        }
        for line in [names, rule].into_iter().chain(rows) {
            self.line(&line);
        }
    }
}

/// Widths of columns: of the widest cell, and a heading's share.
fn widths(table: &Table) -> Vec<usize> {
    let mut widths: Vec<usize> = table
        .columns
        .iter()
        .map(|column| count(&column.name))
        .collect();
    for row in &table.rows {
        for (widest, cell) in widths.iter_mut().zip(row) {
            *widest = (*widest).max(count(&cell_text(cell)));
        }
    }
    for (start, end) in groups(table) {
        let needed = count(&table.columns[start].group);
        let present: usize = widths[start..end].iter().sum::<usize>() + GAP * (end - start - 1);
        let missing = needed.saturating_sub(present);
        let columns = end - start;
        for (index, width) in widths[start..end].iter_mut().enumerate() {
            *width += missing / columns + usize::from(index < missing % columns);
        }
    }
    widths
}

/// Runs of columns with a common heading; the first column, which names the rows, is not among them.
fn groups(table: &Table) -> Vec<(usize, usize)> {
    let mut groups: Vec<(usize, usize)> = Vec::new();
    for index in 1..table.columns.len() {
        let group = &table.columns[index].group;
        match groups.last_mut() {
            Some((start, end)) if !group.is_empty() && table.columns[*start].group == *group => {
                *end = index + 1;
            }
            _ => groups.push((index, index + 1)),
        }
    }
    groups
}

fn cell_text(cell: &Cell) -> Cow<'_, str> {
    match cell {
        Cell::Text(text) => Cow::Borrowed(text),
        Cell::Number(number) => Cow::Owned(number.replace('-', "\u{2212}")),
        Cell::Empty => Cow::Borrowed("–"),
    }
}

fn count(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{columns, text};

    fn table() -> Table {
        let number = |value: usize| Cell::Number(format!("-{value}.00000"));
        Table {
            title: "Title".to_owned(),
            columns: columns(&[
                ("", &["Link"]),
                ("Plate joint (m)", &["x", "y", "z"]),
                ("Offset (m)", &["x", "y", "z"]),
            ]),
            rows: vec![
                std::iter::once(text("l1"))
                    .chain((1..7).map(number))
                    .collect(),
            ],
        }
    }

    fn laid_out(width: usize) -> String {
        let mut screen = Screen::new(width);
        screen.say(
            "A sentence that is longer than the narrowest of all the terminals that there are.",
        );
        screen.table(&table());
        screen.into_text()
    }

    #[test]
    fn nothing_is_wider_than_the_terminal_and_nothing_is_lost() {
        for width in [40, 47, 60, 80, 200] {
            let text = laid_out(width);
            assert!(text.lines().all(|line| count(line) <= width), "{text}");
            for value in 1..7 {
                let number = format!("\u{2212}{value}.00000");
                assert_eq!(text.matches(&number).count(), 1, "{text}");
            }
        }
        assert_eq!(laid_out(200).matches("l1").count(), 1);
        assert_eq!(laid_out(47).matches("l1").count(), 2);
    }
}

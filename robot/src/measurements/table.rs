//! Comma-separated tables of numbers with a header line, with the place of every field.

use std::ops::Range;

use tau_codes::{Code, files};
use tau_model_dsl::nearest;

use crate::input_error::{Mistakes, Source, quoted};

/// A table whose rows all have as many fields as its header.
#[derive(Debug)]
pub struct Table<'a> {
    source: Source<'a>,
    header_line: Range<usize>,
    header: Vec<Range<usize>>,
    /// All fields, row by row.
    fields: Vec<Range<usize>>,
    /// Line of each row, from 1.
    lines: Vec<usize>,
}

/// A column of numbers.
#[derive(Debug)]
pub struct Column<T = f64> {
    /// Its index in the table.
    pub index: usize,
    /// One value per row.
    pub values: Vec<T>,
}

impl<'a> Table<'a> {
    /// Splits a text into fields. Ragged rows are reported and left out; `None` where there is no
    /// table at all.
    pub fn parse(mistakes: &mut Mistakes<'a>) -> Option<Self> {
        let source = mistakes.source;
        let is_blank = |line: &Range<usize>| source.text[line.clone()].trim().is_empty();
        let mut numbered = source
            .lines()
            .enumerate()
            .filter(|(_, line)| !is_blank(line));
        let Some((_, header_line)) = numbered.next() else {
            mistake!(mistakes, files::EMPTY_TABLE, 0..0;
                "the file is empty, expected a header line and rows of numbers");
            return None;
        };
        let header_text = &source.text[header_line.clone()];
        if let Some((separator, name)) = foreign_separator(header_text) {
            let start = header_line.start + header_text.find(separator).unwrap_or(0);
            mistake!(mistakes, files::SEPARATOR, start..start + separator.len_utf8();
                "columns are separated by {name}, expected commas";
                "export with commas between columns and points in decimals");
            return None;
        }
        let header = fields(source, header_line.clone());
        if header
            .iter()
            .all(|field| source.text[field.clone()].parse::<f64>().is_ok())
        {
            mistake!(mistakes, files::NO_HEADER, header_line;
                "the first line holds numbers, expected a header with the names of the columns");
            return None;
        }
        let mut table = Self {
            source,
            header_line,
            header,
            fields: Vec::new(),
            lines: Vec::new(),
        };
        let mut ragged = Vec::new();
        // As many as there can be: vectors that grow would copy themselves into memory that is twice as large.
        let count = |of: u8| source.text.bytes().filter(|byte| *byte == of).count();
        let lines = count(b'\n') + 1;
        table.fields.reserve_exact(lines + count(b','));
        table.lines.reserve_exact(lines);
        for (index, line) in numbered {
            let start = table.fields.len();
            split(source, line.clone(), &mut table.fields);
            if table.fields.len() - start == table.header.len() {
                table.lines.push(index + 1);
            } else {
                ragged.push((line, table.fields.split_off(start)));
            }
        }
        if table.lines.is_empty() && ragged.is_empty() {
            let message = "nothing follows the header, expected rows of numbers";
            mistakes.push(files::EMPTY_TABLE, table.header_line.clone(), message);
            return None;
        }
        // Where no row fits the header, one example is enough.
        let shown = if table.lines.is_empty() {
            1
        } else {
            ragged.len()
        };
        for (line, row) in ragged.iter().take(shown) {
            table.report_ragged(line, row, mistakes);
        }
        Some(table)
    }

    fn report_ragged(
        &self,
        line: &Range<usize>,
        row: &[Range<usize>],
        mistakes: &mut Mistakes<'_>,
    ) {
        let (found, expected) = (row.len(), self.header.len());
        let message = format!("the row has {found} fields, expected {expected} as in the header");
        let beyond = row.get(expected).map_or(line.end, |field| field.start);
        let has_decimal_commas = found > expected + 1;
        let help = has_decimal_commas.then(|| "write decimals with points, not commas".to_owned());
        mistakes.add(files::RAGGED_ROW, beyond..line.end, message, help);
    }

    /// Indices of the columns that must be there. Missing ones are reported, all at once.
    pub(crate) fn require<const N: usize>(
        &self,
        names: [&str; N],
        commands: &[String],
        optional: &[String],
        mistakes: &mut Mistakes<'_>,
    ) -> Option<([usize; N], Vec<usize>)> {
        let required = || names.into_iter().chain(commands.iter().map(String::as_str));
        let before = mistakes.len();
        let is_known = |name: &str| {
            required()
                .chain(optional.iter().map(String::as_str))
                .any(|k| k == name)
        };
        for (index, name) in self.names().enumerate().filter(|(_, name)| is_known(name)) {
            if let Some(first) = self.column(name).filter(|&first| first < index) {
                mistake!(mistakes, files::COLUMN_TWICE, self.header[index].clone();
                    "column `{name}` is given twice, first as column {}", first + 1; "remove one of them");
            }
        }
        let strangers: Vec<(usize, &str)> = self
            .names()
            .enumerate()
            .filter(|(_, name)| !is_known(name))
            .collect();
        let mut missing = Vec::new();
        for name in required().filter(|name| self.column(name).is_none()) {
            match alike(name, &strangers) {
                Some((index, found)) => {
                    mistake!(mistakes, files::COLUMN_MISSING, self.header[index].clone();
                        "column `{name}` is missing, found `{found}`"; "{}", unit_advice(name, found));
                }
                None => missing.push(name),
            }
        }
        if !missing.is_empty() {
            mistake!(mistakes, files::COLUMN_MISSING, self.header_line.clone();
                "{} {} missing from the header", if missing.len() == 1 { "column" } else { "columns" }, quoted(missing);
                "expected {}", quoted(required()));
        }
        let fixed: Vec<usize> = names.iter().filter_map(|name| self.column(name)).collect();
        let commands: Vec<usize> = commands
            .iter()
            .filter_map(|name| self.column(name))
            .collect();
        (mistakes.len() == before).then_some((fixed.try_into().ok()?, commands))
    }

    /// The column of a name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.names().position(|found| found == name)
    }

    /// Names of the columns, in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &'a str> {
        self.header
            .iter()
            .map(|field| &self.source.text[field.clone()])
    }

    /// Name of a column.
    pub fn name(&self, column: usize) -> &'a str {
        &self.source.text[self.header[column].clone()]
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.lines.len()
    }

    /// Line of a row, from 1.
    pub fn line(&self, row: usize) -> usize {
        self.lines[row]
    }

    /// Place of a field.
    pub fn place(&self, row: usize, column: usize) -> Range<usize> {
        self.fields[row * self.header.len() + column].clone()
    }

    /// Place of the header.
    pub(crate) fn header_place(&self) -> Range<usize> {
        self.header_line.clone()
    }

    /// Place of the name of a column.
    pub fn name_place(&self, column: usize) -> Range<usize> {
        self.header[column].clone()
    }

    /// Text of a field.
    pub fn text(&self, row: usize, column: usize) -> &'a str {
        &self.source.text[self.place(row, column)]
    }

    /// A column of finite numbers. What is none is reported and becomes NaN.
    pub fn numbers(&self, index: usize, mistakes: &mut Mistakes<'_>) -> Column {
        self.parse_column(index, f64::NAN, mistakes, finite)
    }

    /// The same where fields may be empty, which become NaN.
    pub(crate) fn numbers_or_empty(&self, index: usize, mistakes: &mut Mistakes<'_>) -> Column {
        let parse = |text: &str| {
            if text.is_empty() {
                Ok(f64::NAN)
            } else {
                finite(text)
            }
        };
        self.parse_column(index, f64::NAN, mistakes, parse)
    }

    /// Reports a column that holds the quantity of an optional one in another unit.
    pub(crate) fn in_another_unit(&self, name: &str, mistakes: &mut Mistakes<'_>) {
        let Some((stem, _)) = name.rsplit_once('_') else {
            return;
        };
        for (index, found) in self.names().enumerate() {
            let unit = found.rsplit_once('_').filter(|(own, _)| *own == stem);
            if unit.is_some_and(|(_, unit)| ["mm", "cm", "um", "in"].contains(&unit)) {
                mistake!(mistakes, files::COLUMN_UNIT, self.header[index].clone();
                    "found column `{found}`, expected `{name}`"; "{}", unit_advice(name, found));
            }
        }
    }

    /// Reports columns that are spelt otherwise than one of some names.
    pub(crate) fn spelt_otherwise(&self, names: &[&str], mistakes: &mut Mistakes<'_>) {
        for (index, found) in self.names().enumerate() {
            if let Some(&name) = names
                .iter()
                .find(|&&name| found != name && spelt(found) == name)
            {
                mistake!(mistakes, files::COLUMN_MISSING, self.header[index].clone();
                    "column `{name}` is missing, found `{found}`"; "{}", unit_advice(name, found));
            }
        }
    }

    /// A column of finite numbers by its name; zeros where there is none.
    pub fn numbers_or_zero(&self, name: &str, mistakes: &mut Mistakes<'_>) -> Column {
        match self.column(name) {
            Some(index) => self.numbers(index, mistakes),
            None => Column {
                index: 0,
                values: vec![0.0; self.rows()],
            },
        }
    }

    /// Several columns of finite numbers.
    pub fn numbers_of(&self, indices: &[usize], mistakes: &mut Mistakes<'_>) -> Vec<Column> {
        indices
            .iter()
            .map(|&index| self.numbers(index, mistakes))
            .collect()
    }

    /// A column of whole numbers from 0. What is none is reported and becomes `None`.
    pub fn whole_numbers(&self, index: usize, mistakes: &mut Mistakes<'_>) -> Column<Option<u32>> {
        // Numerical software writes 3 as 3.0 or 3.0000000e+00.
        let parse = |text: &str| match text.parse::<f64>() {
            Ok(number) => whole(number).map(Some).ok_or_else(|| {
                (
                    files::NOT_WHOLE,
                    format!("found `{text}`, expected a whole number from 0"),
                    None,
                )
            }),
            Err(_) => Err(not_a_number(text)),
        };
        self.parse_column(index, None, mistakes, parse)
    }

    fn parse_column<T: Copy>(
        &self,
        index: usize,
        otherwise: T,
        mistakes: &mut Mistakes<'_>,
        parse: impl Fn(&str) -> Result<T, Misread>,
    ) -> Column<T> {
        let values = (0..self.rows())
            .map(|row| {
                parse(self.text(row, index)).unwrap_or_else(|(code, message, help)| {
                    mistakes.add(
                        code,
                        self.place(row, index),
                        message,
                        help.map(str::to_owned),
                    );
                    otherwise
                })
            })
            .collect();
        Column { index, values }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "checked before"
)]
fn whole(number: f64) -> Option<u32> {
    (number.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&number))
        .then_some(number as u32)
}

/// Why a field is not what is expected: code, message and remedy.
type Misread = (Code, String, Option<&'static str>);

fn finite(text: &str) -> Result<f64, Misread> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(number),
        Ok(_) => {
            let message = format!("found `{text}`, expected a finite number");
            Err((files::NOT_A_NUMBER, message, None))
        }
        Err(_) => Err(not_a_number(text)),
    }
}

fn not_a_number(text: &str) -> Misread {
    let code = files::NOT_A_NUMBER;
    if text.is_empty() {
        let message = "the field is empty, expected a number";
        return (code, message.to_owned(), None);
    }
    let help = if text.replace(',', ".").parse::<f64>().is_ok() {
        Some("write decimals with points, not commas")
    } else if text.contains('\u{2212}') {
        Some("the minus sign is the character U+2212, write `-`")
    } else {
        None
    };
    (code, format!("found `{text}`, expected a number"), help)
}

/// Separator of a header's columns, where it is no comma.
fn foreign_separator(header: &str) -> Option<(char, &'static str)> {
    if header.contains(',') {
        return None;
    }
    [(';', "semicolons"), ('\t', "tabs"), ('|', "vertical bars")]
        .into_iter()
        .find(|(separator, _)| header.contains(*separator))
}

/// A name as it would be written in a header: in small letters, with `_` for spaces and dashes.
pub(crate) fn spelt(name: &str) -> String {
    name.to_ascii_lowercase().replace([' ', '-'], "_")
}

/// Byte ranges of the fields of a line, without spaces around them and without quotes.
pub(super) fn fields(source: Source<'_>, line: Range<usize>) -> Vec<Range<usize>> {
    let mut fields = Vec::new();
    split(source, line, &mut fields);
    fields
}

fn split(source: Source<'_>, line: Range<usize>, fields: &mut Vec<Range<usize>>) {
    let mut start = line.start;
    let mut quoted = false;
    for (offset, byte) in source.text[line.clone()].bytes().enumerate() {
        match byte {
            b'"' => quoted = !quoted,
            b',' if !quoted => {
                fields.push(bare(source.text, start..line.start + offset));
                start = line.start + offset + 1;
            }
            _ => {}
        }
    }
    fields.push(bare(source.text, start..line.end));
}

fn bare(text: &str, field: Range<usize>) -> Range<usize> {
    let trim = |field: Range<usize>| {
        let inner = &text[field.clone()];
        let start = field.start + (inner.len() - inner.trim_start().len());
        start..start + inner.trim().len()
    };
    let field = trim(field);
    let inner = &text[field.clone()];
    if inner.len() >= 2 && inner.starts_with('"') && inner.ends_with('"') {
        trim(field.start + 1..field.end - 1)
    } else {
        field
    }
}

/// The column that is probably meant by a name: of the same quantity in another unit, or spelt
/// nearly the same.
fn alike<'a>(name: &str, found: &[(usize, &'a str)]) -> Option<(usize, &'a str)> {
    let stem = |name: &str| {
        name.split('_')
            .next()
            .unwrap_or_default()
            .to_ascii_lowercase()
    };
    let same_quantity = found
        .iter()
        .find(|(_, found)| stem(found) == stem(name))
        .copied();
    same_quantity.or_else(|| {
        let nearest = nearest(name, found.iter().map(|&(_, found)| found))?;
        found.iter().find(|&&(_, found)| found == nearest).copied()
    })
}

fn unit_advice(name: &str, found: &str) -> String {
    let convert = |what: &str| format!("convert {what} and name the column `{name}`");
    let unit = |name: &str| name.rsplit('_').next().unwrap_or_default().to_owned();
    let (expected, unit) = (unit(name), unit(found));
    // Lengths are commands of drives that shift, angles of those that turn.
    let is_of_other_drives = name.starts_with('q')
        && ["rad", "deg"].contains(&expected.as_str()) != ["rad", "deg"].contains(&unit.as_str());
    match unit.as_str() {
        "m" | "mm" | "rad" | "deg" if is_of_other_drives => {
            "the drives of this robot are others: name the robot that was measured, with `--model` or \
             `robot = \"NAME\"` in robot.toml"
                .to_owned()
        }
        "mm" => convert("millimetres to metres"),
        "deg" => convert("degrees to radians"),
        _ => format!("name the column `{name}`"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_counted_by_their_fields() {
        let text = "a,b\n1,2\n\n\"3\", 4\n5\n6,7";
        let mut mistakes = Mistakes::new(Source::new("table.csv", text));
        let table = Table::parse(&mut mistakes).expect("a table");
        assert_eq!((table.rows(), mistakes.len()), (3, 1));
        let row = |row| (table.line(row), table.text(row, 0), table.text(row, 1));
        assert_eq!(
            [0, 1, 2].map(row),
            [(2, "1", "2"), (4, "3", "4"), (6, "6", "7")]
        );
    }

    /// As many fields as a million lines of as many would have do not fit in memory.
    #[test]
    fn many_columns_over_many_blank_lines_take_no_more_memory_than_the_text() {
        const MANY: usize = 1_000_000;
        let text = format!("a{}{}", ",".repeat(MANY), "\n".repeat(MANY));
        let mut mistakes = Mistakes::new(Source::new("table.csv", &text));
        assert!(Table::parse(&mut mistakes).is_none());
        assert_eq!(mistakes.len(), 1);
    }
}

//! Figures and tables as HTML.

use maud::{Markup, PreEscaped, html};

use super::figures::Figure;
use super::table::{Cell, Table};

/// A part of the report, with the name that links point to, and the parts of it that have names of their own.
pub(super) struct Section {
    pub(super) id: &'static str,
    pub(super) title: &'static str,
    pub(super) body: Markup,
    pub(super) parts: Vec<(String, &'static str)>,
}

impl Section {
    pub(super) fn new(id: &'static str, title: &'static str, body: Markup) -> Self {
        Self {
            id,
            title,
            body,
            parts: vec![],
        }
    }
}

/// The figure of this file name, where there is one.
pub(super) fn figure(figures: &[Figure], file_name: &str) -> Markup {
    let found = figures.iter().find(|figure| figure.file_name == file_name);
    html! {
        @if let Some(found) = found {
            figure aria-label=(found.title) {
                div.scroll tabindex="0" role="region" aria-label=(found.title) { (PreEscaped(&found.svg)) }
                figcaption {
                    (found.caption)
                }
            }
        }
    }
}

/// A sentence, what stands between backticks as code, and codes of messages subdued.
pub(super) fn prose(text: &str) -> Markup {
    html! {
        @for (index, part) in text.split('`').enumerate() {
            @if index % 2 == 1 { code { (part) } } @else { (coded(part)) }
        }
    }
}

/// A text with the codes of messages, such as `[T302]`, subdued.
fn coded(text: &str) -> Markup {
    let mut parts = text.split(" [T");
    html! {
        (parts.next().unwrap_or_default())
        @for part in parts {
            @match part.split_once(']') {
                Some((number, rest)) if number.parse::<u16>().is_ok() => {
                    " " span.message-code { "[T" (number) "]" } (rest)
                }
                _ => { " [T" (part) }
            }
        }
    }
}

/// A table with its headings in one or two rows.
pub(super) fn table(table: &Table, class: &str) -> Markup {
    let grouped = table.columns.iter().any(|column| !column.group.is_empty());
    let has_parts = table.rows.iter().any(|row| continues(row));
    let numeric = |index: usize| {
        !table
            .rows
            .iter()
            .any(|row| matches!(row.get(index), Some(Cell::Text(_))))
    };
    let first =
        |index: usize| index > 0 && table.columns[index].group != table.columns[index - 1].group;
    html! {
        div.scroll tabindex="0" role="region" aria-label=(table.title) {
            table class=(class) {
                caption { (table.title) }
                thead {
                    @if grouped { tr { (group_headings(table, numeric)) } }
                    tr {
                        @for (index, column) in table.columns.iter().enumerate() {
                            @if !grouped || !column.group.is_empty() {
                                th.number[numeric(index)].first[first(index)] scope="col" { (column.name) }
                            }
                        }
                    }
                }
                @for rows in table.rows.chunk_by(|_, next| !has_parts || continues(next)) {
                    tbody {
                        @for row in rows {
                            tr {
                                @for (index, cell) in row.iter().enumerate() {
                                    @if index == 0 { th scope="row" { (cell_markup(cell)) } }
                                    @else { td.number[numeric(index)].first[first(index)] { (cell_markup(cell)) } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

/// True if a row has no name and belongs to the one above it: no page should part them.
fn continues(row: &[Cell]) -> bool {
    matches!(row.first(), Some(Cell::Text(name)) if name.is_empty())
}

/// The upper row of headings: groups over their columns, and single columns over both rows.
fn group_headings(table: &Table, numeric: impl Fn(usize) -> bool) -> Markup {
    let columns = &table.columns;
    let mut start = 0;
    let mut headings = Vec::new();
    while start < columns.len() {
        let group = &columns[start].group;
        let alike = columns[start..]
            .iter()
            .take_while(|column| column.group == *group)
            .count();
        let span = if group.is_empty() { 1 } else { alike };
        headings.push((start, span));
        start += span;
    }
    html! {
        @for (start, span) in headings {
            @if columns[start].group.is_empty() {
                th.number[numeric(start)].first[start > 0 && columns[start - 1].group != columns[start].group] scope="col" rowspan="2" { (columns[start].name) }
            } @else {
                th.group.first[start > 0] scope="colgroup" colspan=(span) { (columns[start].group) }
            }
        }
    }
}

fn cell_markup(cell: &Cell) -> Markup {
    match cell {
        Cell::Text(text) => html! { (text) },
        Cell::Number(number) => number_markup(number),
        Cell::Empty => html! { span.none { "–" } },
    }
}

/// A number with a typographic minus sign and powers of ten, its standard deviation apart.
pub(super) fn number_markup(number: &str) -> Markup {
    let minus = |text: &str| text.replace('-', "\u{2212}");
    match number.split_once('e') {
        Some((mantissa, exponent)) => html! { (minus(mantissa)) "·10" sup { (minus(exponent)) } },
        None if number == "inf" => html! { "∞" },
        None => match number.split_once('(') {
            Some((value, sigma)) => html! { (minus(value)) span.sigma { "(" (sigma) } },
            None => html! { (minus(number)) },
        },
    }
}

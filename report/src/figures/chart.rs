//! The drawing layer of all figures: sheet, panels, axes, marks, legend and palette.
//!
//! Lengths are in units of 1/96 inch, so that a figure of [`WIDTH`] fills the text width of an A4 page
//! and a type size of 11 prints as 8 points.

use std::cell::{Cell, RefCell};
use std::fmt::{self, Write as _};

use super::Figure;
use super::axis::Axis;
use super::cells;
pub(super) use super::palette::{ACCENT, INK, Marker, PALE, STRONG, Style, series};
use super::palette::{Color, FRAME, GRID, PAPER, SOFT_INK};
use crate::number::printable;

/// Width of every figure.
pub(super) const WIDTH: f64 = 680.0;
/// Coordinates are whole numbers, so many a unit that curves stay smooth.
const SCALE: f64 = 4.0;

/// A rectangle: left, top, width, height.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rect {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

/// Panels side by side and below each other, of equal size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grid {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Space around all panels: left, top, right, bottom.
    pub(super) margin: [f64; 4],
    pub(super) column_gap: f64,
    pub(super) row_gap: f64,
    pub(super) row_height: f64,
}

impl Grid {
    /// Panels below each other: their number, the space on the left and above, the gaps, and the height of a panel.
    pub(super) fn column(
        rows: usize,
        [left, top]: [f64; 2],
        row_gap: f64,
        row_height: f64,
    ) -> Self {
        Self {
            rows,
            columns: 1,
            margin: [left, top, 14.0, 44.0],
            column_gap: 0.0,
            row_gap,
            row_height,
        }
    }

    /// Height of the whole figure.
    pub(super) fn height(&self) -> f64 {
        let rows = self.rows.max(1) as f64;
        self.margin[1] + rows * self.row_height + (rows - 1.0) * self.row_gap + self.margin[3]
    }

    /// Place of one panel.
    pub(super) fn cell(&self, row: usize, column: usize) -> Rect {
        let columns = self.columns.max(1) as f64;
        let inner = WIDTH - self.margin[0] - self.margin[2] - (columns - 1.0) * self.column_gap;
        let width = inner / columns;
        Rect {
            left: self.margin[0] + column as f64 * (width + self.column_gap),
            top: self.margin[1] + row as f64 * (self.row_height + self.row_gap),
            width,
            height: self.row_height,
        }
    }
}

/// Position of a text relative to its point.
#[derive(Debug, Clone, Copy)]
pub(super) enum Anchor {
    Left,
    Centre,
    Right,
}

/// A drawn figure.
pub(super) struct Drawn {
    title: String,
    /// The SVG document.
    svg: String,
    note: &'static str,
}

impl Drawn {
    /// With the name of its file and its caption; a sentence is added where marks gave way to shaded cells.
    pub(super) fn figure(self, file_name: impl Into<String>, caption: impl Into<String>) -> Figure {
        Figure {
            file_name: file_name.into(),
            title: self.title,
            caption: caption.into() + self.note,
            svg: self.svg,
        }
    }
}

/// A sheet to draw on.
#[derive(Default)]
pub(super) struct Sheet {
    /// Elements of SVG, a line each.
    elements: RefCell<String>,
    /// True once marks have given way to cells.
    has_cells: Cell<bool>,
}

fn pixel(length: f64) -> i32 {
    (length * SCALE).round() as i32
}

/// Draws a figure with its title.
pub(super) fn draw(
    title: &str,
    subtitle: &str,
    height: f64,
    content: impl FnOnce(&Sheet),
) -> Drawn {
    let sheet = Sheet::default();
    sheet.bold(title, (6.0, 18.0), 15.0);
    sheet.write(subtitle, (6.0, 37.0), Anchor::Left, 12.0, SOFT_INK);
    content(&sheet);
    let has_cells = sheet.has_cells.get();
    let document = format!(
        concat!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{}\" height=\"{}\" ",
            "role=\"img\" font-family=\"Helvetica, Arial, sans-serif\" stroke-linejoin=\"round\">\n",
            "<title>{}</title>\n<desc>{}</desc>\n",
            "<rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n{}</svg>\n"
        ),
        pixel(WIDTH),
        pixel(height),
        WIDTH,
        height,
        escape(title),
        escape(subtitle),
        PAPER,
        sheet.elements.into_inner()
    );
    Drawn {
        title: title.to_owned(),
        svg: printable(&document),
        note: if has_cells { cells::NOTE } else { "" },
    }
}

/// Text as XML content.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

/// Estimated width of a text; the fonts that the reader has are not known here.
fn text_width(text: &str, size: f64) -> f64 {
    text.chars().count() as f64 * size * 0.54
}

/// Points as SVG writes them.
fn listed(points: &[(i32, i32)]) -> String {
    let points: Vec<String> = points.iter().map(|(x, y)| format!("{x},{y}")).collect();
    points.join(" ")
}

impl Sheet {
    fn put(&self, element: fmt::Arguments<'_>) {
        let _ = writeln!(self.elements.borrow_mut(), "{element}");
    }

    fn text(
        &self,
        text: &str,
        at: (f64, f64),
        anchor: Anchor,
        size: f64,
        style: fmt::Arguments<'_>,
    ) {
        let (x, y, size) = (pixel(at.0), pixel(at.1), pixel(size));
        let anchor = match anchor {
            Anchor::Left => "start",
            Anchor::Centre => "middle",
            Anchor::Right => "end",
        };
        self.put(format_args!(
            "<text x=\"{x}\" y=\"{y}\" dy=\"0.5ex\" text-anchor=\"{anchor}\" font-size=\"{size}\" {style}>{}</text>",
            escape(text)
        ));
    }

    fn write(&self, text: &str, at: (f64, f64), anchor: Anchor, size: f64, color: Color) {
        self.text(text, at, anchor, size, format_args!("fill=\"{color}\""));
    }

    fn bold(&self, text: &str, at: (f64, f64), size: f64) {
        let style = format_args!("fill=\"{INK}\" font-weight=\"bold\"");
        self.text(text, at, Anchor::Left, size, style);
    }

    fn write_upwards(&self, text: &str, at: (f64, f64)) {
        let (x, y) = (pixel(at.0), pixel(at.1));
        let style = format_args!("fill=\"{INK}\" transform=\"rotate(270, {x}, {y})\"");
        self.text(text, at, Anchor::Centre, 12.0, style);
    }

    /// The marks of series with their names in a row, right-aligned; wraps where it is too long.
    pub(super) fn legend<'n>(&self, names: impl Iterator<Item = &'n str>) {
        let width = |name: &str| 20.0 + text_width(name, 12.0) + 12.0;
        let names: Vec<&str> = names.collect();
        let total: f64 = names.iter().map(|name| width(name)).sum();
        let mut x = (WIDTH - total).max(10.0);
        let mut y = 58.0;
        for (index, name) in names.into_iter().enumerate() {
            if x + width(name) > WIDTH && x > 10.0 {
                x = 10.0;
                y += 16.0;
            }
            self.mark((pixel(x + 7.0), pixel(y)), series(index), 3.6);
            self.write(name, (x + 16.0, y), Anchor::Left, 12.0, INK);
            x += width(name);
        }
    }

    /// Filled boxes with names, right-aligned.
    pub(super) fn box_legend(&self, entries: &[(&str, Color)]) {
        let y = 58.0;
        let width = |name: &str| 20.0 + text_width(name, 12.0) + 12.0;
        let total: f64 = entries.iter().map(|(name, _)| width(name)).sum();
        let mut x = (WIDTH - total).max(10.0);
        for (name, color) in entries {
            let corners = [(x, y - 5.0), (x + 12.0, y + 5.0)].map(|(x, y)| (pixel(x), pixel(y)));
            self.rectangle(corners, format_args!("fill=\"{color}\""));
            self.write(name, (x + 17.0, y), Anchor::Left, 12.0, INK);
            x += width(name);
        }
    }

    /// A filled rectangle between two corners in pixels, the upper left one first.
    fn rectangle(&self, [(left, top), (right, bottom)]: [(i32, i32); 2], fill: fmt::Arguments<'_>) {
        let (width, height) = (right - left, bottom - top);
        self.put(format_args!(
            "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" {fill}/>"
        ));
    }

    fn path(&self, points: &[(i32, i32)], color: Color, width: f64) {
        let (width, points) = (pixel(width), listed(points));
        self.put(format_args!(
            "<polyline fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" points=\"{points}\"/>"
        ));
    }

    fn mark(&self, (x, y): (i32, i32), Style { color, marker }: Style, radius: f64) {
        let r = pixel(radius);
        let stroke = 1.4;
        let circle = |style: fmt::Arguments<'_>| {
            self.put(format_args!(
                "<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\" {style}/>"
            ));
        };
        let polygon = |corners: &[(i32, i32)]| {
            let points = listed(corners);
            self.put(format_args!(
                "<polygon fill=\"{color}\" points=\"{points}\"/>"
            ));
        };
        match marker {
            Marker::Disc => circle(format_args!("fill=\"{color}\"")),
            Marker::Ring => circle(format_args!(
                "fill=\"none\" stroke=\"{color}\" stroke-width=\"{}\"",
                pixel(stroke)
            )),
            Marker::Square => {
                let half = r * 9 / 10;
                let corners = [(x - half, y - half), (x + half, y + half)];
                self.rectangle(corners, format_args!("fill=\"{color}\""));
            }
            Marker::Triangle => {
                polygon(&[(x - r, y + r * 8 / 10), (x + r, y + r * 8 / 10), (x, y - r)]);
            }
            Marker::Diamond => {
                let tip = r * 12 / 10;
                polygon(&[(x - tip, y), (x, y - tip), (x + tip, y), (x, y + tip)]);
            }
            Marker::Cross => {
                self.path(&[(x - r, y - r), (x + r, y + r)], color, stroke);
                self.path(&[(x - r, y + r), (x + r, y - r)], color, stroke);
            }
        }
    }

    /// Draws the frame, grid lines, ticks and names of a panel. Tick labels and names of an axis are
    /// left out where a neighbour that shares the axis has them.
    pub(super) fn panel(&self, place: Rect, x: &Axis, y: &Axis, show: Show) -> Panel<'_> {
        let (left, top) = (place.left, place.top);
        let (right, bottom) = (left + place.width, top + place.height);
        let panel = Panel {
            sheet: self,
            ranges: [x.range, y.range],
            place,
        };
        for (value, label) in &x.ticks {
            let (at, _) = panel.at(*value, y.range.0);
            if x.grid {
                self.path(&[(at, pixel(top)), (at, pixel(bottom))], GRID, 0.75);
            }
            if show.x {
                let at = f64::from(at) / SCALE;
                self.write(label, (at, bottom + 11.0), Anchor::Centre, 11.0, INK);
            }
        }
        for (value, label) in &y.ticks {
            let (_, at) = panel.at(x.range.0, *value);
            if y.grid {
                self.path(&[(pixel(left), at), (pixel(right), at)], GRID, 0.75);
            }
            if show.y {
                let at = f64::from(at) / SCALE;
                self.write(label, (left - 6.0, at), Anchor::Right, 11.0, INK);
            }
        }
        if y.grid && y.range.0 < 0.0 && y.range.1 > 0.0 {
            let (_, zero) = panel.at(x.range.0, 0.0);
            self.path(&[(pixel(left), zero), (pixel(right), zero)], FRAME, 0.75);
        }
        let corners = [
            (left, top),
            (right, top),
            (right, bottom),
            (left, bottom),
            (left, top),
        ];
        self.path(&corners.map(|(x, y)| (pixel(x), pixel(y))), FRAME, 0.75);
        if show.x && !x.name.is_empty() {
            let centre = left + place.width / 2.0;
            let at = (centre, bottom + 29.0);
            self.write(&x.name, at, Anchor::Centre, 12.0, INK);
        }
        if show.y && !y.name.is_empty() {
            self.write_upwards(&y.name, (14.0, top + place.height / 2.0));
        }
        panel
    }
}

/// Axes of a panel that carry labels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Show {
    x: bool,
    y: bool,
}

impl Show {
    /// Both axes.
    pub(super) const BOTH: Self = Self::new(true, true);

    pub(super) const fn new(x: bool, y: bool) -> Self {
        Self { x, y }
    }
}

/// A pair of axes to draw data on. What is not finite is left out.
pub(super) struct Panel<'s> {
    sheet: &'s Sheet,
    /// Lowest and highest value along x and y.
    ranges: [(f64, f64); 2],
    place: Rect,
}

impl Panel<'_> {
    fn at(&self, x: f64, y: f64) -> (i32, i32) {
        let share = |value: f64, (low, high): (f64, f64)| (value - low) / (high - low);
        let Rect {
            left,
            top,
            width,
            height,
        } = self.place;
        (
            pixel(left + width * share(x, self.ranges[0])),
            pixel(top + height * (1.0 - share(y, self.ranges[1]))),
        )
    }

    /// A bold name in the panel's upper left corner, above its frame.
    pub(super) fn title(&self, text: &str) {
        let at = (self.place.left, self.place.top - 9.0);
        self.sheet.bold(text, at, 12.0);
    }

    /// A remark in the upper right corner, above the frame.
    pub(super) fn remark(&self, text: &str) {
        let at = (self.place.left + self.place.width, self.place.top - 9.0);
        self.sheet.write(text, at, Anchor::Right, 11.0, SOFT_INK);
    }

    /// A mark at each point; cells that are shaded by the number of points in them, where marks would cover each other.
    pub(super) fn marks(
        &self,
        points: impl IntoIterator<Item = (f64, f64)>,
        style: Style,
        radius: f64,
    ) {
        let points: Vec<(i32, i32)> = points
            .into_iter()
            .filter(|(x, y)| x.is_finite() && y.is_finite())
            .map(|(x, y)| self.at(x, y))
            .collect();
        if cells::are_needed(points.len(), radius, self.place.width * self.place.height) {
            self.sheet.has_cells.set(true);
            for bar in cells::shaded(&points, pixel(2.0 * radius)) {
                let (color, shade) = (style.color, bar.shade);
                let fill = format_args!("opacity=\"{shade}\" fill=\"{color}\"");
                self.sheet.rectangle(bar.corners, fill);
            }
            return;
        }
        for point in points {
            self.sheet.mark(point, style, radius);
        }
    }

    /// A line through the points.
    pub(super) fn line(
        &self,
        points: impl IntoIterator<Item = (f64, f64)>,
        color: Color,
        width: f64,
    ) {
        let points: Vec<_> = points
            .into_iter()
            .filter(|(x, y)| x.is_finite() && y.is_finite())
            .map(|(x, y)| self.at(x, y))
            .collect();
        if points.len() > 1 {
            let points = cells::outlined(&points, pixel(0.5));
            self.sheet.path(&points, color, width);
        }
    }

    /// A filled rectangle between two corners in data coordinates.
    pub(super) fn bar(&self, from: (f64, f64), to: (f64, f64), color: Color) {
        if [from.0, from.1, to.0, to.1]
            .iter()
            .all(|value| value.is_finite())
        {
            let (a, b) = (self.at(from.0, from.1), self.at(to.0, to.1));
            let corners = [(a.0.min(b.0), a.1.min(b.1)), (a.0.max(b.0), a.1.max(b.1))];
            self.sheet
                .rectangle(corners, format_args!("fill=\"{color}\""));
        }
    }

    /// A text beside a point.
    pub(super) fn label(&self, text: &str, at: (f64, f64), anchor: Anchor, color: Color) {
        if at.0.is_finite() && at.1.is_finite() {
            let (x, y) = self.at(at.0, at.1);
            let shift = match anchor {
                Anchor::Left => 5.0,
                Anchor::Centre => 0.0,
                Anchor::Right => -5.0,
            };
            let at = (f64::from(x) / SCALE + shift, f64::from(y) / SCALE);
            self.sheet.write(text, at, anchor, 11.0, color);
        }
    }
}

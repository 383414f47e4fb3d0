//! The drawing layer of all figures: sheet, panels, axes, marks, legend and palette.
//!
//! Lengths are in units of 1/96 inch, so that a figure of [`WIDTH`] fills the text width of an A4 page
//! and a type size of 11 prints as 8 points.

use std::cell::Cell;

use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::types::RangedCoordf64;
use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::axis::Axis;
use super::cells;
pub(super) use super::palette::{ACCENT, INK, Marker, PALE, STRONG, Style, series};
use super::palette::{FRAME, GRID, PAPER, SOFT_INK};
use crate::number::printable;

/// Width of every figure.
pub(super) const WIDTH: f64 = 680.0;
/// The backend knows whole coordinates only; finer ones keep curves smooth.
const SCALE: f64 = 4.0;
/// The backend divides the size of a font by this.
const FONT_FACTOR: f64 = 1.24;

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

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A drawn figure.
pub(super) struct Drawn {
    /// The SVG document.
    pub(super) svg: String,
    /// A sentence for the caption, with a space before it, where marks gave way to shaded cells.
    pub(super) note: &'static str,
}

/// A sheet to draw on. Drawing into memory cannot fail, so results of the backend are dropped.
pub(super) struct Sheet<'a> {
    area: Area<'a>,
    /// True once marks have given way to cells.
    has_cells: Cell<bool>,
}

fn pixel(length: f64) -> i32 {
    (length * SCALE).round() as i32
}

/// Draws a figure with its title and returns the SVG document.
pub(super) fn draw(
    title: &str,
    subtitle: &str,
    height: f64,
    content: impl FnOnce(&Sheet),
) -> Drawn {
    let mut buffer = String::new();
    let size = (pixel(WIDTH).unsigned_abs(), pixel(height).unsigned_abs());
    let sheet = Sheet {
        area: SVGBackend::with_string(&mut buffer, size).into_drawing_area(),
        has_cells: Cell::new(false),
    };
    sheet.write(title, (6.0, 18.0), Anchor::Left, 15.0, INK, true);
    sheet.write(subtitle, (6.0, 37.0), Anchor::Left, 12.0, SOFT_INK, false);
    content(&sheet);
    let _ = sheet.area.present();
    let note = if sheet.has_cells.get() {
        cells::NOTE
    } else {
        ""
    };
    drop(sheet);
    Drawn {
        svg: document(&buffer, title, subtitle, height),
        note,
    }
}

/// Replaces the backend's root element by one with title and description, scaled to its natural size,
/// and leaves out attributes that say what is the default anyway. Text is escaped, so that no pattern
/// with a quotation mark occurs in it.
fn document(drawn: &str, title: &str, subtitle: &str, height: f64) -> String {
    let body = drawn.split_once('\n').map_or("", |(_, rest)| rest);
    let body = body.trim_end().strip_suffix("</svg>").unwrap_or(body);
    let body = body
        .replace(" opacity=\"1\"", "")
        .replace(" stroke=\"none\" stroke-width=\"1\"", "")
        .replace(" stroke=\"none\"", "")
        .replace(" font-family=\"sans-serif\"", "")
        .replace(" \"/>", "\"/>")
        .replace("\">\n", "\">")
        .replace("\n</text>", "</text>");
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
        format_args!("#{:02X}{:02X}{:02X}", PAPER.0, PAPER.1, PAPER.2),
        body
    );
    printable(&document)
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

impl<'a> Sheet<'a> {
    fn style(size: f64, color: RGBColor, bold: bool) -> TextStyle<'static> {
        let weight = if bold {
            FontStyle::Bold
        } else {
            FontStyle::Normal
        };
        let size = (size * SCALE * FONT_FACTOR * 100.0).round() / 100.0;
        FontDesc::new(FontFamily::SansSerif, size, weight).color(&color)
    }

    fn write(
        &self,
        text: &str,
        at: (f64, f64),
        anchor: Anchor,
        size: f64,
        color: RGBColor,
        bold: bool,
    ) {
        let horizontal = match anchor {
            Anchor::Left => HPos::Left,
            Anchor::Centre => HPos::Center,
            Anchor::Right => HPos::Right,
        };
        let style = Self::style(size, color, bold).pos(Pos::new(horizontal, VPos::Center));
        let _ = self
            .area
            .draw_text(text, &style, (pixel(at.0), pixel(at.1)));
    }

    fn write_upwards(&self, text: &str, at: (f64, f64)) {
        let style = Self::style(12.0, INK, false)
            .pos(Pos::new(HPos::Center, VPos::Center))
            .transform(FontTransform::Rotate270);
        let _ = self
            .area
            .draw_text(text, &style, (pixel(at.0), pixel(at.1)));
    }

    /// A row of marks with names, right-aligned at the height `y`; wraps where it is too long.
    pub(super) fn legend(&self, entries: &[(&str, Style)], y: f64) {
        let width = |name: &str| 20.0 + text_width(name, 12.0) + 12.0;
        let total: f64 = entries.iter().map(|(name, _)| width(name)).sum();
        let mut x = (WIDTH - total).max(10.0);
        let mut y = y;
        for (name, style) in entries {
            if x + width(name) > WIDTH && x > 10.0 {
                x = 10.0;
                y += 16.0;
            }
            self.mark((pixel(x + 7.0), pixel(y)), *style, 3.6);
            self.write(name, (x + 16.0, y), Anchor::Left, 12.0, INK, false);
            x += width(name);
        }
    }

    /// Filled boxes with names, right-aligned at the height `y`.
    pub(super) fn box_legend(&self, entries: &[(&str, RGBColor)], y: f64) {
        let width = |name: &str| 20.0 + text_width(name, 12.0) + 12.0;
        let total: f64 = entries.iter().map(|(name, _)| width(name)).sum();
        let mut x = (WIDTH - total).max(10.0);
        for (name, color) in entries {
            self.rectangle((x, y - 5.0), (x + 12.0, y + 5.0), *color);
            self.write(name, (x + 17.0, y), Anchor::Left, 12.0, INK, false);
            x += width(name);
        }
    }

    fn rectangle(&self, from: (f64, f64), to: (f64, f64), color: RGBColor) {
        let corners = [(pixel(from.0), pixel(from.1)), (pixel(to.0), pixel(to.1))];
        let _ = self.area.draw(&Rectangle::new(corners, color.filled()));
    }

    fn path(&self, points: Vec<(i32, i32)>, color: RGBColor, width: f64) {
        let style = color.stroke_width(pixel(width).unsigned_abs());
        let _ = self.area.draw(&PathElement::new(points, style));
    }

    fn mark(&self, (x, y): (i32, i32), style: Style, radius: f64) {
        let r = pixel(radius);
        let fill = style.color.filled();
        let _ = match style.marker {
            Marker::Disc => self.area.draw(&Circle::new((x, y), r, fill)),
            Marker::Ring => {
                let stroke = style.color.stroke_width(pixel(1.4).unsigned_abs());
                self.area.draw(&Circle::new((x, y), r, stroke))
            }
            Marker::Square => {
                let half = r * 9 / 10;
                let corners = [(x - half, y - half), (x + half, y + half)];
                self.area.draw(&Rectangle::new(corners, fill))
            }
            Marker::Triangle => {
                let corners = vec![(x - r, y + r * 8 / 10), (x + r, y + r * 8 / 10), (x, y - r)];
                self.area.draw(&Polygon::new(corners, fill))
            }
            Marker::Diamond => {
                let tip = r * 12 / 10;
                let corners = vec![(x - tip, y), (x, y - tip), (x + tip, y), (x, y + tip)];
                self.area.draw(&Polygon::new(corners, fill))
            }
            Marker::Cross => {
                let stroke = style.color.stroke_width(pixel(1.4).unsigned_abs());
                let _ = self.area.draw(&PathElement::new(
                    vec![(x - r, y - r), (x + r, y + r)],
                    stroke,
                ));
                self.area.draw(&PathElement::new(
                    vec![(x - r, y + r), (x + r, y - r)],
                    stroke,
                ))
            }
        };
    }

    /// Draws the frame, grid lines, ticks and names of a panel. Tick labels and names of an axis are
    /// left out where a neighbour that shares the axis has them.
    pub(super) fn panel<'s>(
        &'s self,
        place: Rect,
        x: &Axis,
        y: &Axis,
        show: Show,
    ) -> Panel<'s, 'a> {
        let (left, top) = (place.left, place.top);
        let (right, bottom) = (left + place.width, top + place.height);
        let coordinates = Cartesian2d::<RangedCoordf64, RangedCoordf64>::new(
            x.range.0..x.range.1,
            y.range.0..y.range.1,
            (pixel(left)..pixel(right), pixel(bottom)..pixel(top)),
        );
        let panel = Panel {
            sheet: self,
            coordinates,
            place,
        };
        for (value, label) in &x.ticks {
            let (at, _) = panel.at(*value, y.range.0);
            if x.grid {
                self.path(vec![(at, pixel(top)), (at, pixel(bottom))], GRID, 0.75);
            }
            if show.x {
                let at = f64::from(at) / SCALE;
                self.write(label, (at, bottom + 11.0), Anchor::Centre, 11.0, INK, false);
            }
        }
        for (value, label) in &y.ticks {
            let (_, at) = panel.at(x.range.0, *value);
            if y.grid {
                self.path(vec![(pixel(left), at), (pixel(right), at)], GRID, 0.75);
            }
            if show.y {
                let at = f64::from(at) / SCALE;
                self.write(label, (left - 6.0, at), Anchor::Right, 11.0, INK, false);
            }
        }
        if y.grid && y.range.0 < 0.0 && y.range.1 > 0.0 {
            let (_, zero) = panel.at(x.range.0, 0.0);
            self.path(vec![(pixel(left), zero), (pixel(right), zero)], FRAME, 0.75);
        }
        let corners = [
            (left, top),
            (right, top),
            (right, bottom),
            (left, bottom),
            (left, top),
        ];
        let frame = corners
            .iter()
            .map(|(x, y)| (pixel(*x), pixel(*y)))
            .collect();
        self.path(frame, FRAME, 0.75);
        if show.x && !x.name.is_empty() {
            let centre = left + place.width / 2.0;
            self.write(
                &x.name,
                (centre, bottom + 29.0),
                Anchor::Centre,
                12.0,
                INK,
                false,
            );
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
    pub(super) x: bool,
    pub(super) y: bool,
}

impl Show {
    /// Both axes.
    pub(super) const BOTH: Self = Self { x: true, y: true };
}

/// A pair of axes to draw data on. What is not finite is left out.
pub(super) struct Panel<'s, 'a> {
    sheet: &'s Sheet<'a>,
    coordinates: Cartesian2d<RangedCoordf64, RangedCoordf64>,
    place: Rect,
}

impl Panel<'_, '_> {
    fn at(&self, x: f64, y: f64) -> (i32, i32) {
        self.coordinates.translate(&(x, y))
    }

    /// A bold name in the panel's upper left corner, above its frame.
    pub(super) fn title(&self, text: &str) {
        let at = (self.place.left, self.place.top - 9.0);
        self.sheet.write(text, at, Anchor::Left, 12.0, INK, true);
    }

    /// A remark in the upper right corner, above the frame.
    pub(super) fn remark(&self, text: &str) {
        let at = (self.place.left + self.place.width, self.place.top - 9.0);
        self.sheet
            .write(text, at, Anchor::Right, 11.0, SOFT_INK, false);
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
                let fill = style.color.mix(bar.shade).filled();
                let _ = self.sheet.area.draw(&Rectangle::new(bar.corners, fill));
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
        color: RGBColor,
        width: f64,
    ) {
        let points: Vec<_> = points
            .into_iter()
            .filter(|(x, y)| x.is_finite() && y.is_finite())
            .map(|(x, y)| self.at(x, y))
            .collect();
        if points.len() > 1 {
            self.sheet
                .path(cells::outlined(&points, pixel(0.5)), color, width);
        }
    }

    /// A filled rectangle between two corners in data coordinates.
    pub(super) fn bar(&self, from: (f64, f64), to: (f64, f64), color: RGBColor) {
        if [from.0, from.1, to.0, to.1]
            .iter()
            .all(|value| value.is_finite())
        {
            let (a, b) = (self.at(from.0, from.1), self.at(to.0, to.1));
            let corners = [(a.0.min(b.0), a.1.min(b.1)), (a.0.max(b.0), a.1.max(b.1))];
            let _ = self
                .sheet
                .area
                .draw(&Rectangle::new(corners, color.filled()));
        }
    }

    /// A text beside a point.
    pub(super) fn label(&self, text: &str, at: (f64, f64), anchor: Anchor, color: RGBColor) {
        if at.0.is_finite() && at.1.is_finite() {
            let (x, y) = self.at(at.0, at.1);
            let shift = match anchor {
                Anchor::Left => 5.0,
                Anchor::Centre => 0.0,
                Anchor::Right => -5.0,
            };
            let at = (f64::from(x) / SCALE + shift, f64::from(y) / SCALE);
            self.sheet.write(text, at, anchor, 11.0, color, false);
        }
    }
}

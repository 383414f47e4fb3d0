//! Colours and marks of all figures, and what the colours become where the reader's screen is dark.

/// A colour as SVG writes it.
pub(super) type Color = &'static str;

/// The ground of every figure.
pub(super) const PAPER: Color = "#FFFFFF";
pub(super) const INK: Color = "#22262B";
pub(super) const SOFT_INK: Color = "#555C66";
pub(super) const GRID: Color = "#E3E6EA";
pub(super) const FRAME: Color = "#8A919A";

/// Shape of a mark, so that series stay apart without colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Marker {
    Disc,
    Square,
    Triangle,
    Diamond,
    Ring,
    Cross,
}

/// Style of a series.
#[derive(Debug, Clone, Copy)]
pub(super) struct Style {
    pub(super) color: Color,
    pub(super) marker: Marker,
}

impl Style {
    pub(super) const fn new(color: Color, marker: Marker) -> Self {
        Self { color, marker }
    }
}

/// Colours by Okabe and Ito, told apart by all common kinds of colour vision.
const SERIES: [Style; 6] = [
    Style::new("#0072B2", Marker::Disc),
    Style::new("#D55E00", Marker::Square),
    Style::new("#009E73", Marker::Triangle),
    Style::new("#B05A8A", Marker::Diamond),
    Style::new("#E69F00", Marker::Ring),
    Style::new("#22262B", Marker::Cross),
];

/// Style of the series of this index; they repeat after the sixth.
pub(super) fn series(index: usize) -> Style {
    SERIES[index % SERIES.len()]
}

/// Fill of the bar that matters.
pub(super) const STRONG: Color = "#005A8F";
/// Fill of the bar behind it, lighter in grey too.
pub(super) const PALE: Color = "#5B9BC8";
/// Colour of what should catch the eye.
pub(super) const ACCENT: Color = "#C04A00";

/// Every colour with the one that takes its place on a dark ground: as far from that as the colour is from white.
const DARK: [(Color, &str); 13] = [
    (PAPER, "#14181d"),
    (INK, "#e4e7eb"),
    (SOFT_INK, "#a7b0bb"),
    (GRID, "#2b323a"),
    (FRAME, "#6b747f"),
    (SERIES[0].color, "#56b0e8"),
    (SERIES[1].color, "#f28b3c"),
    (SERIES[2].color, "#2fc79a"),
    (SERIES[3].color, "#dd8fbd"),
    (SERIES[4].color, "#f0b73a"),
    (STRONG, "#5cb3ea"),
    (PALE, "#3c76a1"),
    (ACCENT, "#ff9350"),
];

/// Rules of a page that redraw the figures in it for a dark screen. Figures in files of their own stay as they are.
pub(crate) fn dark_style() -> String {
    let rules = DARK.iter().flat_map(|(color, dark)| {
        ["fill", "stroke"]
            .map(|property| format!("figure svg [{property}=\"{color}\"]{{{property}:{dark}}}\n"))
    });
    let rules: String = rules.collect();
    format!("@media screen and (prefers-color-scheme: dark) {{\n{rules}}}\n")
}

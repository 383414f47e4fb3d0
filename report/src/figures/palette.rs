//! Colours and marks of all figures, and what the colours become where the reader's screen is dark.

use plotters::style::RGBColor;

/// The ground of every figure.
pub(super) const PAPER: RGBColor = RGBColor(0xff, 0xff, 0xff);
pub(super) const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
pub(super) const SOFT_INK: RGBColor = RGBColor(0x55, 0x5c, 0x66);
pub(super) const GRID: RGBColor = RGBColor(0xe3, 0xe6, 0xea);
pub(super) const FRAME: RGBColor = RGBColor(0x8a, 0x91, 0x9a);

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
    pub(super) color: RGBColor,
    pub(super) marker: Marker,
}

/// Colours by Okabe and Ito, told apart by all common kinds of colour vision.
const SERIES: [Style; 6] = [
    Style {
        color: RGBColor(0x00, 0x72, 0xb2),
        marker: Marker::Disc,
    },
    Style {
        color: RGBColor(0xd5, 0x5e, 0x00),
        marker: Marker::Square,
    },
    Style {
        color: RGBColor(0x00, 0x9e, 0x73),
        marker: Marker::Triangle,
    },
    Style {
        color: RGBColor(0xb0, 0x5a, 0x8a),
        marker: Marker::Diamond,
    },
    Style {
        color: RGBColor(0xe6, 0x9f, 0x00),
        marker: Marker::Ring,
    },
    Style {
        color: RGBColor(0x22, 0x26, 0x2b),
        marker: Marker::Cross,
    },
];

/// Style of the series of this index; they repeat after the sixth.
pub(super) fn series(index: usize) -> Style {
    SERIES[index % SERIES.len()]
}

/// Fill of the bar that matters.
pub(super) const STRONG: RGBColor = RGBColor(0x00, 0x5a, 0x8f);
/// Fill of the bar behind it, lighter in grey too.
pub(super) const PALE: RGBColor = RGBColor(0x5b, 0x9b, 0xc8);
/// Colour of what should catch the eye.
pub(super) const ACCENT: RGBColor = RGBColor(0xc0, 0x4a, 0x00);

/// Every colour with the one that takes its place on a dark ground: as far from that as the colour is from white.
const DARK: [(RGBColor, &str); 13] = [
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
        ["fill", "stroke"].map(|property| {
            let RGBColor(red, green, blue) = color;
            format!(
                "figure svg [{property}=\"#{red:02X}{green:02X}{blue:02X}\"]{{{property}:{dark}}}\n"
            )
        })
    });
    let rules: String = rules.collect();
    format!("@media screen and (prefers-color-scheme: dark) {{\n{rules}}}\n")
}

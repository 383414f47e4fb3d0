//! The drawing as SVG. Every element carries its points in space, so that a script can turn it.

use maud::{Markup, PreEscaped, html};

use super::labels::{Name, Paper};
use super::scene::Scene;
use super::view::{Point, SIZE, View};
use crate::discovery::listed;
use crate::number::{general, printable};

/// Colours by name: those of the page, or what a drawing in a file of its own has instead.
const STYLE: &str = "\
.machine .rail{stroke:var(--rail,#9aa3ad);stroke-width:5;stroke-linecap:round;fill:none}\
.machine .base,.machine .plate{fill:var(--plate,#0072b2);fill-opacity:.14;stroke:var(--plate,#0072b2);stroke-width:1.6;stroke-linejoin:round}\
.machine .base{fill:var(--rail,#9aa3ad);stroke:var(--rail,#9aa3ad);fill-opacity:.2}\
.machine .cart{fill:var(--part,#2d3640);stroke:var(--part,#2d3640);stroke-width:9;stroke-linejoin:round;stroke-linecap:round}\
.machine .case{stroke:var(--paper,#fff);stroke-width:6.5;fill:none}\
.machine .link{stroke:var(--part,#2d3640);stroke-width:2.6;stroke-linecap:round;fill:none}\
.machine .driven{stroke:var(--part,#2d3640);stroke-width:7;stroke-linecap:butt;fill:none}\
.machine .joint{fill:var(--paper,#fff);stroke:var(--part,#2d3640);stroke-width:1.6}\
.machine .tcp{fill:var(--plate,#0072b2);stroke:var(--paper,#fff);stroke-width:1.5}\
.machine .dot{fill:var(--dot,#7b8590);fill-opacity:.6}\
.machine .needle{stroke:var(--needle,#c04a00);stroke-width:1.2;stroke-linecap:round;fill:none;stroke-opacity:.85}\
.machine .worst{stroke-width:2.6;stroke-opacity:1}\
.machine .axis{stroke:var(--soft,#555c66);stroke-width:1.4;fill:none}\
.machine text{font:13px \"Segoe UI\",\"Helvetica Neue\",Helvetica,Arial,\"Liberation Sans\",sans-serif;fill:var(--ink,#1d2126);\
dominant-baseline:central;stroke:var(--paper,#fff);stroke-width:3.5;stroke-linejoin:round;paint-order:stroke}\
.machine .minor,.machine .letter{fill:var(--soft,#555c66)}\
.machine .minor{font-size:11.5px}\
.machine .pin circle{fill:var(--pin,#a83f00);stroke:var(--paper,#fff);stroke-width:1.5}\
.machine .pin text{fill:var(--pin-ink,#fff);stroke:none;font-weight:700;font-size:12px;text-anchor:middle}";
/// Radius of a pin.
const PIN: f64 = 9.5;
/// Width and height of the corner, above on the right, where the page has buttons that turn the drawing.
const BUTTONS: [f64; 2] = [230.0, 44.0];
/// Place of the axes on the paper.
const CORNER: [f64; 2] = [62.0, SIZE[1] - 52.0];

/// The drawing, and what a caption has to say.
pub(crate) struct Drawing {
    /// The SVG document.
    pub(crate) svg: String,
    /// Reading of it, in sentences.
    pub(crate) caption: String,
}

/// Draws a machine.
pub(crate) fn draw(scene: &Scene<'_>, robot: &str) -> Drawing {
    let view = View::clearest(&scene.named(), &scene.points());
    let caption = caption(scene);
    let title = format!("{robot}, drawn from its calibrated geometry");
    let View {
        azimuth,
        elevation,
        centre: [x, y, z],
        scale,
    } = view;
    let svg = html! {
        svg.machine xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {} {}", SIZE[0], SIZE[1]))
            width=(SIZE[0]) height=(SIZE[1]) role="img" aria-label=(title)
            data-view=(format!("{azimuth:.5} {elevation:.5} {x:.4} {y:.4} {z:.4} {scale:.4} {} {}", CORNER[0], CORNER[1])) {
            title { (title) }
            desc { (caption) }
            style { (PreEscaped(STYLE)) }
            (parts(scene, &view))
            (names(scene, &view))
            (axes(scene, &view))
        }
    };
    Drawing {
        svg: printable(&svg.into_string()) + "\n",
        caption,
    }
}

fn parts(scene: &Scene<'_>, view: &View) -> Markup {
    let layout = scene.layout;
    let mut links: Vec<_> = layout.links.iter().collect();
    let middle = |ends: &[Point; 2]| view.depth(ends[0]) + view.depth(ends[1]);
    links.sort_by(|a, b| middle(&a.ends_m).total_cmp(&middle(&b.ends_m)));
    html! {
        g { @if layout.base_m.len() > 2 { (path("base", &layout.base_m, view, true)) } }
        g { @for rail in &layout.tracks { (path("rail", &rail.line_m, view, false)) } }
        g {
            @for dot in &scene.dots { (disc("dot", *dot, 1.7, view)) }
            @for needle in &scene.needles {
                (path(if needle.is_worst { "needle worst" } else { "needle" }, &[needle.from, needle.to], view, false))
            }
        }
        g {
            @for rail in &layout.tracks {
                @if let [only] = rail.joints_m.as_slice() { (path("cart", &[*only, *only], view, false)) }
                @else { (path("cart", &rail.joints_m, view, rail.joints_m.len() > 2)) }
            }
        }
        @if layout.plate_m.len() > 1 { g { (path("plate", &layout.plate_m, view, layout.plate_m.len() > 2)) } }
        g.sorted {
            @for rod in links {
                g {
                    (path("case", &rod.ends_m, view, false))
                    (path("link", &rod.ends_m, view, false))
                    @if rod.driven_by.is_some() { (path("driven", &cylinder(rod.ends_m), view, false)) }
                    (disc("joint", rod.ends_m[0], 3.2, view))
                    (disc("joint", rod.ends_m[1], 3.2, view))
                }
            }
        }
        (disc("tcp", layout.tcp_m, 4.6, view))
    }
}

/// The thick part of a link of driven length.
fn cylinder([base, plate]: [Point; 2]) -> [Point; 2] {
    let at = |share: f64| [0, 1, 2].map(|axis| base[axis] + share * (plate[axis] - base[axis]));
    [at(0.06), at(0.5)]
}

fn names(scene: &Scene<'_>, view: &View) -> Markup {
    let layout = scene.layout;
    let mut paper = Paper::new(view);
    let [width, height] = BUTTONS;
    paper.take_frame([SIZE[0] - width, 0.0, SIZE[0], height]);
    let pins = pins(scene, view, &mut paper);
    for rod in &layout.links {
        for end in rod.ends_m {
            paper.take(view.project(end), 5.0);
        }
    }
    let mut found: Vec<Name> = Vec::new();
    for rail in &layout.tracks {
        let ends = [rail.line_m.first(), rail.line_m.last()];
        let mut ends: Vec<Point> = ends.into_iter().flatten().copied().collect();
        // The end that is farther from the arm has more room.
        let [tx, ty] = view.project(layout.tcp_m);
        let distance = |point: &Point| {
            let [x, y] = view.project(*point);
            (x - tx).hypot(y - ty)
        };
        ends.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        found.extend(paper.place(
            "part",
            &format!("{} {}", kind(rail.is_crank), rail.name),
            &ends,
        ));
    }
    let tool = [layout.tcp_m];
    found.extend(paper.place("part", "TCP", &tool));
    for rod in &layout.links {
        let [a, b] = rod.ends_m;
        let along: Vec<Point> = [0.5, 0.4, 0.6, 0.3, 0.7, 0.22, 0.78]
            .map(|share| [0, 1, 2].map(|axis| a[axis] + share * (b[axis] - a[axis])))
            .into();
        found.extend(paper.place("minor", &rod.name, &along));
    }
    html! {
        g { @for name in &found { (text(name, view)) } }
        g { (pins) }
    }
}

/// Numbers beside the places where they act; those of one place side by side.
fn pins(scene: &Scene<'_>, view: &View, paper: &mut Paper<'_>) -> Markup {
    let mut placed: Vec<(Point, usize)> = Vec::new();
    let pins: Vec<(usize, Point, f64)> = (scene.pins.iter())
        .map(|&(number, at)| {
            let here = placed.iter_mut().find(|(other, _)| *other == at);
            let before = match here {
                Some((_, count)) => {
                    *count += 1;
                    *count - 1
                }
                None => {
                    placed.push((at, 1));
                    0
                }
            };
            (number, at, 2.6 * PIN * before as f64)
        })
        .collect();
    let up = 2.0 * PIN;
    for &(_, at, aside) in &pins {
        let [x, y] = view.project(at);
        paper.take([x + aside, y - up], PIN + 1.0);
    }
    html! {
        @for (number, at, aside) in &pins {
            @let [x, y] = view.project(*at);
            g.pin data-p=(space(&[*at])) data-shift=(format!("{aside:.1} {:.1}", -up))
                transform=(format!("translate({:.1} {:.1})", x + aside, y - up)) {
                circle r=(PIN) {}
                text { (number) }
            }
        }
    }
}

/// Directions of the measurement frame with a length, in a corner.
fn axes(scene: &Scene<'_>, view: &View) -> Markup {
    let length = scene.axes_m;
    if !length.is_finite() {
        return html! {};
    }
    let corner = |point: Point| {
        let [x, y] = view.project([0, 1, 2].map(|k| view.centre[k] + point[k]));
        [x - 0.5 * SIZE[0] + CORNER[0], y - 0.5 * SIZE[1] + CORNER[1]]
    };
    html! {
        g.axes {
            @for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                @let end = { let mut end = [0.0; 3]; end[axis] = length; end };
                @let tip = end.map(|value| 1.25 * value);
                @let [[x0, y0], [x1, y1], [xt, yt]] = [[0.0; 3], end, tip].map(corner);
                path.axis data-p=(space(&[[0.0; 3], end])) d=(format!("M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}")) {}
                text.letter data-p=(space(&[tip])) x=(format!("{xt:.1}")) y=(format!("{yt:.1}")) text-anchor="middle" { (name) }
            }
        }
    }
}

fn text(name: &Name, view: &View) -> Markup {
    let [x, y] = view.project(name.at);
    html! {
        text class=(name.class) data-p=(space(&[name.at])) x=(format!("{x:.1}")) y=(format!("{y:.1}"))
            dx=(name.shift[0]) dy=(name.shift[1]) text-anchor=(name.align.name()) { (name.text) }
    }
}

fn disc(class: &str, at: Point, radius: f64, view: &View) -> Markup {
    let [x, y] = view.project(at);
    html! { circle class=(class) data-p=(space(&[at])) cx=(format!("{x:.1}")) cy=(format!("{y:.1}")) r=(radius) {} }
}

fn path(class: &str, points: &[Point], view: &View, closed: bool) -> Markup {
    let mut line = String::new();
    for (index, &point) in points.iter().enumerate() {
        let [x, y] = view.project(point);
        line += &format!("{}{x:.1} {y:.1}", if index == 0 { 'M' } else { 'L' });
    }
    if closed {
        line.push('Z');
    }
    html! { path class=(class) data-p=(space(points)) d=(line) {} }
}

/// Points in space (m), to a tenth of a millimetre.
fn space(points: &[Point]) -> String {
    let numbers = points.iter().flatten().map(|value| {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    });
    numbers.collect::<Vec<_>>().join(" ")
}

fn kind(is_crank: bool) -> &'static str {
    if is_crank { "crank" } else { "track" }
}

/// Reading of the drawing.
fn caption(scene: &Scene<'_>) -> String {
    let layout = scene.layout;
    let any = |is_crank: bool| layout.tracks.iter().any(|rail| rail.is_crank == is_crank);
    let has_base = !layout.base_m.is_empty() || layout.tracks.is_empty();
    let parts = [
        ("Joints", true),
        ("tracks", any(false)),
        ("carts", any(false)),
        ("cranks", any(true)),
        ("base", has_base),
        ("plate", !layout.plate_m.is_empty()),
        ("TCP", true),
    ];
    let drawn = parts.into_iter().filter(|(_, is_drawn)| *is_drawn);
    let drawn: Vec<&str> = drawn.map(|(part, _)| part).collect();
    let mut text = format!(
        "{} as the calibration of {} has them, in the middle of the measured commands",
        listed(&drawn),
        layout.variant
    );
    if scene.axes_m.is_finite() {
        text += &format!("; the axes are {} m long", general(scene.axes_m, 1));
    }
    text += if scene.are_estimated {
        ". Dots are poses as they were estimated"
    } else {
        ". Dots are measured poses"
    };
    let all = scene.poses;
    if scene.shown() > 0 {
        text += &format!(
            ", lines the errors of {}predicted poses, magnified {} times; the thick one is the largest",
            if scene.shown() == all {
                format!("all {all} ")
            } else {
                format!("{} of {all} ", scene.shown())
            },
            grouped(scene.factor)
        );
    }
    text.push('.');
    if scene.shown() < all {
        text += " Of poses that lie in one cell of space the one with the largest error is drawn.";
    }
    if scene.has_pins() {
        text += " Numbers are those of what was found, where it acts.";
    }
    text
}

/// A number with spaces between thousands.
fn grouped(value: f64) -> String {
    if value < 10_000.0 {
        return general(value, 1);
    }
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

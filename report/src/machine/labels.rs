//! Places of names on the paper: beside what they name, none on another.

use super::view::{Point, SIZE, View};

/// Type size.
pub(super) const TYPE: f64 = 13.0;
/// Width of a letter over the type size; the fonts that the reader has are not known here.
const LETTER: f64 = 0.56;

/// A name beside a point in space.
#[derive(Debug, Clone)]
pub(super) struct Name {
    pub(super) class: &'static str,
    pub(super) text: String,
    pub(super) at: Point,
    /// From the point's place on paper to the middle of the line of text.
    pub(super) shift: [f64; 2],
    pub(super) align: Align,
}

/// The part of a text that is at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Align {
    Start,
    Middle,
    End,
}

impl Align {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        }
    }
}

/// A rectangle of the paper: left, top, right, bottom.
type Frame = [f64; 4];

/// Room that is taken.
pub(super) struct Paper<'a> {
    view: &'a View,
    taken: Vec<Frame>,
}

impl<'a> Paper<'a> {
    pub(super) fn new(view: &'a View) -> Self {
        Self {
            view,
            taken: vec![],
        }
    }

    /// Keeps names off a disc about a place.
    pub(super) fn take(&mut self, [x, y]: [f64; 2], radius: f64) {
        self.taken
            .push([x - radius, y - radius, x + radius, y + radius]);
    }

    /// Keeps names off a rectangle: left, top, right, bottom.
    pub(super) fn take_frame(&mut self, frame: Frame) {
        self.taken.push(frame);
    }

    /// Puts a name beside one of some points, the first that leaves room, or else where it covers least.
    pub(super) fn place(
        &mut self,
        class: &'static str,
        text: &str,
        points: &[Point],
    ) -> Option<Name> {
        let names = points.iter().flat_map(|&at| {
            let sides = [
                ([9.0, -9.0], Align::Start),
                ([-9.0, -9.0], Align::End),
                ([9.0, 10.0], Align::Start),
                ([-9.0, 10.0], Align::End),
                ([0.0, -15.0], Align::Middle),
                ([0.0, 16.0], Align::Middle),
            ];
            sides.map(|(shift, align)| Name {
                class,
                text: text.to_owned(),
                at,
                shift,
                align,
            })
        });
        let scored = names.map(|name| {
            let frame = self.frame(&name);
            (self.covered(frame), frame, name)
        });
        // The first of those that cover least.
        let (_, frame, name) =
            scored.reduce(|best, next| if next.0 < best.0 { next } else { best })?;
        self.taken.push(frame);
        Some(name)
    }

    fn frame(&self, name: &Name) -> Frame {
        let [x, y] = self.view.project(name.at);
        let [x, y] = [x + name.shift[0], y + name.shift[1]];
        let width = LETTER * TYPE * name.text.chars().count() as f64;
        let left = match name.align {
            Align::Start => x,
            Align::Middle => x - 0.5 * width,
            Align::End => x - width,
        };
        [left, y - 0.5 * TYPE, left + width, y + 0.5 * TYPE]
    }

    /// Area of what a frame would cover, and of what is off the paper.
    fn covered(&self, frame: Frame) -> f64 {
        let area =
            |[left, top, right, bottom]: Frame| (right - left).max(0.0) * (bottom - top).max(0.0);
        let common = |other: &Frame| {
            area([
                frame[0].max(other[0]),
                frame[1].max(other[1]),
                frame[2].min(other[2]),
                frame[3].min(other[3]),
            ])
        };
        let inside = common(&[4.0, 4.0, SIZE[0] - 4.0, SIZE[1] - 4.0]);
        self.taken.iter().map(common).sum::<f64>() + area(frame) - inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_one_point_stand_beside_each_other() {
        let view = View::fitted(0.5, 0.4, &[[0.0; 3], [1.0; 3]]);
        let mut paper = Paper::new(&view);
        paper.take(view.project([0.5; 3]), 6.0);
        for text in ["one", "two", "three", "four"] {
            let before = paper.taken.clone();
            paper.place("part", text, &[[0.5; 3]]).unwrap();
            let [left, top, right, bottom] = *paper.taken.last().unwrap();
            for other in before {
                let apart =
                    right <= other[0] || left >= other[2] || bottom <= other[1] || top >= other[3];
                assert!(apart, "{text}");
            }
        }
        assert!(paper.place("part", "nowhere", &[]).is_none());
    }
}

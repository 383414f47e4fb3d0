//! The drawing against the geometry that it is of.

use roxmltree::{Document, Node};
use tau::discovery::results::Place;
use tau::evaluation::PoseError;

use super::view::{Point, SIZE, View};
use super::{Errors, Pin, Scene, draw};
use crate::tests::fixture;

fn errors() -> Vec<PoseError> {
    (0..40_u32)
        .map(|k| {
            let share = f64::from(k) / 40.0;
            PoseError {
                pose: k + 1,
                position_m: [
                    -1.5 + 0.4 * share,
                    -4.4 + 0.3 * (7.0 * share).sin(),
                    0.2 * share,
                ],
                error_um: [50.0 + f64::from(k), -20.0, 10.0],
                orientation_rad: None,
                sigma: None,
            }
        })
        .collect()
}

fn drawn() -> (String, String, f64) {
    let layout = fixture::layout();
    let poses = errors();
    let errors = Errors {
        poses: &poses,
        measured_m: poses.iter().map(|error| error.position_m).collect(),
        are_estimated: false,
    };
    let pins = [
        Pin {
            number: 1,
            place: Place::Cart("two".to_owned()),
        },
        Pin {
            number: 2,
            place: Place::Link("l3b".to_owned()),
        },
        Pin {
            number: 3,
            place: Place::AllCarts,
        },
    ];
    let scene = Scene::new(&layout, &errors, &pins);
    let drawing = draw(&scene, "Robot <&>");
    (drawing.svg, drawing.caption, scene.factor)
}

fn numbers(node: Node<'_, '_>, name: &str) -> Vec<f64> {
    let text = node.attribute(name).expect(name);
    text.split([' ', 'M', 'L', 'Z'])
        .filter(|number| !number.is_empty())
        .map(|number| number.parse().unwrap())
        .collect()
}

fn of_class<'a>(document: &'a Document<'a>, class: &str) -> Vec<Node<'a, 'a>> {
    let nodes = document.descendants();
    nodes
        .filter(|node| node.attribute("class") == Some(class))
        .collect()
}

/// The view that the drawing states.
fn view(document: &Document<'_>) -> View {
    let stated = numbers(document.root_element(), "data-view");
    let [azimuth, elevation, x, y, z, scale, ..] = stated[..] else {
        panic!("{stated:?}");
    };
    View {
        azimuth,
        elevation,
        centre: [x, y, z],
        scale,
    }
}

/// Every point on paper is that of its point in space, by the formula of the projection written out.
#[test]
fn what_stands_on_paper_is_what_stands_in_space() {
    let (svg, ..) = drawn();
    let document = Document::parse(&svg).unwrap();
    let stated = view(&document);
    let hand = |[x, y, z]: Point| {
        let [x, y, z] = [
            x - stated.centre[0],
            y - stated.centre[1],
            z - stated.centre[2],
        ];
        let (a, e) = (stated.azimuth, stated.elevation);
        let across = y * a.cos() - x * a.sin();
        let upwards = z * e.cos() - (x * a.cos() + y * a.sin()) * e.sin();
        [
            340.0 + stated.scale * across,
            235.0 - stated.scale * upwards,
        ]
    };
    let paths = document
        .descendants()
        .filter(|node| node.has_tag_name("path") && node.attribute("class") != Some("axis"));
    let mut count = 0;
    for path in paths {
        let space = numbers(path, "data-p");
        let paper = numbers(path, "d");
        assert_eq!(space.len() / 3, paper.len() / 2);
        for (point, place) in space.chunks(3).zip(paper.chunks(2)) {
            let expected = hand([point[0], point[1], point[2]]);
            // Written to a tenth of a unit, from tenths of a millimetre.
            for k in 0..2 {
                assert!(
                    (expected[k] - place[k]).abs() < 0.11,
                    "{expected:?} {place:?}"
                );
                assert!(
                    (0.0..=SIZE[k]).contains(&place[k]),
                    "{place:?} is on the paper"
                );
            }
            count += 1;
        }
    }
    assert!(count > 60, "{count}");
}

#[test]
fn every_link_ends_at_its_joints() {
    let (svg, ..) = drawn();
    let document = Document::parse(&svg).unwrap();
    let joints: Vec<Vec<f64>> = of_class(&document, "joint")
        .into_iter()
        .map(|joint| vec![numbers(joint, "cx")[0], numbers(joint, "cy")[0]])
        .collect();
    let layout = fixture::layout();
    let links = of_class(&document, "link");
    assert_eq!(links.len(), layout.links.len());
    assert_eq!(joints.len(), 2 * links.len());
    for link in links {
        let space = numbers(link, "data-p");
        let is_own = |ends: &[Point; 2]| {
            let ends = ends.as_flattened().iter();
            ends.zip(&space).all(|(a, b)| (a - b).abs() < 1e-4)
        };
        assert!(
            layout.links.iter().any(|rod| is_own(&rod.ends_m)),
            "{space:?}"
        );
        for end in numbers(link, "d").chunks(2) {
            assert!(joints.iter().any(|joint| joint == end), "{end:?}");
        }
    }
    // Nearer links come later and cover the rest.
    let view = view(&document);
    let depths: Vec<f64> = of_class(&document, "link")
        .into_iter()
        .map(|link| {
            let [ax, ay, az, bx, by, bz] = numbers(link, "data-p")[..] else {
                panic!()
            };
            view.depth([ax, ay, az]) + view.depth([bx, by, bz])
        })
        .collect();
    assert!(depths.is_sorted(), "{depths:?}");
}

#[test]
fn errors_are_magnified_by_the_factor_that_is_stated() {
    let (svg, caption, factor) = drawn();
    let document = Document::parse(&svg).unwrap();
    let worst = of_class(&document, "needle worst");
    assert_eq!(worst.len(), 1);
    let [x0, y0, z0, x1, y1, z1] = numbers(worst[0], "data-p")[..] else {
        panic!()
    };
    let last = errors().pop().unwrap();
    for (drawn, error) in [x1 - x0, y1 - y0, z1 - z0].iter().zip(last.error_um) {
        assert!(
            (drawn - 1e-6 * factor * error).abs() < 1.1e-4,
            "{drawn} {error}"
        );
    }
    let stated = caption.split("magnified ").nth(1).unwrap();
    let stated: String = stated
        .chars()
        .take_while(|c| *c != ' ')
        .filter(char::is_ascii_digit)
        .collect();
    assert_eq!(stated.parse::<f64>().unwrap(), factor);
}

#[test]
fn pins_stand_where_things_act_and_names_are_escaped() {
    let (svg, ..) = drawn();
    assert!(svg.contains("Robot &lt;&amp;&gt;"));
    let document = Document::parse(&svg).unwrap();
    let layout = fixture::layout();
    let found: Vec<(String, Vec<f64>)> = of_class(&document, "pin")
        .into_iter()
        .map(|pin| {
            let text = pin
                .children()
                .find(|node| node.has_tag_name("text"))
                .unwrap();
            (text.text().unwrap().to_owned(), numbers(pin, "data-p"))
        })
        .collect();
    assert_eq!(found.len(), 5, "one, one, and one for each cart");
    assert_eq!(found[0], ("1".to_owned(), layout.tracks[1].cart_m.to_vec()));
    let rod = &layout.links[4];
    for (k, value) in found[1].1.iter().enumerate() {
        assert!((value - 0.5 * (rod.ends_m[0][k] + rod.ends_m[1][k])).abs() < 1e-4);
    }
    // Those of one cart stand side by side.
    let shifts: Vec<Vec<f64>> = of_class(&document, "pin")
        .into_iter()
        .map(|pin| numbers(pin, "data-shift"))
        .collect();
    assert!(shifts[0][0] == 0.0 && shifts[3][0] > 20.0, "{shifts:?}");
}

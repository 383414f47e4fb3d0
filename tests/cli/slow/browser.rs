//! The report in a browser: layout, names for those who can't see it, contrast, and the drawing that turns.

use super::devtools::{Browser, absolute};

use serde_json::{Value, json};

use tau_testkit::{Work, list, number};

/// Text width of an A4 page with the margins of the style sheet: 180 mm at 96 pixels an inch.
const PAPER: u32 = 680;
/// The least contrast of text that can be read by all: WCAG 2.2, criterion 1.4.3.
const CONTRAST: f64 = 4.5;

/// Texts whose colour does not stand out from what is behind them, as [ratio, text].
const CONTRASTS: &str = include_str!("contrasts.js");

/// Elements that reach beyond the page and are in nothing that scrolls.
const OVERFLOWS: &str = include_str!("overflows.js");

/// A report, with the least number of figures and tables that it has.
struct Report {
    page: String,
    figures: u64,
    tables: u64,
}

/// Reports of three machines: the prototype with what was found, a linear delta, a hexapod; and of a delta whose poses were
/// not measured, of which the machine alone is drawn.
fn reports() -> (Work, Vec<Report>) {
    let work = Work::empty();
    work.run("study --quiet --out DIR/prototype").done();
    let heights = "--measure heights,distances --random --poses 80 --track-points 0 --cart-poses 0";
    for (name, model, more) in [
        ("delta", "linear_delta", ""),
        ("hexapod", "stewart", ""),
        ("heights", "linear_delta", heights),
    ] {
        let of = format!("--model ROBOTS/{model}.tau");
        let line = format!("simulate {of} --variant Full {more} --out DIR/{name}-data");
        work.run(&line).done();
        let line = format!("study DIR/{name}-data {of} --no-discover --quiet --out DIR/{name}");
        work.run(&line).done();
    }
    let report = |(name, figures)| Report {
        page: absolute(&work.path().join(name).join("report.html")),
        figures,
        tables: 6,
    };
    let reports = [
        ("prototype", 5),
        ("delta", 5),
        ("hexapod", 5),
        ("heights", 1),
    ];
    let reports = reports.map(report).into();
    (work, reports)
}

/// One test, because the browser and the studies take a while to get ready.
#[test]
fn reports_can_be_read_on_screens_and_on_paper() {
    let Some(mut browser) = Browser::start() else {
        return;
    };
    let (_work, reports) = reports();
    for report in &reports {
        let page = &report.page;
        for (width, media, scheme) in [
            (1024, "screen", "light"),
            (1024, "screen", "dark"),
            (390, "screen", "light"),
            (390, "screen", "dark"),
            (PAPER, "print", "light"),
        ] {
            let place = format!("{page} at {width}, {media}, {scheme}");
            browser.open(page, width, media, scheme);
            if media == "screen" {
                browser.evaluate(
                    "document.querySelectorAll('details').forEach((one) => (one.open = true))",
                );
            }
            fits(&mut browser, &place);
            stands_out(&mut browser, &place, scheme);
            assert_eq!(browser.complaints(), [""; 0], "{place}");
        }
        browser.open(page, 1024, "screen", "light");
        has_names(&mut browser, report);
        turns(&mut browser, page);
        unfolds_on_paper(&mut browser, page);
        assert_eq!(browser.complaints(), [""; 0], "{page}");
    }
}

fn fits(browser: &mut Browser, place: &str) {
    let found = browser.evaluate(OVERFLOWS);
    assert_eq!(found["found"], json!([]), "{place}");
    assert_eq!(found["page"], found["width"], "{place}");
}

fn stands_out(browser: &mut Browser, place: &str, scheme: &str) {
    let texts = browser.evaluate(CONTRASTS);
    let mut faint = list(&texts).to_vec();
    assert!(faint.len() > 300, "{place}: {} texts", faint.len());
    faint.retain(|text| number(&text[0]) < CONTRAST);
    assert!(faint.is_empty(), "{place}: {faint:?}");
    let ground = browser.evaluate("getComputedStyle(document.documentElement).backgroundColor");
    let is_white = ground == "rgb(255, 255, 255)";
    assert_eq!(is_white, scheme == "light", "{place}: {ground}");
}

/// Names as the browser tells them to programs that read aloud.
fn has_names(browser: &mut Browser, report: &Report) {
    let page = &report.page;
    browser.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))");
    let tree = browser.ask("Accessibility.getFullAXTree", &json!({}));
    let mut counts = std::collections::BTreeMap::new();
    for node in list(&tree["nodes"]) {
        let role = node["role"]["value"].as_str().unwrap_or_default();
        let asked = "image img figure button link table region DisclosureTriangle";
        if node["ignored"] == true || !asked.split(' ').any(|own| own == role) {
            continue;
        }
        let name = node["name"]["value"].as_str().unwrap_or_default();
        assert!(!name.trim().is_empty(), "{page}: {node:#}");
        *counts.entry(role.to_owned()).or_insert(0) += 1;
    }
    let drawings = browser.evaluate("document.querySelectorAll('svg').length");
    let images = counts.get("image").or(counts.get("img")).copied();
    assert_eq!(images, drawings.as_u64(), "{page}: {counts:?}");
    assert_eq!(counts.get("button"), Some(&5), "{page}: {counts:?}");
    assert!(
        counts["figure"] >= report.figures && counts["table"] >= report.tables,
        "{page}: {counts:?}"
    );
}

/// The drawing turns by mouse and by button, and comes back to what it was.
fn turns(browser: &mut Browser, page: &str) {
    let state = "[...document.querySelectorAll('svg.machine [data-p]')].map((e) => \
                 ['d', 'cx', 'cy', 'x', 'y', 'transform'].map((name) => e.getAttribute(name)).join())";
    let at_first = browser.evaluate(state);
    let press =
        |value: &str| format!("document.querySelector('.turn button[value={value}]').click()");
    browser.evaluate(&press("left"));
    let turned = browser.evaluate(state);
    assert_ne!(turned, at_first, "{page}");
    browser.evaluate(&press("reset"));
    let back = browser.evaluate(state);
    close(&back, &at_first, page);
    for (kind, x) in [("Pressed", 250), ("Moved", 320), ("Released", 320)] {
        let top = "document.querySelector('svg.machine').getBoundingClientRect().top + 200";
        let (kind, y) = (format!("mouse{kind}"), browser.evaluate(top));
        let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
        browser.ask("Input.dispatchMouseEvent", &event);
    }
    assert_ne!(browser.evaluate(state), back, "{page}");
    // A quarter turn and back from above keeps everything on the paper.
    for value in ["up", "up", "up", "up", "right", "right"] {
        browser.evaluate(&press(value));
        let outside = browser.evaluate(
            "[...document.querySelectorAll('svg.machine circle.joint')].filter((e) => { const [x, y] = \
             [+e.getAttribute('cx'), +e.getAttribute('cy')]; return !(x >= 0 && x <= 680 && y >= 0 && y <= 470); }).length",
        );
        assert_eq!(outside, 0, "{page}");
    }
}

/// The script projects as the program did, to the tenth that is written.
fn close(found: &Value, expected: &Value, page: &str) {
    let numbers = |value: &Value| -> Vec<f64> {
        let text = value.to_string();
        text.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
            .filter_map(|number| number.parse().ok())
            .collect()
    };
    let (found, expected) = (numbers(found), numbers(expected));
    assert_eq!(found.len(), expected.len(), "{page}");
    for (found, expected) in found.iter().zip(&expected) {
        assert!(
            (found - expected).abs() < 0.16,
            "{page}: {found} {expected}"
        );
    }
}

fn unfolds_on_paper(browser: &mut Browser, page: &str) {
    browser.open(page, PAPER, "print", "light");
    let folded = browser.evaluate(
        "[...document.querySelectorAll('details > .folded')].filter((e) => !(e.getBoundingClientRect().height > 10 \
         && e.checkVisibility({ contentVisibilityAuto: true }))).length",
    );
    assert_eq!(folded, 0, "{page}");
    let buttons = browser.evaluate("document.querySelector('.turn').checkVisibility()");
    assert_eq!(buttons, false, "{page}");
    let printed = browser.ask("Page.printToPDF", &json!({ "preferCSSPageSize": true }));
    let data = printed["data"].as_str().unwrap();
    assert!(data.len() > 100_000, "{page}");
}

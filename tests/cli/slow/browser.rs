//! The report in a browser: layout, names for those who can't see it, contrast, and the drawing that turns.

use super::devtools::{Browser, absolute};

use serde_json::{Value, json};

use tau_testkit::Work;

/// Text width of an A4 page with the margins of the style sheet: 180 mm at 96 pixels an inch.
const PAPER: u32 = 680;
/// The least contrast of text that can be read by all: WCAG 2.2, criterion 1.4.3.
const CONTRAST: f64 = 4.5;

/// Texts whose colour does not stand out from what is behind them, as [ratio, text].
const CONTRASTS: &str = r#"(() => {
  const channels = (text) => {
    const numbers = text.match(/[\d.]+/g).map(Number);
    return numbers.length > 3 ? numbers : [...numbers, 1];
  };
  const luminance = (color) => {
    const [r, g, b] = color.map((value) => {
      const share = value / 255;
      return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const over = (top, below) => top.slice(0, 3).map((value, k) => value * top[3] + below[k] * (1 - top[3]));
  const ground = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) {
      if (e.tagName === "svg") {
        const paper = e.querySelector(":scope > rect[width='100%']");
        if (paper) layers.push(channels(getComputedStyle(paper).fill));
      }
      layers.push(channels(getComputedStyle(e).backgroundColor));
    }
    return layers.reduceRight((below, layer) => over(layer, below), [255, 255, 255]);
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    const text = walker.currentNode.data.trim();
    if (!text || ["SCRIPT", "STYLE", "title", "desc", "style"].includes(element.tagName)) continue;
    if (!element.checkVisibility()) continue;
    const style = getComputedStyle(element);
    const isDrawn = !!element.ownerSVGElement;
    const pin = element.closest(".pin");
    const below = pin ? channels(getComputedStyle(pin.querySelector("circle")).fill) : ground(element);
    const ink = over(channels(isDrawn ? style.fill : style.color), below);
    const [a, b] = [luminance(ink), luminance(below)];
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), text.slice(0, 40)]);
  }
  return found;
})()"#;

/// Elements that reach beyond the page and are in nothing that scrolls.
const OVERFLOWS: &str = r#"(() => {
  const width = document.documentElement.clientWidth;
  const found = [];
  for (const element of document.body.querySelectorAll("*")) {
    if (element.closest("svg") && element.tagName !== "svg") continue;
    if (!element.checkVisibility() || element.closest(".scroll")?.contains(element) && !element.matches(".scroll")) continue;
    const box = element.getBoundingClientRect();
    if (box.right > width + 0.5 || box.left < -0.5) found.push(`${element.tagName}.${element.getAttribute("class")}: ${box.left} to ${box.right}`);
  }
  return { page: document.documentElement.scrollWidth, width, found };
})()"#;

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
    assert_eq!(
        found["page"], found["width"],
        "{place}: {:#}",
        found["found"]
    );
    assert_eq!(found["found"], json!([]), "{place}");
}

fn stands_out(browser: &mut Browser, place: &str, scheme: &str) {
    let texts = browser.evaluate(CONTRASTS);
    let texts = texts.as_array().unwrap();
    assert!(texts.len() > 300, "{place}: {} texts", texts.len());
    let faint: Vec<&Value> = texts
        .iter()
        .filter(|text| text[0].as_f64().unwrap() < CONTRAST)
        .collect();
    assert!(faint.is_empty(), "{place}: {faint:?}");
    let ground = browser.evaluate("getComputedStyle(document.documentElement).backgroundColor");
    assert_eq!(
        ground == "rgb(255, 255, 255)",
        scheme == "light",
        "{place}: {ground}"
    );
}

/// Names as the browser tells them to programs that read aloud.
fn has_names(browser: &mut Browser, report: &Report) {
    let page = &report.page;
    browser.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))");
    let tree = browser.ask("Accessibility.getFullAXTree", &json!({}));
    let mut counts = std::collections::BTreeMap::new();
    for node in tree["nodes"].as_array().unwrap() {
        let role = node["role"]["value"].as_str().unwrap_or_default();
        let is_asked = matches!(
            role,
            "image"
                | "img"
                | "figure"
                | "button"
                | "link"
                | "table"
                | "region"
                | "DisclosureTriangle"
        );
        if node["ignored"] == true || !is_asked {
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
    for (kind, x) in [
        ("mousePressed", 250),
        ("mouseMoved", 320),
        ("mouseReleased", 320),
    ] {
        let y = browser
            .evaluate("document.querySelector('svg.machine').getBoundingClientRect().top + 200");
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
    assert!(
        printed["data"]
            .as_str()
            .is_some_and(|data| data.len() > 100_000),
        "{page}"
    );
}

//! The book's examples mean what it says they mean, and its tables are complete.

use super::{GANTRY_TAU, codes, model, with_formula};
use crate::units::{DIMENSIONS, UNITS, find_dimension};
use crate::{check_text, effects_from_text};

const BOOK: &str = include_str!("../../../docs/language.md");

/// Code blocks with the words after their fences.
fn blocks() -> Vec<(&'static str, &'static str)> {
    BOOK.split("```")
        .skip(1)
        .step_by(2)
        .map(|block| block.split_once('\n').unwrap_or((block, "")))
        .collect()
}

#[test]
fn examples() {
    let mut checked = 0;
    let mut reported = String::new();
    for (kind, text) in blocks() {
        checked += 1;
        match kind {
            "tau" => drop(model(text)),
            "tau-effects" => {
                let joined = effects_from_text(text, &model(GANTRY_TAU));
                joined.unwrap_or_else(|errors| panic!("{errors}\nin\n{text}"));
            }
            "tau-formulas" => {
                for formula in text.lines() {
                    assert_eq!(codes(&with_formula(formula)), [], "{formula}");
                }
            }
            "tau-wrong" => reported = check_text(text).unwrap_err().to_string(),
            "text" => assert_eq!(text.trim_end(), reported),
            "ebnf" => {}
            other => panic!("unknown kind of block `{other}`"),
        }
    }
    assert!(checked >= 9, "{checked} blocks");
}

#[test]
fn the_first_example_is_the_shipped_robot() {
    // The shipped description has more doc comments, nothing else.
    let (_, text) = blocks()[0];
    let (mut shipped, example) = (model(GANTRY_TAU), model(text));
    for variant in &mut shipped.variants {
        variant.docs.clear();
    }
    assert_eq!(shipped, example);
}

#[test]
fn tables_name_all_units_and_dimensions() {
    let tables = BOOK.split("## Units").nth(1).unwrap();
    for unit in UNITS {
        assert!(
            tables.contains(&format!("| `{}` | ", unit.name)),
            "unit `{}` is not in the book",
            unit.name
        );
    }
    for (name, _) in DIMENSIONS {
        assert!(
            tables.contains(&format!("`{name}`")),
            "dimension `{name}` is not in the book"
        );
    }
    // Rows read `name` | unit, and the unit must be that of the dimension.
    let mut compared = 0;
    let cells: Vec<_> = tables.split('|').map(str::trim).collect();
    for pair in cells.windows(2) {
        let name = pair[0].split(',').next().unwrap_or("").trim_matches('`');
        if let Some(dimension) = find_dimension(name).filter(|_| pair[0].starts_with('`')) {
            let unit = dimension.si_unit();
            let shown = if pair[1] == "Pa" { "N/m^2" } else { pair[1] };
            assert_eq!(unit, shown, "`{name}`");
            compared += 1;
        }
    }
    assert!(compared >= 16, "{compared} rows of dimensions");
}

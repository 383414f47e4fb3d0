//! A verdict's figures as tables.

use tau::trust::Verdict;

use crate::table::{Cell, Table, columns, number, text};

/// The poses that are met worst.
pub(crate) fn worst(fit: &Verdict) -> Option<Table> {
    let rows = fit.worst.iter();
    let rows = rows.map(|own| vec![text(&own.pose.to_string()), number(own.sigmas, 1)]);
    of(
        "Poses met worst",
        ["Pose", "residuals / noise"],
        rows.collect(),
    )
}

/// The parameters furthest from nominal.
pub(crate) fn pulls(fit: &Verdict) -> Option<Table> {
    let rows = fit.pulls.iter();
    let rows = rows.map(|own| vec![text(&own.parameter), number(own.tolerances, 2)]);
    let title = "Parameters furthest from nominal";
    of(title, ["Parameter", "change / tolerance"], rows.collect())
}

fn of(title: &str, headings: [&str; 2], rows: Vec<Vec<Cell>>) -> Option<Table> {
    (!rows.is_empty()).then(|| Table {
        title: title.to_owned(),
        columns: columns(&[("", &headings)]),
        rows,
    })
}

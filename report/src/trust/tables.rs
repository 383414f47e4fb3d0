//! A verdict's figures as tables.

use tau::trust::Verdict;

use crate::table::{Table, columns, number, text};

/// The poses that are met worst.
pub(crate) fn worst(fit: &Verdict) -> Option<Table> {
    let rows: Vec<_> = (fit.worst.iter())
        .map(|pose| vec![text(&pose.pose.to_string()), number(pose.sigmas, 1)])
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: "Poses met worst".to_owned(),
        columns: columns(&[("", &["Pose", "residuals / noise"])]),
        rows,
    })
}

/// The parameters furthest from nominal.
pub(crate) fn pulls(fit: &Verdict) -> Option<Table> {
    let rows: Vec<_> = (fit.pulls.iter())
        .map(|pull| vec![text(&pull.parameter), number(pull.tolerances, 2)])
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: "Parameters furthest from nominal".to_owned(),
        columns: columns(&[("", &["Parameter", "change / tolerance"])]),
        rows,
    })
}

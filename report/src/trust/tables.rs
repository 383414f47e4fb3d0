//! A verdict's figures as tables.

use tau::trust::{FileFit, Verdict};

use crate::number::general;
use crate::table::{Cell, Table, columns, number, text};

/// Residuals by file against the noise.
pub(crate) fn by_file(fit: &Verdict) -> Option<Table> {
    let row = |file: &FileFit| {
        let (factor, unit) = match file.unit {
            "m" => (1e6, "µm"),
            _ => (1e6, "µrad"),
        };
        vec![
            text(file.file),
            text(file.kind),
            Cell::Number(file.rows.to_string()),
            Cell::Number(general(factor * file.rms, 3)),
            Cell::Number(general(factor * file.expected_rms, 3)),
            text(unit),
            number(file.rms / file.expected_rms, 2),
        ]
    };
    let rows: Vec<_> = fit.by_file.iter().map(row).collect();
    (!rows.is_empty()).then(|| Table {
        title: "Residuals by file, against what the stated noise would show".to_owned(),
        columns: columns(&[
            ("", &["File", "Residuals", "Number"]),
            ("Root mean square", &["found", "expected", "unit", "ratio"]),
        ]),
        rows,
    })
}

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

//! The files of a calibration.

use tau_estimation::calibration::Calibration;
use tau_robot::number::shortest;

use super::Calibrated;

/// Names of the files of a calibration.
pub const CALIBRATION_FILES: [&str; 4] = [
    "robot.toml",
    "parameters.csv",
    "covariance.csv",
    "undetermined.csv",
];

impl<R> Calibrated<R> {
    /// The texts of [`CALIBRATION_FILES`], as every command writes them.
    pub fn files(&self) -> [String; 4] {
        [
            self.file.to_toml(),
            parameters(self, self.widening()),
            covariance(self),
            undetermined(self),
        ]
    }
}

/// A table as comma-separated text; fields that hold commas or quotes are quoted.
pub fn csv(header: Vec<String>, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let quoted = |field: String| {
        if field.contains([',', '"', '\n']) {
            format!("\"{}\"", field.replace('"', "\"\""))
        } else {
            field
        }
    };
    let rows = std::iter::once(header).chain(rows);
    let lines = rows.map(|row| row.into_iter().map(quoted).collect::<Vec<_>>().join(",") + "\n");
    lines.collect()
}

/// Standard deviations as stated noise makes them, and widened by the misfit.
fn parameters(found: &Calibration, widening: f64) -> String {
    let header = [
        "parameter",
        "unit",
        "nominal",
        "tolerance",
        "value",
        "sigma",
        "sigma_widened",
        "from",
    ];
    let rows = found.parameters.iter().map(|parameter| {
        vec![
            parameter.name.clone(),
            parameter.unit.clone(),
            shortest(parameter.nominal),
            parameter.tolerance.map_or_else(String::new, shortest),
            shortest(parameter.value),
            shortest(parameter.sigma),
            shortest(parameter.sigma_widened(widening)),
            parameter.source().name().to_owned(),
        ]
    });
    csv(header.map(String::from).into(), rows)
}

fn covariance(found: &Calibration) -> String {
    let names = || {
        found
            .parameters
            .iter()
            .map(|parameter| parameter.name.clone())
    };
    let header = std::iter::once("parameter".to_owned()).chain(names());
    // Shortest digits take long to find, and the matrix is symmetric.
    let mut entries: Vec<Vec<String>> = vec![];
    for (i, row) in found.covariance.iter().enumerate() {
        let known = entries.iter().map(|row| row[i].clone());
        let row = known
            .chain(row[i..].iter().copied().map(shortest))
            .collect();
        entries.push(row);
    }
    let rows = names().zip(entries).map(|(name, mut row)| {
        row.insert(0, name);
        row
    });
    csv(header.collect(), rows)
}

fn undetermined(found: &Calibration) -> String {
    let header = ["combination", "data_over_prior", "parameter", "share"];
    let rows = found
        .undetermined
        .iter()
        .enumerate()
        .flat_map(|(index, combination)| {
            combination.terms.iter().map(move |(parameter, share)| {
                vec![
                    (index + 1).to_string(),
                    shortest(combination.data_over_prior),
                    parameter.clone(),
                    shortest(*share),
                ]
            })
        });
    csv(header.map(String::from).into(), rows)
}

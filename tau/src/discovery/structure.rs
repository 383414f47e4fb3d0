//! Unnamed structure in words and as a curve.

use super::bench::Bench;
use super::candidates::Candidate;
use super::results::Unnamed;
use super::samples::Sample;
use super::view::View;
use crate::kinematics::Surroundings;
use crate::robot::Input;

/// What an unnamed family explains beside a model.
pub(super) fn unnamed(bench: &Bench, view: &View, family: usize) -> Option<Unnamed> {
    let candidate = &bench.candidates[family];
    let described = candidate.family.as_ref()?;
    let (_, subspace) = bench.subspace(view, family, None)?;
    let amplitudes = subspace.amplitudes(&view.residuals);
    let entries = candidate
        .entries(
            &bench.model,
            &candidate.nominal(),
            &bench.probes,
            &bench.samples,
            &bench.surroundings,
        )
        .ok()?;
    // An axis of a vector has entries for all three components; only its own has slopes.
    let entry = entries
        .iter()
        .find(|entry| entry.slopes.iter().any(Option::is_some))?;
    let displaced = |k: usize| -> f64 {
        let slope = |place: usize| entry.slopes[place].as_ref().map_or(0.0, |slopes| slopes[k]);
        amplitudes
            .iter()
            .enumerate()
            .map(|(place, amplitude)| amplitude * slope(place))
            .sum()
    };
    let samples = &bench.probes.all[entry.probe].samples;
    let values: Vec<f64> = (0..samples.len()).map(displaced).collect();
    let (against, covariate) = covariates(described.against, candidate, bench, samples)
        .into_iter()
        .max_by(|a, b| correlation(&a.1, &values).total_cmp(&correlation(&b.1, &values)))?;
    let mut curve: Vec<[f64; 2]> = covariate
        .iter()
        .zip(&values)
        .map(|(&x, &y)| [x, y])
        .collect();
    curve.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let square = values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64;
    Some(Unnamed {
        place: candidate.places.clone(),
        direction: described.direction.clone(),
        against,
        rms_um: square.sqrt() * 1e6,
        curve,
    })
}

/// The single quantities that a family reads.
fn covariates(
    against: &str,
    candidate: &Candidate,
    bench: &Bench,
    samples: &[usize],
) -> Vec<(String, Vec<f64>)> {
    use tau_codegen::language::model::Place;
    let (track, link) = match candidate.place {
        Place::Cart { track, .. } => (track, 0),
        Place::Link(link) => {
            let cluster = bench.model.links[link].cluster;
            (bench.model.clusters[cluster].track.unwrap_or(0), link)
        }
        _ => (0, 0),
    };
    let tracks = &bench.model.tracks;
    let list: Vec<(String, Input)> = match against {
        "q" => vec![("q".into(), Input::Command(track))],
        "direction" => vec![("direction".into(), Input::Direction(track))],
        "temperature" => vec![("temperature".into(), Input::Temperature)],
        "time" => vec![("time".into(), Input::Time)],
        "tension" => vec![("tension".into(), Input::Tension(link))],
        "load" => ["along", "horizontal", "vertical"]
            .iter()
            .enumerate()
            .map(|(component, axis)| (format!("load_{axis}"), Input::Load { track, component }))
            .collect(),
        "commands" => tracks
            .iter()
            .enumerate()
            .map(|(k, track)| (format!("q({})", track.name), Input::Command(k)))
            .collect(),
        _ => ["x", "y", "z"]
            .iter()
            .enumerate()
            .map(|(k, axis)| ((*axis).to_owned(), Input::TcpPosition(k)))
            .collect(),
    };
    let surroundings: &Surroundings = &bench.surroundings;
    let read = |input: Input| -> Option<Vec<f64>> {
        let sample = |&s: &usize| -> Option<f64> {
            let sample: &Sample = &bench.samples[s];
            sample.input(input, surroundings).ok()
        };
        samples.iter().map(sample).collect()
    };
    list.into_iter()
        .filter_map(|(name, input)| Some((name, read(input)?)))
        .collect()
}

/// Magnitude of the correlation of two series.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().max(1) as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / count, b.iter().sum::<f64>() / count);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        ab += (a - mean_a) * (b - mean_b);
        aa += (a - mean_a).powi(2);
        bb += (b - mean_b).powi(2);
    }
    if aa * bb > 0.0 {
        ab.abs() / (aa * bb).sqrt()
    } else {
        0.0
    }
}

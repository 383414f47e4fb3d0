//! Discovery on other robots, and by other measurements than poses.

use std::fmt::Write;

use tau::discovery::Options;
use tau::measurements::{PlateKind, Split};
use tau::simulation::{Measure, Noise};

use crate::plan::Section;
use crate::scoring::Share;
use crate::stand::{Kind, Places, Record, Stand, Subject, Trial};

/// Trials of each kind: five kinds make 300 a machine.
const TRIALS: usize = 60;
/// λ of the effects that are named.
const NONCENTRALITIES: [f64; 3] = [30.0, 60.0, 120.0];
/// λ of an effect that is taken out of the catalogue.
const WITHHELD: f64 = 120.0;

const KINDS: [Kind; 4] = [
    Kind {
        name: "linear delta, poses",
        robot: "linear_delta",
        measures: &[Measure::Poses],
        places: anywhere(120),
        file: TRACKED,
        ..PLAIN
    },
    Kind {
        name: "hexapod, poses",
        robot: "hexapod",
        measures: &[Measure::Poses],
        places: anywhere(120),
        file: TRACKED,
        ..PLAIN
    },
    Kind {
        name: "four belts, readings",
        robot: "four_belts",
        measures: &[Measure::Rows(PlateKind::Reading)],
        places: anywhere(160),
        file: "[drives]\nnoise_m = 2e-4\n[payload]\nmass_kg = 9.0\ncentre_m = [0.0, 0.0, 0.0]\n\
               gravity_m_s2 = [0.0, -9.81, 0.0]\n",
        ..PLAIN
    },
    Kind {
        name: "linear delta, heights and distances",
        robot: "linear_delta",
        measures: &[Measure::Rows(PlateKind::Height), Measure::Distances],
        places: anywhere(160),
        file: "[noise]\nheights = { height_m = 1e-5 }\ndistances = { distance_m = 2e-5 }\n\
               [payload]\nmass_kg = 3.0\ncentre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, 0.0, -9.81]\n",
        ..PLAIN
    },
];

/// Settings of most machines.
pub(crate) const PLAIN: Kind = Kind {
    name: "",
    robot: "",
    base: "Full",
    measures: &[Measure::Poses],
    places: anywhere(120),
    heights: None,
    file: TRACKED,
};

const fn anywhere(count: usize) -> Places {
    Places::Anywhere {
        count,
        tilt_rad: 0.0,
    }
}

const TRACKED: &str = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[payload]\nmass_kg = 3.0\n\
    centre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, 0.0, -9.81]\n";

/// Runs the trials of the machines whose names hold a text, and prints a table; `only` are their sections, all where
/// it is empty.
pub(crate) fn run(
    seed: u64,
    (trials, only): (Option<usize>, &[Section]),
    wanted: &str,
    method: &Options,
    mut told: impl FnMut(&str),
) -> String {
    let mut records = vec![];
    for kind in KINDS.iter().filter(|kind| kind.name.contains(wanted)) {
        let stand = Stand::new(kind, method);
        let listed = NONCENTRALITIES.map(|lambda| (Subject::Listed, lambda));
        let cases = [(Subject::Nothing, 0.0), (Subject::Withheld, WITHHELD)];
        let cases = cases.into_iter().chain(listed);
        let is_run = |subject: Subject| only.is_empty() || only.contains(&subject.section());
        for (subject, noncentrality) in cases.filter(|(subject, _)| is_run(*subject)) {
            for index in 0..trials.unwrap_or(TRIALS) {
                let trial = Trial {
                    subject,
                    names: stand.possible(),
                    at_one_place: false,
                    noncentrality,
                    index,
                    noise: ("", Noise::default()),
                    split: ("", Split::default()),
                    moves: false,
                };
                let record = stand.run(seed, &trial);
                told(&serde_json::to_string(&record).unwrap_or_default());
                records.push(record);
            }
        }
    }
    table(&records)
}

fn table(records: &[Record]) -> String {
    let mut text = "| machine | false names | λ 30 | λ 60 | λ 120 | confidently wrong, λ ≥ 60 | withheld: confidently wrong | \
                    of these a look-alike | failed | s |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
        .to_owned();
    let mut machines: Vec<&str> = records.iter().map(|own| own.machine.as_str()).collect();
    machines.dedup();
    for machine in machines {
        let own = || records.iter().filter(|record| record.machine == machine);
        let verdicts = |subject: Subject, least: f64, most: f64| {
            let range = least..=most;
            own()
                .filter(move |record| {
                    record.subject == subject && range.contains(&record.noncentrality)
                })
                .filter_map(|record| record.verdict)
        };
        let share = |share: Share| {
            let [low, high] = share.interval();
            format!("{}/{} ({low:.3} to {high:.3})", share.hits, share.of)
        };
        let right = |lambda: f64| {
            let own = verdicts(Subject::Listed, lambda, lambda);
            share(Share::of(own.map(|verdict| verdict.right_set)))
        };
        let nulls = verdicts(Subject::Nothing, 0.0, 0.0);
        let strong = verdicts(Subject::Listed, 60.0, f64::INFINITY);
        let withheld = verdicts(Subject::Withheld, 0.0, f64::INFINITY);
        let alike = own().filter(|record| record.look_alike).count();
        let failed = own().filter(|record| record.failure.is_some()).count();
        let seconds = own().filter_map(|record| Some(record.found.as_ref()?.seconds));
        let (sum, count) = seconds.fold((0.0, 0.0), |(sum, count), own| (sum + own, count + 1.0));
        let _ = writeln!(
            text,
            "| {machine} | {} | {} | {} | {} | {} | {} | {alike} | {failed} | {:.2} |",
            share(Share::of(nulls.map(|verdict| verdict.named))),
            right(30.0),
            right(60.0),
            right(120.0),
            share(Share::of(strong.map(|verdict| verdict.confidently_wrong))),
            share(Share::of(withheld.map(|verdict| verdict.confidently_wrong))),
            sum / f64::max(count, 1.0),
        );
    }
    text
}

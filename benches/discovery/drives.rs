//! Faults of drives: play and periodic errors of legs, cranks, carts and drums; nothing at all, by machines that have few
//! measurements; and answers that contradict the verdict on their own model.

use std::collections::BTreeMap;

use tau::discovery::Options;
use tau::measurements::{PlateKind, Split};
use tau::simulation::{Measure, Noise, Tails};
use tau_solver::parallel;

use crate::hidden::UNLISTED_OF_DRIVES;
use crate::machines::PLAIN;
use crate::plan::Section;
use crate::record::groups;
use crate::scoring::{Share, Verdict};
use crate::stand::{Kind, Places, Record, Stand, Subject, Trial};
use crate::table::{answer, listed, table, written};

/// Machines of each kind.
const MACHINES: usize = 30;
/// λ of the hidden effect, in turn.
const NONCENTRALITIES: [f64; 3] = [60.0, 120.0, 240.0];
/// Answers after which a user stops looking.
const AT_REST: [&str; 2] = ["nothing_missing", "explained"];

const TILTED: Places = Places::Anywhere {
    count: 120,
    tilt_rad: 0.1,
};

/// A machine with the faults of its drives; those of machines with nothing hidden alone have none.
struct Drives {
    kind: Kind,
    faults: &'static [&'static str],
    /// Faults that no catalogue has.
    unlisted: &'static [&'static str],
    /// True if it is also looked at with nothing hidden.
    is_null: bool,
    /// Splits by which it is then looked at.
    splits: &'static [(&'static str, Split)],
}

const ALTERNATE: (&str, Split) = ("alternate", Split::Alternate);
const BOTH: &[(&str, Split)] = &[ALTERNATE, ("all", Split::All)];

const PRINTER: &str = "[noise]\nheights = { height_m = 2e-5 }\ndistances = { distance_m = 5e-5 }\n";

const DRIVES: [Drives; 7] = [
    Drives {
        kind: Kind {
            name: "hexapod",
            robot: "hexapod",
            places: TILTED,
            ..PLAIN
        },
        faults: &["backlash", "screw_lead"],
        unlisted: &UNLISTED_OF_DRIVES,
        is_null: true,
        splits: &[ALTERNATE],
    },
    Drives {
        kind: Kind {
            name: "servo hexapod",
            robot: "servo_hexapod",
            places: TILTED,
            ..PLAIN
        },
        faults: &["backlash", "gear_error"],
        unlisted: &UNLISTED_OF_DRIVES,
        is_null: false,
        splits: &[ALTERNATE],
    },
    Drives {
        kind: Kind {
            name: "rotary delta",
            robot: "rotary_delta",
            ..PLAIN
        },
        faults: &["backlash", "gear_error"],
        unlisted: &UNLISTED_OF_DRIVES,
        is_null: true,
        splits: &[ALTERNATE],
    },
    Drives {
        kind: Kind {
            name: "hexaglide",
            robot: "hexaglide",
            places: TILTED,
            ..PLAIN
        },
        faults: &["backlash", "rack_pitch"],
        unlisted: &UNLISTED_OF_DRIVES,
        is_null: false,
        splits: &[ALTERNATE],
    },
    Drives {
        kind: Kind {
            name: "four lines",
            robot: "four_lines",
            file: LINES,
            ..PLAIN
        },
        faults: &["backlash"],
        unlisted: &[],
        is_null: false,
        splits: &[ALTERNATE],
    },
    Drives {
        kind: Kind {
            name: "printer, 41 heights",
            robot: "linear_delta",
            base: "Basic",
            measures: &[Measure::Rows(PlateKind::Height)],
            places: Places::OnBed {
                count: 41,
                radius_m: 0.09,
            },
            file: PRINTER,
            ..PLAIN
        },
        faults: &[],
        unlisted: &[],
        is_null: true,
        splits: BOTH,
    },
    Drives {
        kind: Kind {
            name: "printer, 7 heights and 12 distances",
            robot: "linear_delta",
            base: "Basic",
            measures: &[
                Measure::Rows(PlateKind::Height),
                Measure::Rows(PlateKind::Reading),
                Measure::Distances,
            ],
            places: Places::OnBed {
                count: 12,
                radius_m: 0.09,
            },
            heights: Some(7),
            file: PRINTER,
        },
        faults: &[],
        unlisted: &[],
        is_null: true,
        splits: BOTH,
    },
];

/// Drums turn to a milliradian, some micrometres of line.
const LINES: &str = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[drives]\nnoise_m = 1e-3\n[payload]\n\
    mass_kg = 3.0\ncentre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, 0.0, -9.81]\n";

/// The kinds of noise with nothing hidden: as stated, and as trackers make it.
fn noises(index: usize) -> [(&'static str, Noise); 3] {
    let plain = Noise::default();
    let serial = Noise {
        serial: 0.6,
        ..plain.clone()
    };
    let tails = Noise {
        tails: Tails::Heavy,
        // Some have outliers, too.
        outliers: if index.is_multiple_of(2) { 0.0 } else { 0.03 },
        ..plain.clone()
    };
    [
        ("as stated", plain),
        ("serial", serial),
        ("heavy tails", tails),
    ]
}

/// Trials of a machine.
fn trials(drives: &Drives, machines: usize) -> Vec<Trial> {
    let mut trials = vec![];
    let stated = ("as stated", Noise::default());
    for index in 0..machines {
        let plain = Trial {
            subject: Subject::Nothing,
            names: vec![],
            at_one_place: true,
            noncentrality: 0.0,
            index,
            noise: stated.clone(),
            split: ALTERNATE,
            moves: true,
        };
        let faults = [
            (Subject::Listed, drives.faults),
            (Subject::Withheld, drives.faults),
            (Subject::Withheld, drives.unlisted),
        ];
        for (subject, faults) in faults {
            if let Some(fault) = faults.get(index % faults.len().max(1)) {
                trials.push(Trial {
                    subject,
                    names: vec![(*fault).to_owned()],
                    noncentrality: NONCENTRALITIES[index / faults.len() % NONCENTRALITIES.len()],
                    ..plain.clone()
                });
            }
        }
        if drives.is_null {
            for (noise, &split) in (noises(index).iter())
                .flat_map(|noise| drives.splits.iter().map(move |split| (noise, split)))
            {
                trials.push(Trial {
                    noise: noise.clone(),
                    split,
                    ..plain.clone()
                });
            }
        }
    }
    trials
}

/// Runs the trials of the machines whose names hold a text, on all cores, and prints tables; `only` are their sections,
/// all where it is empty.
pub(crate) fn run(
    seed: u64,
    (machines, only): (Option<usize>, &[Section]),
    wanted: &str,
    method: &Options,
    told: impl Fn(&str) + Sync,
) -> String {
    let stands: Vec<(&Drives, Stand<'_>)> = (DRIVES.iter())
        .filter(|drives| drives.kind.name.contains(wanted))
        .map(|drives| (drives, Stand::new(&drives.kind, method)))
        .collect();
    let all: Vec<(&Stand<'_>, Trial)> = (stands.iter())
        .flat_map(|(drives, stand)| {
            let trials = trials(drives, machines.unwrap_or(MACHINES)).into_iter();
            trials.map(move |trial| (stand, trial))
        })
        .filter(|(_, trial)| only.is_empty() || only.contains(&trial.subject.section()))
        .collect();
    let records = parallel::map(&all, |(stand, trial)| {
        let record = stand.run(seed, trial);
        told(&serde_json::to_string(&record).unwrap_or_default());
        record
    });
    tables(&records)
}

/// Where a record stands in the tables: those of a machine together, however trials ran.
fn order(record: &Record) -> (usize, bool, String, &str, &str) {
    let machine = DRIVES
        .iter()
        .position(|own| own.kind.name == record.machine);
    let name = hidden(record);
    let is_unlisted = UNLISTED_OF_DRIVES.contains(&name.as_str());
    let machine = machine.unwrap_or(DRIVES.len());
    (machine, is_unlisted, name, &record.noise, &record.split)
}

/// All tables of the trials, whichever ended first.
pub(crate) fn tables(records: &[Record]) -> String {
    let mut records = records.to_vec();
    records.sort_by(|a, b| order(a).cmp(&order(b)));
    let records = &records[..];
    let mut text = faults(records, Subject::Listed, "A fault of a drive");
    text += &faults(records, Subject::Withheld, "The same, not in the catalogue");
    text += &answers(records);
    text += &nulls(records);
    text += &contradictions(records);
    text + &failures(records)
}

fn share(members: &[&Record], of: impl Fn(&Verdict) -> bool) -> String {
    let verdicts = members.iter().filter_map(|record| record.verdict);
    written(Share::of(verdicts.map(|verdict| of(&verdict))))
}

/// Name of the hidden effect.
fn hidden(record: &Record) -> String {
    (record.truth.first()).map_or("–".to_owned(), |own| own.name.clone())
}

fn faults(records: &[Record], subject: Subject, title: &str) -> String {
    let own =
        || (records.iter()).filter(|record| record.subject == subject && record.verdict.is_some());
    let each = groups(own(), |record| vec![record.machine.clone(), hidden(record)]);
    let all = groups(own(), |record| {
        let is_unlisted = UNLISTED_OF_DRIVES.contains(&hidden(record).as_str());
        let kind = if is_unlisted {
            "in no catalogue"
        } else {
            "of the catalogue"
        };
        vec!["all".to_owned(), kind.to_owned()]
    });
    let row = |(key, members): (Vec<String>, Vec<&Record>)| {
        let alike = members.iter().filter(|record| record.look_alike).count();
        let mut cells = key;
        cells.extend([
            share(&members, |v| v.detected),
            share(&members, |v| v.unnamed),
        ]);
        if subject == Subject::Listed {
            cells.push(share(&members, |v| v.right));
            cells.push(share(&members, |v| v.right_set));
        }
        cells.push(share(&members, |v| v.wrong_name));
        cells.push(share(&members, |v| v.confidently_wrong));
        if subject == Subject::Withheld {
            cells.push(alike.to_string());
        }
        cells
    };
    let rows: Vec<Vec<String>> = each.into_iter().chain(all).map(row).collect();
    let mut columns = vec!["machine", "hidden", "detected", "unnamed structure"];
    if subject == Subject::Listed {
        columns.extend(["right name", "right name or set"]);
    }
    columns.extend(["any wrong name", "confidently wrong"]);
    if subject == Subject::Withheld {
        columns.push("of these a look-alike");
    }
    table(title, &columns, &rows)
}

/// Answers to each kind of fault.
fn answers(records: &[Record]) -> String {
    let own = records
        .iter()
        .filter(|record| record.subject != Subject::Nothing && record.found.is_some());
    let each = groups(own, |record| {
        let withheld = if record.subject == Subject::Withheld {
            ", not in the catalogue"
        } else {
            ""
        };
        vec![record.machine.clone(), hidden(record) + withheld]
    });
    let row = |(mut key, members): (Vec<String>, Vec<&Record>)| {
        key.push(listed(counts(&members, |record, found| {
            Some(answer(&record.truth, found))
        })));
        key
    };
    let rows: Vec<Vec<String>> = each.into_iter().map(row).collect();
    table("Answers", &["machine", "hidden", "answers"], &rows)
}

fn counts(
    members: &[&Record],
    of: impl Fn(&Record, &crate::answer::Found) -> Option<String>,
) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    for record in members {
        if let Some(said) = record.found.as_ref().and_then(|found| of(record, found)) {
            *counts.entry(said).or_default() += 1;
        }
    }
    counts
}

fn nulls(records: &[Record]) -> String {
    let own = || (records.iter()).filter(|record| record.subject == Subject::Nothing);
    let each = groups(own(), |record| {
        vec![
            record.machine.clone(),
            record.noise.clone(),
            record.split.clone(),
        ]
    });
    let by_machine = groups(own(), |record| {
        vec![record.machine.clone(), "all".to_owned(), String::new()]
    });
    let all = groups(own(), |_| {
        vec!["all".to_owned(), String::new(), String::new()]
    });
    let row = |(mut cells, members): (Vec<String>, Vec<&Record>)| {
        cells.extend([
            share(&members, |v| !v.named && !v.unnamed),
            share(&members, |v| v.named),
            share(&members, |v| v.unnamed),
            share(&members, |v| v.confidently_wrong),
        ]);
        cells.push(listed(counts(&members, |_, found| {
            Some(found.status.clone())
        })));
        cells.push(listed(counts(&members, |record, found| {
            (!found.named.is_empty()).then(|| answer(&record.truth, found))
        })));
        cells
    };
    let rows = each.into_iter().chain(by_machine).chain(all).map(row);
    let rows: Vec<Vec<String>> = rows.collect();
    let columns = [
        "machine",
        "noise",
        "split",
        "neither effect nor structure",
        "false name",
        "unnamed structure",
        "explained by a false name",
        "status",
        "false names",
    ];
    table("Nothing hidden", &columns, &rows)
}

/// True if an answer says that nothing is left while its own model is not consistent with the measurements.
fn contradicts(record: &Record) -> Option<bool> {
    let found = record.found.as_ref()?;
    let fit = found.fit.as_ref()?;
    Some(AT_REST.contains(&found.status.as_str()) && fit != "consistent")
}

fn contradictions(records: &[Record]) -> String {
    let key = |record: &Record| {
        vec![
            record.machine.clone(),
            format!("{:?}", record.subject).to_lowercase(),
        ]
    };
    let each = groups(records.iter(), key);
    let all = groups(records.iter(), |_| vec!["all".to_owned(), String::new()]);
    let row = |(mut cells, members): (Vec<String>, Vec<&Record>)| {
        let of = |status: &str| {
            let own = members.iter().filter(|record| {
                (record.found.as_ref()).is_some_and(|found| found.status == status)
            });
            written(Share::of(own.filter_map(|record| contradicts(record))))
        };
        cells.extend(AT_REST.map(of));
        let judged = members.iter().filter_map(|record| contradicts(record));
        cells.push(written(Share::of(judged)));
        cells
    };
    let rows: Vec<Vec<String>> = each.into_iter().chain(all).map(row).collect();
    let columns = [
        "machine",
        "hidden",
        "`nothing_missing`, inconsistent",
        "`explained`, inconsistent",
        "of all answers",
    ];
    table(
        "An answer at rest beside a verdict of inconsistent on its own model",
        &columns,
        &rows,
    )
}

fn failures(records: &[Record]) -> String {
    let failed = records.iter().filter(|record| record.failure.is_some());
    let each = groups(failed, |record| {
        let failure = record.failure.clone().unwrap_or_default();
        let line = failure.lines().next().unwrap_or_default().to_owned();
        vec![
            record.machine.clone(),
            format!("{:?}", record.subject).to_lowercase(),
            line,
        ]
    });
    let rows: Vec<Vec<String>> = (each.into_iter())
        .map(|(mut key, members)| {
            key.push(members.len().to_string());
            key
        })
        .collect();
    table(
        "Without an answer",
        &["machine", "hidden", "why", "trials"],
        &rows,
    )
}

//! The tables of the benchmark, in Markdown.

use std::collections::BTreeMap;

use crate::answer::{Found, True};
use crate::plan::Section;
use crate::record::groups;
use crate::scoring::{Share, Verdict, micro_f1, quartile};
use crate::trials::Record;

/// All tables of what was run.
pub(crate) fn markdown(records: &[Record]) -> String {
    let mut text = String::new();
    for section in Section::ALL {
        let own: Vec<&Record> = records.iter().filter(|r| r.section == section).collect();
        if own.is_empty() {
            continue;
        }
        text += &match section {
            Section::Nulls => nulls(&own),
            Section::Single => single(&own),
            Section::Several => several("Several effects", OF_KIND_AND_SIZE, &own),
            Section::Places => {
                let title = "One effect at two places";
                several(title, OF_SIZE, &own) + &confusion(&format!("{title}: answers"), &own)
            }
            Section::Withheld => withheld(&own),
        };
    }
    text + &confident(records) + &seconds(records) + &failures(records)
}

/// Names that are wrong for sure, apart where the answer says that a hidden effect cannot be seen.
fn confident(records: &[Record]) -> String {
    let visible: Vec<&Record> = (records.iter())
        .filter(|record| record.visible && !record.truth.is_empty())
        .collect();
    let rows = groups(visible, |record| {
        format!("{:?}", record.section).to_lowercase()
    });
    let row = |(name, members): (String, Vec<&Record>)| {
        let (unseen, seen): (Vec<&Record>, Vec<&Record>) =
            members.iter().partition(|record| record.is_said_unseen());
        let of = |records: &[&Record]| share(&ended(records), |v| v.confidently_wrong);
        vec![name, of(&members), of(&seen), of(&unseen)]
    };
    table(
        "Wrong for sure",
        &[
            "section",
            "all",
            "no hidden effect is said to be unseen",
            "one is said to be unseen",
        ],
        &rows.into_iter().map(row).collect::<Vec<_>>(),
    )
}

/// A key by which trials are put together.
type Key = fn(&Record) -> String;

const OF_KIND: Key = |record| record.kind.clone();
const OF_SIZE: Key = |record| format!("λ {}", record.noncentrality);
const OF_KIND_AND_SIZE: Key = |record| format!("{}, λ {}", record.kind, record.noncentrality);
const OF_NONCENTRALITY: Key = |record| format!("{}", record.noncentrality);

/// Trials in which power is not what keeps from naming.
fn strong<'a>(records: &[&'a Record]) -> Vec<&'a Record> {
    let is_strong = |record: &&&Record| record.noncentrality >= 60.0;
    records.iter().filter(is_strong).copied().collect()
}

/// The trials that ended.
fn ended<'a>(records: &[&'a Record]) -> Vec<(&'a Found, Verdict)> {
    records
        .iter()
        .filter_map(|record| Some((record.found.as_ref()?, record.verdict?)))
        .collect()
}

fn share(ended: &[(&Found, Verdict)], of: impl Fn(&Verdict) -> bool) -> String {
    written(Share::of(ended.iter().map(|(_, verdict)| of(verdict))))
}

/// `.975 (39/40, .868–.999)`.
pub(crate) fn written(share: Share) -> String {
    if share.of == 0 {
        return "–".to_owned();
    }
    let [low, high] = share.interval();
    format!(
        "{} ({}/{}, {}–{})",
        decimal(share.hits as f64 / share.of as f64),
        share.hits,
        share.of,
        decimal(low),
        decimal(high)
    )
}

/// Three decimals, without a zero before the point.
fn decimal(value: f64) -> String {
    let text = format!("{value:.3}");
    text.strip_prefix('0').map_or(text.clone(), str::to_owned)
}

/// Median and quartiles.
fn spread(values: &[f64]) -> String {
    let at = |quarters| quartile(values, quarters).map_or("–".to_owned(), decimal);
    match values {
        [] => "–".to_owned(),
        _ => format!("{} ({}–{}) of {}", at(2), at(1), at(3), values.len()),
    }
}

pub(crate) fn table(title: &str, columns: &[&str], rows: &[Vec<String>]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let head: Vec<String> = columns.iter().map(ToString::to_string).collect();
    let rule = vec!["---".to_owned(); columns.len()];
    let body: String = rows.iter().map(|row| line(row)).collect();
    format!("### {title}\n\n{}{}{body}\n", line(&head), line(&rule))
}

fn nulls(records: &[&Record]) -> String {
    let row = |name: &str, members: &[&Record]| {
        let ended = ended(members);
        vec![
            name.to_owned(),
            share(&ended, |v| v.named),
            share(&ended, |v| v.named && !v.only_slow),
            share(&ended, |v| v.only_slow),
            share(&ended, |v| v.unnamed),
            share(&ended, |v| v.wrong_name && v.confidently_wrong),
        ]
    };
    let rows: Vec<Vec<String>> = groups(records.iter().copied(), OF_KIND)
        .iter()
        .map(|(name, members)| row(name, members))
        .chain([row("all", records)])
        .collect();
    let columns = [
        "noise",
        "false name",
        "of which other than time drift",
        "time drift only",
        "unnamed structure",
        "explained by a false name",
    ];
    table("Nothing hidden", &columns, &rows) + &confusion("What noise was named", records)
}

fn single(records: &[&Record]) -> String {
    let row = |name: &str, members: &[&Record]| {
        let unseen = members.iter().filter(|record| !record.visible).count();
        let ended = ended(members);
        let mean = |powers: Vec<f64>| match powers.len() {
            0 => "–".to_owned(),
            count => decimal(powers.iter().sum::<f64>() / count as f64),
        };
        let power = ended.iter().filter_map(|(f, _)| f.oracle_power).collect();
        let searching = ended
            .iter()
            .filter_map(|(f, _)| f.searching_oracle_power)
            .collect();
        let shares: Vec<f64> = ended.iter().filter_map(|(_, v)| v.share).collect();
        vec![
            name.to_owned(),
            unseen.to_string(),
            mean(power),
            mean(searching),
            share(&ended, |v| v.detected),
            share(&ended, |v| v.first_right),
            share(&ended, |v| v.right),
            share(&ended, |v| v.right_set),
            share(&ended, |v| v.wrong_name),
            share(&ended, |v| v.confidently_wrong),
            spread(&shares),
        ]
    };
    let columns = [
        "not visible",
        "oracle's power",
        "searching oracle's",
        "detected",
        "first name right",
        "right name",
        "right name or set",
        "any wrong name",
        "confidently wrong",
        "share of the oracle's gap",
    ];
    let by = |title: &str, first: &str, key: Key, records: &[&Record]| {
        let rows: Vec<Vec<String>> = groups(records.iter().copied(), key)
            .iter()
            .map(|(name, members)| row(name, members))
            .collect();
        table(title, &[&[first], columns.as_slice()].concat(), &rows)
    };
    by(
        "One effect, by non-centrality",
        "λ",
        OF_NONCENTRALITY,
        records,
    ) + &by(
        "One effect, by name, λ ≥ 60",
        "effect",
        OF_KIND,
        &strong(records),
    ) + &periods(records)
        + &confusion("What one effect was named, λ ≥ 60", &strong(records))
}

fn periods(records: &[&Record]) -> String {
    let rows: Vec<Vec<String>> = groups(records.iter().copied(), OF_KIND_AND_SIZE)
        .iter()
        .filter_map(|(name, members)| {
            let known: Vec<[bool; 2]> = ended(members)
                .iter()
                .filter_map(|(_, v)| v.period)
                .collect();
            (!known.is_empty()).then(|| {
                let of = |k: usize| written(Share::of(known.iter().map(|right| right[k])));
                vec![name.clone(), of(0), of(1)]
            })
        })
        .collect();
    let columns = ["effect", "within 1 %", "in the main lobe"];
    table("Periods, where the name is right", &columns, &rows)
}

fn several(title: &str, key: Key, records: &[&Record]) -> String {
    let rows: Vec<Vec<String>> = groups(records.iter().copied(), key)
        .iter()
        .map(|(name, members)| {
            let ended = ended(members);
            let verdicts: Vec<Verdict> = ended.iter().map(|(_, verdict)| *verdict).collect();
            let shares: Vec<f64> = verdicts.iter().filter_map(|v| v.share).collect();
            vec![
                name.clone(),
                verdicts.len().to_string(),
                decimal(micro_f1(&verdicts)),
                share(&ended, |v| v.right),
                share(&ended, |v| v.right_set),
                share(&ended, |v| v.wrong_name),
                share(&ended, |v| v.confidently_wrong),
                spread(&shares),
            ]
        })
        .collect();
    let columns = [
        "hidden",
        "trials",
        "micro-F1",
        "exactly right",
        "right names or sets",
        "any wrong name",
        "confidently wrong",
        "share of the oracle's gap",
    ];
    table(title, &columns, &rows) + &missed(title, records)
}

/// Effects that were missed, with the names given in their place.
fn missed(title: &str, records: &[&Record]) -> String {
    let mut counts: BTreeMap<&str, (usize, usize, BTreeMap<String, usize>)> = BTreeMap::new();
    for record in records {
        let Some(found) = &record.found else { continue };
        let names: Vec<(&str, &str)> = found
            .named
            .iter()
            .map(|n| (n.name.as_str(), n.place.as_str()))
            .collect();
        let truth: Vec<(&str, &str)> = record
            .truth
            .iter()
            .map(|t| (t.name.as_str(), t.place.as_str()))
            .collect();
        let wrong: Vec<String> = names
            .iter()
            .filter(|key| !truth.contains(key))
            .map(|(name, place)| format!("{name}({place})"))
            .collect();
        for key in &truth {
            let entry = counts.entry(key.0).or_default();
            entry.0 += 1;
            if !names.contains(key) {
                entry.1 += 1;
                for wrong in &wrong {
                    let name = wrong.split('(').next().unwrap_or_default();
                    *entry.2.entry(name.to_owned()).or_default() += 1;
                }
            }
        }
    }
    let rows: Vec<Vec<String>> = counts
        .into_iter()
        .map(|(name, (of, missed, instead))| {
            vec![
                name.to_owned(),
                of.to_string(),
                missed.to_string(),
                listed(instead),
            ]
        })
        .collect();
    let columns = ["hidden", "trials", "missed", "wrong names in those trials"];
    table(&format!("{title}, by name"), &columns, &rows)
}

fn withheld(records: &[&Record]) -> String {
    let row = |name: &str, members: &[&Record]| {
        let unseen = members.iter().filter(|record| !record.visible).count();
        let ended = ended(members);
        vec![
            name.to_owned(),
            unseen.to_string(),
            share(&ended, |v| v.detected),
            share(&ended, |v| v.unnamed),
            share(&ended, |v| v.unnamed && !v.named),
            share(&ended, |v| v.wrong_name),
            share(&ended, |v| v.confidently_wrong),
        ]
    };
    let columns = [
        "not visible",
        "detected",
        "unnamed structure",
        "and no name",
        "any (wrong) name",
        "confidently wrong",
    ];
    let by = |title: &str, first: &str, key: Key, records: &[&Record]| {
        let rows: Vec<Vec<String>> = groups(records.iter().copied(), key)
            .iter()
            .map(|(name, members)| row(name, members))
            .collect();
        table(title, &[&[first], columns.as_slice()].concat(), &rows)
    };
    let title = "Not in the catalogue, by non-centrality";
    by(title, "λ", OF_NONCENTRALITY, records)
        + &by(
            "Not in the catalogue, by effect",
            "effect",
            OF_KIND,
            records,
        )
        + &confusion("What it was named", records)
}

/// Names that each kind was given, with their counts.
fn confusion(title: &str, records: &[&Record]) -> String {
    let rows: Vec<Vec<String>> = groups(records.iter().copied(), OF_KIND)
        .iter()
        .map(|(name, members)| {
            let mut counts: BTreeMap<String, usize> = BTreeMap::new();
            for record in members {
                if let Some(found) = &record.found {
                    *counts.entry(answer(&record.truth, found)).or_default() += 1;
                }
            }
            vec![name.clone(), listed(counts)]
        })
        .collect();
    table(title, &["hidden", "answers"], &rows)
}

/// An answer in short: names, `elsewhere` where the name is right and the place is not.
pub(crate) fn answer(truth: &[True], found: &Found) -> String {
    let mut names: Vec<String> = found
        .named
        .iter()
        .map(|named| {
            let mut places = truth.iter().filter(|own| own.name == named.name);
            let is_hidden = places.clone().next().is_some();
            if is_hidden && places.all(|own| own.place != named.place) {
                format!("{} elsewhere", named.name)
            } else {
                named.name.clone()
            }
        })
        .collect();
    names.sort();
    if names.is_empty() || !found.unnamed.is_empty() {
        names.push(
            if found.unnamed.is_empty() {
                "nothing"
            } else {
                "unnamed structure"
            }
            .to_owned(),
        );
    }
    names.join(" + ")
}

/// Counts, the most frequent first.
pub(crate) fn listed(counts: BTreeMap<String, usize>) -> String {
    let mut counts: Vec<(String, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let texts: Vec<String> = counts
        .into_iter()
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    texts.join("; ")
}

fn seconds(records: &[Record]) -> String {
    let all: Vec<f64> = records
        .iter()
        .filter_map(|record| Some(record.found.as_ref()?.seconds))
        .collect();
    let at = |quarters| quartile(&all, quarters).unwrap_or(f64::NAN);
    format!(
        "Seconds per search: median {:.2}, longest {:.2}, over {} searches.\n\n",
        at(2),
        at(4),
        all.len()
    )
}

fn failures(records: &[Record]) -> String {
    let failed: Vec<&Record> = records.iter().filter(|r| r.failure.is_some()).collect();
    if failed.is_empty() {
        return String::new();
    }
    let lines: Vec<String> = failed
        .iter()
        .map(|record| {
            format!(
                "- {:?}, {}, λ {}, {}: {}",
                record.section,
                record.kind,
                record.noncentrality,
                record.index,
                record.failure.as_deref().unwrap_or_default()
            )
        })
        .collect();
    format!("Searches that did not end:\n\n{}\n\n", lines.join("\n"))
}

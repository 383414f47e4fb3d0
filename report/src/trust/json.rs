//! Verdicts and checks as JSON.

use serde_json::{Map, Value, json};
use tau::calibration::{Combination, Serial};
use tau::trust::{Check, Checked, Fact, FileFit, Mistake, Reach, Reason, Verdict};
use tau::weighing::{Loss, Outlier, Repeats};

use crate::gauge::gauge_json;

/// `fit` of `calibrate`, `evaluate` and `study`.
pub fn verdict(verdict: &Verdict) -> Value {
    json!({
        "status": verdict.status.name(),
        "chi2": verdict.chi2,
        "dof": verdict.dof,
        "residual_over_noise": verdict.residual_over_noise,
        "widening": verdict.widening(),
        "by_file": verdict.by_file,
        "worst": verdict.worst,
        "pulls": verdict.pulls,
        "reach": verdict.reach.map(reach),
        "why": verdict.why.iter().map(Reason::to_string).collect::<Vec<_>>(),
        "reasons": verdict.why.iter().flat_map(Reason::facts).map(reason).collect::<Vec<_>>(),
        "mistakes": verdict.mistakes.iter().map(mistake).collect::<Vec<_>>(),
        "outliers": verdict.outliers.iter().map(outlier).collect::<Vec<_>>(),
        "loss": verdict.loss.map(Loss::name),
        "repeats": verdict.repeats.as_ref().map(repeats),
        "noise": noise(verdict),
    })
}

/// Noise that follows itself, of the file of the poses.
fn noise(verdict: &Verdict) -> Vec<Value> {
    let files = verdict.serial.iter().zip(&verdict.by_file);
    let entry = |(serial, fit): (&Serial, &FileFit)| {
        json!({
            "file": fit.file,
            "kind": "pose",
            "rho": serial.rho,
            "rho_p_value": serial.p_value,
        })
    };
    files.map(entry).collect()
}

fn reason(fact: Fact) -> Value {
    let values: Map<_, _> = (fact.values.into_iter())
        .map(|(name, value)| (name, json!(value)))
        .collect();
    json!({
        "code": fact.code.to_string(),
        "text": fact.text,
        "file": fact.file,
        "line": fact.line,
        "place": fact.place,
        "values": values,
        "held_out": fact.is_held_out,
    })
}

pub(crate) fn outlier(outlier: &Outlier) -> Value {
    json!({
        "file": outlier.file,
        "line": outlier.line,
        "pose": outlier.pose,
        "sigmas": outlier.sigmas,
        "weight": outlier.weight,
        "left_out": outlier.is_left_out(),
        "misread": outlier.misread,
    })
}

fn repeats(repeats: &Repeats) -> Value {
    json!({
        "poses": repeats.visits,
        "readings": repeats.readings,
        "repeatability": {
            "position_m": repeats.position_m,
            "rotation_rad": repeats.rotation_rad,
            "dof": repeats.degrees,
            "over_noise": repeats.within_over_noise,
        },
        "lack_of_fit": repeats.lack_of_fit,
        "shared_over_noise": repeats.shared_over_noise,
    })
}

fn reach(reach: Reach) -> Value {
    json!({
        "elsewhere_um": 1e6 * reach.elsewhere_m,
        "poses_um": 1e6 * reach.poses_m,
        "shown_um": 1e6 * reach.shown_m,
        "spread_m": reach.spread_m,
        "turn_rad": reach.turn_rad,
        "speaks_for_rest": reach.speaks_for_rest(),
    })
}

fn mistake(mistake: &Mistake) -> Value {
    json!({
        "code": mistake.kind.code().to_string(),
        "kind": mistake.kind.name(),
        "file": mistake.file,
        "lines": mistake.lines,
        "what": mistake.what,
        "mend": mistake.mend,
        "absurd": mistake.is_absurd,
    })
}

/// The result of `tau check`.
pub fn check(check: &Check) -> Value {
    let variants: Map<_, _> = (check.variants.iter())
        .map(|own| (own.variant.clone(), variant(own)))
        .collect();
    let effects = check.effects.iter().map(|effect| {
        let codes = effect.lacks.iter().map(|own| own.code().to_string());
        json!({
            "name": effect.name,
            "visible": effect.lacks.is_empty(),
            "lacks": effect.lacks.iter().map(|own| own.words()).collect::<Vec<_>>(),
            "codes": codes.collect::<Vec<_>>(),
        })
    });
    let missing = check.missing.iter();
    json!({
        "meaningful": check.is_meaningful(),
        "files": check.files,
        "exchange_unnoticed": check.exchange_unnoticed,
        "variants": variants,
        "effects": effects.collect::<Vec<_>>(),
        "missing": missing
            .map(|gap| json!({ "code": gap.code.to_string(), "what": gap.what, "brings": gap.brings }))
            .collect::<Vec<_>>(),
        "misfit": check.misfit,
        "mistakes": check.mistakes.iter().map(mistake).collect::<Vec<_>>(),
    })
}

fn variant(checked: &Checked) -> Value {
    let mut value = json!({
        "rows": checked.rows,
        "parameters": checked.parameters,
        "rank": checked.rank,
        "undetermined": checked.undetermined.iter().map(combination).collect::<Vec<_>>(),
        "reach": checked.reach.map(reach),
        "meaningful": checked.why_not.is_none(),
        "why_not": checked.why_not.as_ref().map(|why| &why.text),
        "code": checked.why_not.as_ref().map(|why| why.code.to_string()),
    });
    if let Some(rank) = &checked.gauge {
        value["determined"] = json!(rank.determined);
        value["gauge"] = gauge_json(rank);
    }
    value
}

pub(crate) fn combination(combination: &Combination) -> Value {
    let terms: Vec<_> = combination
        .terms
        .iter()
        .map(|(name, share)| json!({ "parameter": name, "share": share }))
        .collect();
    json!({ "terms": terms, "data_over_prior": combination.data_over_prior })
}

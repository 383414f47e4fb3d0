//! The evidence that discovery shows, against what was hidden.

use serde_json::Value;
use tau_testkit::{list, number};

use crate::search::{at, found_in_trial, found_of, of_effect};

/// The only entry of a list.
#[track_caller]
fn only(list: &Value) -> &Value {
    assert_eq!(list.as_array().map_or(0, Vec::len), 1, "{list}");
    &list[0]
}

fn is_flat(pattern: &Value) -> bool {
    let bins = list(&pattern["bins"]);
    let is_zero = |bin: &Value| at(bin, "after").abs() < 4.0 * at(bin, "sigma");
    !bins.is_empty() && bins.iter().all(is_zero)
}

#[test]
fn a_spectrum_peaks_at_the_hidden_period_and_residuals_follow_it() {
    const PERIOD_M: f64 = 0.00942;
    let hidden = format!("rack_pitch(two):sine=3e-5,period={PERIOD_M}");
    let (_, found) = found_of(&format!("--effect {hidden}"));
    let added = "variant Discovered = Full + rack_pitch(two) tol * 10;";
    assert!(found["model_text"].as_str().unwrap().contains(added));
    let evidence = only(&found["evidence"]);
    let spectrum = &evidence["spectrum"];
    assert_eq!(spectrum["parameter"], "period");
    assert_eq!(spectrum["unit"], "m");
    let threshold = at(spectrum, "threshold");
    let points: Vec<[f64; 3]> = (list(&spectrum["points"]).iter())
        .map(|point| [0, 1, 2].map(|k| number(&point[k])))
        .collect();
    let highest = points.iter().max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
    // Commands range over 1.4 m, so that peaks are 0.7 / m wide.
    let off = highest[0].recip() - PERIOD_M.recip();
    let is_high = highest[1] > 5.0 * threshold;
    assert!(off.abs() < 0.7 && is_high, "{highest:?}");
    assert!(points.len() <= 48 && points.iter().all(|point| point[2] < threshold));

    let pattern = only(&evidence["residuals"]);
    assert_eq!(pattern["place"], "two");
    assert_eq!(pattern["target"], "along");
    let bins = list(&pattern["bins"]);
    assert_eq!(bins.len(), 12);
    for bin in bins {
        let phase = std::f64::consts::TAU * at(bin, "at") / at(pattern, "period");
        // Means over a twelfth of a period, of a signal of which the model absorbs some hundredths.
        let off = at(bin, "before") - 30.0 * phase.sin();
        assert!(off.abs() < 4.0 * at(bin, "sigma") + 3.0, "{bin}");
    }
    assert!(is_flat(pattern), "{pattern}");
}

/// A gap of 119 µm is hidden in trial 03.
#[test]
fn residuals_against_the_side_of_approach_show_the_gap() {
    let found = found_in_trial("03");
    let pattern = only(&found["evidence"][0]["residuals"]);
    assert_eq!(pattern["against"], "direction");
    let [back, forth] = list(&pattern["bins"]) else {
        panic!("{pattern}");
    };
    assert_eq!([back, forth].map(|bin| at(bin, "at")), [-1.0, 1.0]);
    let gap = at(forth, "before") - at(back, "before");
    // The base takes up some of it.
    assert!((0.65 * 119.0..119.0).contains(&gap), "{gap}");
    assert!(is_flat(pattern), "{pattern}");
    assert!(at(found, "remaining_um") < 0.2 * at(found, "ceiling_um"));
}

/// The only link on a track looks like its track when both lengthen; three links of one cluster do not.
#[test]
fn look_alikes_are_listed_before_anything_is_found() {
    let found = found_in_trial("06");
    let pairs = list(&found["ambiguous"]);
    let is_pair = |a: [&str; 2], b: [&str; 2]| {
        pairs.iter().any(|pair| {
            let one = ["name", "place"].map(|key| &pair[key]);
            let other = ["with_name", "with_place"].map(|key| &pair[key]);
            (one == a && other == b) || (one == b && other == a)
        })
    };
    assert!(is_pair(["link_thermal", "l1"], ["track_thermal", "one"]));
    let not_alone = ["link_thermal", "l3a"];
    assert!(!is_pair(not_alone, ["track_thermal", "three"]));
    for pair in pairs {
        let [kappa, reverse] = ["kappa", "kappa_reverse"].map(|key| at(pair, key));
        assert!(kappa > 0.64 && kappa <= 1.0 && (0.0..=kappa).contains(&reverse));
        for [name, place] in [["name", "place"], ["with_name", "with_place"]] {
            let seen = of_effect(found, "detectable", pair[name].as_str().unwrap());
            assert!(seen.iter().any(|own| own["place"] == pair[place]), "{pair}");
        }
    }
}

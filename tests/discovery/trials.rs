//! Folders of `data/trials`: what was hidden is read by the test alone.

use serde_json::{Value, json};
use tau_testkit::{PROTOTYPE, effects, list};

use crate::bases::assert_all_at;
use crate::search::{at, found_in_trial};

fn truth(name: &str) -> Value {
    let path = format!("{PROTOTYPE}/../trials/{name}/truth.json");
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[track_caller]
pub(crate) fn assert_what_was_hidden(trial: &str) {
    let (found, truth) = (found_in_trial(trial), truth(trial));
    assert_eq!(effects(found), effects(&truth), "trial {trial}");
    let status = &found["status"];
    assert!(list(&truth["status"]).contains(status), "{trial}: {status}");
}

/// One has nothing, each of seven has an effect or two of another kind, one has gross errors, and one a track with a bump,
/// which no catalogue lists: the model follows its measured points there.
#[test]
fn what_was_hidden_has_its_name() {
    for trial in ["01", "02", "03", "04", "05", "06", "08", "09", "10", "11"] {
        assert_what_was_hidden(trial);
    }
    let bump = found_in_trial("11");
    assert_all_at("two", &bump["piecewise_tracks"]);
    assert_all_at("two", &bump["unnamed"]);
    let after = at(bump, "validation.after.mean_um");
    assert!(after < 1.2 * at(bump, "noise_floor_um"), "{after}");
}

/// Gross errors were put into three poses.
#[test]
fn outliers_are_listed_by_their_number() {
    let found = found_in_trial("10");
    assert_eq!(found["outliers"], json!([33, 91, 125]));
    let left_out = list(&found["left_out"]);
    assert!(left_out.iter().all(|out| out["set"] == 1), "{left_out:?}");
}

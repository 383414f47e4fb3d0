//! A machine whose struts were measured with a ball bar and a probe (`fixtures/struts`).

use tau_testkit::{Work, list};

/// Beside noise that is to be estimated, heights of the other sign fit somewhere, too: they are not suspected where those
/// that were measured fit.
#[test]
fn rows_that_fit_are_not_suspected_where_noise_is_estimated() {
    let line = "calibrate FIXTURES/struts --model FIXTURES/struts/struts.tau --variant Full --split all --out DIR/out \
                --json -";
    let found = Work::empty().run(line).json();
    let fit = &found["fit"];
    assert_eq!(fit["status"], "consistent", "{fit}");
    assert!(list(&fit["mistakes"]).is_empty(), "{fit}");
}

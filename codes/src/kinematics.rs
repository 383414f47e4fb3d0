//! Poses and commands that cannot be computed, and predictions.

codes! {
    MISSING = 501: "a closure needs a quantity that was not measured";
}

//! Fits, and the verdicts on them.

codes! {
    NOT_CONVERGED = 301: "a fit did not converge";
}

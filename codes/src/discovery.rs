//! Effects that a model lacks.

codes! {
    LACKS = 601: "the measurements lack what an effect reads";
}

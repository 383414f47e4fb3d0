//! Whole descriptions.

use crate::check_text;

#[test]
fn gantry_tau() {
    let model = check_text(include_str!("../../generated/models/gantry_tau.tau"))
        .unwrap_or_else(|errors| panic!("{errors}"));
    let names: Vec<_> = model
        .variants
        .iter()
        .map(|variant| variant.name.as_str())
        .collect();
    assert_eq!(
        names,
        [
            "Nominal",
            "Piecewise",
            "Full",
            "FullPiecewise",
            "BestPerLink",
            "FullRack"
        ]
    );
    assert_eq!(model.effects[0].parameters[0].tolerance, Some(1e-4));
}

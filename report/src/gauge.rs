//! Combinations of unknowns that measurements leave open.

use serde_json::{Value, json};
use tau::unknown_poses::Rank;

use crate::screen::Screen;

/// Open combinations, and how they were fixed.
pub(crate) fn open(screen: &mut Screen, rank: &Rank, indent: &str) {
    if !rank.open.is_empty() {
        screen.say_within(
            indent,
            "left open by these measurements, and held where the tolerances put it:",
        );
    }
    let inner = format!("{indent}  ");
    for open in &rank.open {
        screen.say_within(&inner, &open.words);
    }
    if rank.has_mirror_image {
        screen.say_within(
            indent,
            "a mirror image of the machine would fit as well: drawing and reference say which it is",
        );
    }
}

/// `gauge` in JSON.
pub(crate) fn gauge_json(rank: &Rank) -> Value {
    let open = rank.open.iter().map(
        |open| json!({ "what": open.words, "scale": open.is_scale, "fixed_by": "tolerances" }),
    );
    json!({ "open": open.collect::<Vec<_>>(), "mirror_image": rank.has_mirror_image })
}

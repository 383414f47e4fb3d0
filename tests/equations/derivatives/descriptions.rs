//! Descriptions at random.

use proptest::prelude::*;
use proptest::sample::select;

/// Functions of the command, of conditions, of loads and of places, without unit.
const SCALARS: &str = "q / period; sin(2*pi*q/period); cos(q/period) * (q/period)^2; abs(q) / period; \
    min(q, period) / period; max(q, period)^3 / period^3; sign(q); tanh(q/period); \
    atan(q/period) / 1 rad; exp(-(q/period)^2); ln(1 + (q/period)^2); sqrt(1 + \
    (q/period)^2); direction; time / 1 s; (temperature - 20 K) / 1 K; load_along / 1 N; \
    load_vertical / (2 N); (x + y - 2*z) / period; 1 - (q/period - 2)^2";

fn or_nothing(yes: bool, text: &'static str) -> &'static str {
    if yes { text } else { "" }
}

/// A template, with something in the place of each word in capitals.
fn filled(template: &str, parts: &[(&str, &str)]) -> String {
    let fill = |text: String, (word, part): &(&str, &str)| text.replace(word, part);
    parts.iter().fold(template.to_owned(), fill)
}

/// Carts with one to nine links, their effects and those of links, with a full arm and a reduced one.
pub(super) fn carts() -> impl Strategy<Value = String> {
    const TALKING: &str = "variant Talking = Moved + talk(t1, t0) + stretch(all);";
    // Links beyond the first on a cart take freedoms of the plate, which has six.
    let moves = |clusters: &Vec<usize>| clusters.iter().map(|links| links - 1).sum::<usize>() < 6;
    let clusters = prop::collection::vec(1_usize..=4, 1..=4);
    let clusters = clusters.prop_filter("the plate moves", moves);
    let scalars: Vec<&str> = SCALARS.split("; ").collect();
    let scalar = || select(scalars.clone());
    let target = select(&["along", "horizontal", "vertical"][..]);
    let turn = select(&["roll", "pitch", "yaw"][..]);
    let parts = (
        clusters,
        scalar(),
        scalar(),
        target,
        turn,
        any::<[bool; 2]>(),
    );
    parts.prop_map(|(mut clusters, first, second, target, turn, flags)| {
        // Six links hold a plate: the last cluster has those that are missing.
        let missing = 6_usize.saturating_sub(clusters.iter().sum());
        *clusters.last_mut().unwrap() += missing;
        let (mut text, mut link) = (String::new(), 0);
        for (index, count) in clusters.iter().enumerate() {
            let links: Vec<String> = (link..link + count).map(|k| format!("l{k}")).collect();
            link += count;
            let links = links.join(", ");
            text += &format!("track t{index}; cluster c{index} on t{index} {{ link {links}; }}\n");
        }
        filled(
            include_str!("carts.txt"),
            &[
                ("CLUSTERS", &text),
                ("LAST", if flags[1] { "piecewise" } else { "linear" }),
                ("PER_LINK", if flags[0] { " per link" } else { "" }),
                ("TARGET", target),
                ("TURN", turn),
                ("FIRST", first),
                ("SECOND", second),
                ("BY_ANGLE", &second.replace("period", "(2 m)")),
                ("TALKING", or_nothing(clusters.len() > 1, TALKING)),
            ],
        )
    })
}

/// Any plate with driven lengths, a drum, a crank and a track, formulas and `hold`.
pub(super) fn machines() -> impl Strategy<Value = String> {
    const ROD: &str = "length = norm(track_offset) + 0.2 * zero;";
    const JOINT: &str = "plate_joint = 0.3 * place + (0 m, zero, 0 m);";
    const PLATES: [(&str, usize); 4] = [
        ("body", 6),
        ("point", 3),
        ("body in plane", 3),
        ("point in plane", 2),
    ];
    let parts = (select(&PLATES[..]), 0_usize..=1, any::<[bool; 4]>());
    parts.prop_map(|((plate, freedoms), more, flags)| {
        let is_body = plate.starts_with("body");
        // One link each on the track, the crank, the drum and the first leg.
        let legs = (1..(freedoms + more).saturating_sub(3)).map(|k| format!("l{k}"));
        let legs: Vec<String> = legs.collect();
        let legs = match legs.join(", ") {
            none if none.is_empty() => none,
            some => format!("link {some} actuated length;"),
        };
        let axis = if plate.ends_with("plane") {
            "axis = (0, 0, 1) exact;"
        } else {
            or_nothing(flags[1], "axis = (0.6, 0, 0.8) exact;")
        };
        filled(
            include_str!("machine.txt"),
            &[
                ("PLATE", plate),
                ("AXIS", axis),
                ("CENTRE", or_nothing(flags[2], "centre = 0.5 * place;")),
                ("LEGS", &legs),
                ("ROD", or_nothing(flags[3], ROD)),
                ("JOINT", or_nothing(is_body && flags[0], JOINT)),
                ("PLACEMENT", or_nothing(is_body, " + placement(k)")),
            ],
        )
    })
}

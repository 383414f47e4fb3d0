//! `robot`, with its tracks, clusters and variants.

use std::rc::Rc;

use proc_macro2::{Delimiter, Ident};
use tau_codes::language;

use super::cursor::Parser;
use super::quantity::{list, number, quantity};
use super::{Parse, choice, effect, formula, unknown_item, unknown_word};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{Arm, Plate, TrackShape};
use crate::names::nearest;
use crate::syntax::{
    Cluster, EffectUse, Given, Held, Links, NamedValue, Reference, Robot, Track, Variant,
    VariantBody, VariantLine,
};
use crate::units::find_unit;

const ONE_OF_THESE: &str = "write one of these words";

/// Names elsewhere of a link's joint at the carrier.
const SYNONYMS: [(&str, &str); 5] = [
    ("base_joint", "track_offset"),
    ("cart_joint", "track_offset"),
    ("crank_joint", "track_offset"),
    ("track_joint", "track_offset"),
    ("anchor", "track_offset"),
];

/// `robot Name { … }` from the name on; into `slot`, or if that is taken, returns the name.
pub(super) fn robot(
    parser: &mut Parser<'_>,
    docs: Vec<String>,
    public: bool,
    slot: &mut Option<Robot>,
    diagnostics: &mut Diagnostics,
) -> Parse<Option<Ident>> {
    let name = parser.new_name("the robot's name")?;
    let mut second = None;
    let mut spare;
    let slot = if slot.is_some() {
        second = Some(name.clone());
        spare = None;
        &mut spare
    } else {
        slot
    };
    let robot = slot.insert(Robot {
        docs,
        public,
        name,
        plates: Vec::new(),
        parameters: Vec::new(),
        tracks: Vec::new(),
        clusters: Vec::new(),
        effects: Vec::new(),
        variants: Vec::new(),
        references: Vec::new(),
    });
    let help = "a robot's parts stand in braces: `robot Name { … }`";
    let mut body = parser.expect_braces(help)?;
    let keywords = [
        "plate",
        "param",
        "track",
        "crank",
        "cluster",
        "effect",
        "variant",
        "reference",
    ];
    body.items(
        |parser| parser.at_any(&keywords),
        diagnostics,
        |parser, diagnostics| {
            let docs = parser.docs()?;
            if let Some(word) = parser.eat_word("plate") {
                robot.plates.push(plate(parser, word.into())?);
                Ok(())
            } else if parser.eat_word("track").is_some() {
                let names = parser.new_names("the track's name")?;
                let track = |name| Track { name, crank: None };
                robot.tracks.extend(names.into_iter().map(track));
                parser.semicolon()
            } else if parser.eat_word("crank").is_some() {
                robot.tracks.extend(cranks(parser, diagnostics)?);
                Ok(())
            } else if parser.eat_word("param").is_some() {
                robot.parameters.push(effect::parameters(parser, false)?);
                Ok(())
            } else if parser.eat_word("cluster").is_some() {
                robot.clusters.push(cluster(parser, diagnostics)?);
                Ok(())
            } else if parser.eat_word("effect").is_some() {
                robot
                    .effects
                    .push(effect::effect(parser, docs, diagnostics)?);
                Ok(())
            } else if parser.eat_word("variant").is_some() {
                robot.variants.push(variant(parser, docs, diagnostics)?);
                Ok(())
            } else if let Some(word) = parser.eat_word("reference") {
                let reference = reference(parser, word.into(), diagnostics)?;
                robot.references.push(reference);
                Ok(())
            } else {
                Err(unknown_item(parser, &keywords))
            }
        },
    );
    Ok(second)
}

/// `plate point in plane;` from behind the word on.
fn plate(parser: &mut Parser<'_>, word: Location) -> Parse<(Plate, Location)> {
    let is_point = choice(parser, &[("body", false), ("point", true)], ONE_OF_THESE)?;
    let is_in_plane = parser.eat_word("in").is_some();
    if is_in_plane {
        parser.expect_word("plane", "the plane is z = 0: `in plane`")?;
    }
    let location = parser.since(word);
    parser.semicolon()?;
    let plate = match (is_point, is_in_plane) {
        (false, false) => Plate::Body,
        (true, false) => Plate::Point,
        (false, true) => Plate::BodyInPlane,
        (true, true) => Plate::PointInPlane,
    };
    Ok((plate, location))
}

/// `reference { commands = (0, 0, 0) m; position = (0, 0, 0.8) m; orientation = (0, 0, 0) rad; }` from the brace on.
fn reference(
    parser: &mut Parser<'_>,
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Parse<Reference> {
    let help = "commands and pose stand in braces: `reference { position = (0, 0, 0.8) m; }`";
    let mut body = parser.expect_braces(help)?;
    let keywords = ["commands", "position", "orientation"];
    let mut values = Vec::new();
    body.items(
        |parser| parser.at_any(&keywords),
        diagnostics,
        |parser, _| {
            parser.docs()?;
            if !parser.at_any(&keywords) {
                return Err(unknown_item(parser, &keywords));
            }
            let name = parser.name("a part of the reference")?;
            parser.expect("=", &format!("write `{name} = value unit;`"))?;
            let value = if name == "commands" {
                list(parser)?
            } else {
                vec![quantity(parser)?]
            };
            values.push((name, value));
            parser.semicolon()
        },
    );
    Ok(Reference { location, values })
}

/// `cluster arm1 on one { link l1; }` from the name on.
fn cluster(parser: &mut Parser<'_>, diagnostics: &mut Diagnostics) -> Parse<Cluster> {
    let name = parser.new_name("the cluster's name")?;
    parser.expect_word(
        "on",
        "say what carries the cluster: `on` a track, or `on base`",
    )?;
    let place = parser.name("a track or `base`")?;
    let mut body = parser.expect_braces("a cluster's links stand in braces: `{ link l1; }`")?;
    let mut cluster = Cluster {
        name,
        place,
        links: Vec::new(),
    };
    body.items(
        |parser| parser.at_word("link"),
        diagnostics,
        |parser, diagnostics| {
            parser.docs()?;
            if parser.eat_word("link").is_none() {
                return Err(unknown_item(parser, &["link"]));
            }
            let on_base = cluster.place == "base";
            cluster.links.push(links(parser, on_base, diagnostics)?);
            Ok(())
        },
    );
    Ok(cluster)
}

/// `crank a, b { axis = (0, 1, 0); }` from the first name on.
fn cranks(parser: &mut Parser<'_>, diagnostics: &mut Diagnostics) -> Parse<Vec<Track>> {
    let names = parser.new_names("the crank's name")?;
    let help = "a crank ends with `;`, or with its values in braces";
    let keywords = ["centre", "axis"];
    let values = values(parser, &keywords, &keywords, help, diagnostics)?;
    let values = Rc::new(values);
    let crank = |name| Track {
        name,
        crank: Some(Rc::clone(&values)),
    };
    Ok(names.into_iter().map(crank).collect())
}

/// `link a, b actuated length { … }` from the first name on.
fn links(parser: &mut Parser<'_>, on_base: bool, diagnostics: &mut Diagnostics) -> Parse<Links> {
    let names = parser.new_names("the link's name")?;
    if let Some(diagnostic) = misnamed_drive(parser) {
        return Err(diagnostic);
    }
    let actuated = match parser.eat_word("actuated") {
        Some(start) => {
            let help = "the length is what can be driven: by a length, `actuated length`, or through a drum, `actuated \
                        angle`";
            let by_angle = choice(parser, &[("length", false), ("angle", true)], help)?;
            Some((by_angle, parser.since(start)))
        }
        None => None,
    };
    let keywords = [
        "length",
        "plate_joint",
        "track_offset",
        "track_direction",
        "pulled",
    ];
    let help = "a link ends with `;`, or with its values in braces";
    let fitting: Vec<&str> = (keywords.into_iter())
        .filter(|word| !(on_base && *word == "track_direction"))
        .collect();
    let values = values(parser, &keywords, &fitting, help, diagnostics)?;
    let (pulls, values) = values.into_iter().partition(|value| value.name == "pulled");
    Ok(Links {
        names,
        actuated,
        values,
        pulls,
    })
}

/// Error of another word where `actuated` says what drives a link: `actuatd length`, `driven length`.
fn misnamed_drive(parser: &Parser<'_>) -> Option<Diagnostic> {
    let word = parser.word().filter(|word| word != "actuated")?;
    let mut behind = parser.clone();
    behind.eat_any_word();
    let is_near = nearest(&word.to_string(), ["actuated", "driven"]).is_some();
    (is_near || behind.at_any(&["length", "angle"])).then(|| {
        expected!(parser, UNKNOWN_WORD; "`actuated`, `{{` or `;`";
            "did you mean `actuated`? drives are said by `actuated length` or `actuated angle`")
    })
}

/// Values in braces, or none and `;`. Of the keywords that may begin them, some fit the place.
fn values(
    parser: &mut Parser<'_>,
    keywords: &[&str],
    fitting: &[&str],
    help: &str,
    diagnostics: &mut Diagnostics,
) -> Parse<Vec<NamedValue>> {
    let mut values = Vec::new();
    let Some(mut body) = parser.enter(Delimiter::Brace) else {
        parser.expect(";", help)?;
        return Ok(values);
    };
    body.items(
        |parser| parser.at_any(keywords),
        diagnostics,
        |parser, _| {
            parser.docs()?;
            if !parser.at_any(keywords) {
                return Err(unknown_word(parser, fitting, &SYNONYMS));
            }
            values.push(value(parser)?);
            Ok(())
        },
    );
    Ok(values)
}

/// `length = 2.04 m tol 0.3 mm;`, `length = arm;`, `pulled;`
fn value(parser: &mut Parser<'_>) -> Parse<NamedValue> {
    let name = parser.name("a value")?;
    let value = if parser.eat("=").is_some() {
        Some(given(parser)?)
    } else {
        None
    };
    let tolerance = if parser.eat_word("tol").is_some() {
        Some(quantity(parser)?)
    } else {
        None
    };
    if value.is_none() && tolerance.is_none() && name != "pulled" {
        return Err(
            expected!(parser, SYNTAX; "`=` or `tol`"; "write `{name} = value unit tol value unit;`"),
        );
    }
    let exact = parser.eat_word("exact").map(Location::from);
    parser.semicolon()?;
    Ok(NamedValue {
        name,
        value,
        tolerance,
        exact,
    })
}

/// A number or three with a unit, or a formula; of two readings that both fail, the one that gets further is believed.
fn given(parser: &mut Parser<'_>) -> Parse<Given> {
    let ends = |parser: &Parser<'_>| parser.at(";") || parser.at_certainty();
    let mut as_quantity = parser.clone();
    let plain = quantity(&mut as_quantity);
    // `2 m +- 1 mm` would be the formula of a difference.
    if (plain.is_ok() && ends(&as_quantity)) || as_quantity.at_plus_minus() {
        *parser = as_quantity;
        return plain.map(Given::Quantity);
    }
    let mut as_formula = parser.clone();
    let formula = formula::formula(&mut as_formula);
    if formula.is_ok() && ends(&as_formula) {
        *parser = as_formula;
        return formula.map(Given::Formula);
    }
    let reached = |span: proc_macro2::Span| (span.start().line, span.start().column);
    let ends_at = |parser: &Parser<'_>, error: Option<proc_macro2::Span>| {
        reached(error.unwrap_or_else(|| parser.here()))
    };
    let of_quantity = ends_at(&as_quantity, plain.as_ref().err().map(|error| error.span));
    let of_formula = ends_at(&as_formula, formula.as_ref().err().map(|error| error.span));
    // Behind parentheses a unit is that of the numbers in them.
    let next = as_formula.word().filter(|_| formula.is_ok());
    let is_measure = next.is_some_and(|word| find_unit(&word.to_string()).is_some());
    if of_formula > of_quantity && !is_measure {
        *parser = as_formula;
        formula.map(Given::Formula)
    } else {
        *parser = as_quantity;
        plain.map(Given::Quantity)
    }
}

/// `variant Name { … }` or `variant Name = Base + …;` from the name on.
fn variant(
    parser: &mut Parser<'_>,
    docs: Vec<String>,
    diagnostics: &mut Diagnostics,
) -> Parse<Variant> {
    let name = parser.new_name("the variant's name")?;
    if parser.eat("=").is_some() {
        let base = parser.name("the variant to start from")?;
        let mut effects = Vec::new();
        while parser.eat("+").is_some() {
            effects.push(effect_use(parser)?);
        }
        let holds = if parser.eat_word("hold").is_some() {
            all_held(parser)?
        } else {
            Vec::new()
        };
        parser.expect(
            ";",
            "a derived variant reads `Base + effect(place) + … hold parameter, …;`",
        )?;
        return Ok(Variant {
            docs,
            name,
            body: VariantBody::Derived {
                base,
                effects,
                holds,
            },
        });
    }
    let Some(mut body) = parser.enter(Delimiter::Brace) else {
        let help = "a variant reads `variant Name { … }` or `variant Name = Base + effect(place);`";
        return Err(parser.expected(language::SYNTAX, "`{` or `=`").help(help));
    };
    let mut lines = Vec::new();
    let keywords = ["arm", "tracks", "track", "hold"];
    body.items(
        |parser| parser.at_any(&keywords),
        diagnostics,
        |parser, _| {
            parser.docs()?;
            lines.push(variant_line(parser)?);
            Ok(())
        },
    );
    Ok(Variant {
        docs,
        name,
        body: VariantBody::Own(lines),
    })
}

/// `radius, l1.length`
fn all_held(parser: &mut Parser<'_>) -> Parse<Vec<Held>> {
    let mut all = vec![held(parser)?];
    while parser.eat(",").is_some() {
        all.push(held(parser)?);
    }
    Ok(all)
}

/// `radius`, `l1.length`
fn held(parser: &mut Parser<'_>) -> Parse<Held> {
    let name = parser.name("a parameter to hold")?;
    let value = if parser.eat(".").is_some() {
        Some(parser.name("a value of the link")?)
    } else {
        None
    };
    let location = parser.since(&name);
    Ok(Held {
        name,
        value,
        location,
    })
}

fn effect_use(parser: &mut Parser<'_>) -> Parse<EffectUse> {
    let effect = parser.name("an effect")?;
    let Some(mut inside) = parser.enter(Delimiter::Parenthesis) else {
        let help = "say where the effect acts: `effect(track)`, `effect(link)`, `effect(all)` or `effect(tcp)`";
        return Err(parser.expected(language::SYNTAX, "`(`").help(help));
    };
    let mut places = Vec::new();
    while !inside.at_end() {
        places.push(inside.name("a place")?);
        if inside.eat(",").is_none() && !inside.at_end() {
            return Err(
                expected!(inside, MISSING_SEPARATOR; "`,` or `)`"; "places have commas between them"),
            );
        }
    }
    let location = parser.since(&effect);
    let mut with = Vec::new();
    if parser.eat_word("with").is_some() {
        with.push(parser.name("an optional parameter")?);
        while parser.eat(",").is_some() {
            with.push(parser.name("an optional parameter")?);
        }
    }
    let tolerance_factor = if parser.eat_word("tol").is_some() {
        if parser.eat("*").is_none() {
            let help = "write `tol * 10` for ten times the tolerances that the effect gives its parameters";
            return Err(parser.expected(language::SYNTAX, "`*`").help(help));
        }
        Some(number(parser)?)
    } else {
        None
    };
    Ok(EffectUse {
        effect,
        places,
        with,
        tolerance_factor,
        location,
    })
}

/// `arm full;`, `tracks linear;`, `track two piecewise per link;`
fn variant_line(parser: &mut Parser<'_>) -> Parse<VariantLine> {
    let start = parser.here();
    if parser.eat_word("arm").is_some() {
        let arms = [("reduced", Arm::Reduced), ("full", Arm::Full)];
        let arm = choice(parser, &arms, ONE_OF_THESE)?;
        let location = parser.since(start);
        parser.semicolon()?;
        return Ok(VariantLine::Arm { arm, location });
    }
    if parser.eat_word("hold").is_some() {
        let held = all_held(parser)?;
        parser.semicolon()?;
        return Ok(VariantLine::Hold(held));
    }
    let track = if parser.eat_word("track").is_some() {
        Some(parser.name("a track")?)
    } else if parser.eat_word("tracks").is_some() {
        None
    } else {
        return Err(unknown_item(parser, &["arm", "tracks", "track", "hold"]));
    };
    let shape = choice(
        parser,
        &[
            ("linear", TrackShape::Linear),
            ("piecewise", TrackShape::Piecewise),
        ],
        ONE_OF_THESE,
    )?;
    let per_link: Option<Location> = match parser.eat_word("per") {
        Some(start) => {
            parser.expect_word("link", "each link may have its own path: `per link`")?;
            Some(parser.since(start))
        }
        None => None,
    };
    let location = parser.since(start);
    parser.semicolon()?;
    Ok(VariantLine::Tracks {
        track,
        shape,
        per_link,
        location,
    })
}

//! The hidden effect of a trial: an effect at a place, of any size.

use std::f64::consts::TAU;
use std::sync::Arc;

use tau::Robot;
use tau::simulation::{
    CartError, CartReading, DriveReading, Effect, LinkError, Physics, TcpReading,
};
use tau_codegen::language::Model;
use tau_codegen::language::model::{self, Place};
use tau_robot::effects::places;

use crate::answer::True;
use crate::random::Random;

/// Physics at a size.
type OfSize = Box<dyn Fn(f64) -> Physics>;

/// An effect whose size is still open.
pub(crate) struct Hidden {
    pub(crate) name: String,
    /// As results write it: `two`, `all`, `one,two`.
    pub(crate) place: String,
    /// Number of its amplitudes.
    pub(crate) amplitudes: usize,
    /// Its period (m), where that is searched.
    pub(crate) period_m: Option<f64>,
    /// The effect at so many times the tolerance of its amplitudes.
    of_size: Box<dyn Fn(f64) -> Effect>,
}

/// Size found for a hidden effect.
pub(crate) struct Sized {
    pub(crate) effect: Effect,
    pub(crate) tolerances: f64,
    pub(crate) noncentrality: f64,
}

impl Hidden {
    /// An effect of one amplitude that no catalogue has, by its physics at so many times its usual size.
    fn of_one_amplitude(
        robot: &Robot,
        name: &str,
        place: Place,
        physics: impl Fn(f64) -> Physics + 'static,
    ) -> Self {
        let owned = name.to_owned();
        Self {
            name: name.to_owned(),
            place: place_text(robot, place),
            amplitudes: 1,
            period_m: None,
            of_size: Box::new(move |size| Effect::unlisted(&owned, place, physics(size))),
        }
    }

    /// The truth of a trial that hides it.
    pub(crate) fn truth(&self, sized: &Sized) -> True {
        True {
            name: self.name.clone(),
            place: self.place.clone(),
            noncentrality: sized.noncentrality,
            amplitudes: self.amplitudes,
            tolerances: sized.tolerances,
            period_m: self.period_m,
            p_value: None,
        }
    }

    /// The effect at so many times the tolerance of its amplitudes.
    pub(crate) fn of_size(&self, tolerances: f64) -> Effect {
        (self.of_size)(tolerances)
    }

    /// An effect of the catalogue at a random place of those that are meant, in a random direction of its parameters,
    /// with a random period in the range that is searched.
    pub(crate) fn listed(
        robot: &Robot,
        model: &Model,
        name: &str,
        is_meant: impl Fn(Place) -> bool,
        random: &mut Random,
    ) -> Self {
        let mut effects = model.effects.iter();
        let effect = effects.find(|own| own.name == name && !places(model, own).is_empty());
        let effect = effect.expect("an effect of the catalogue").clone();
        let searched = effect.parameters.iter().find_map(|p| p.search);
        // No two racks, screws or gears have a period and a phase in common.
        let possible: Vec<Place> = places(model, &effect)
            .into_iter()
            .filter(|place| is_meant(*place) && (searched.is_none() || !place.is_common()))
            .collect();
        let place = *random.choose(&possible);
        // Evenly in the logarithm.
        let period_m = searched.map(|(low, high)| random.uniform(low.ln(), high.ln()).exp());
        let is_amplitude = |p: &&model::EffectParameter| p.search.is_none() && !p.optional;
        let amplitudes = effect
            .parameters
            .iter()
            .filter(is_amplitude)
            .map(|p| p.components)
            .sum();
        let direction = random.direction(amplitudes);
        let place = place_text(robot, place);
        let (owned, head) = (robot.clone(), format!("{name}({place})"));
        let of_size = move |size: f64| {
            let mut direction = direction.iter();
            let parameters: Vec<String> = effect
                .parameters
                .iter()
                .filter(|parameter| !parameter.optional)
                .map(|parameter| {
                    let tolerance = parameter.tolerance.unwrap_or(1.0);
                    let values: Vec<String> = match period_m {
                        Some(period) if parameter.search.is_some() => vec![format!("{period:?}")],
                        _ => direction
                            .by_ref()
                            .take(parameter.components)
                            .map(|share| format!("{:?}", share * size * tolerance))
                            .collect(),
                    };
                    match values.as_slice() {
                        [value] => format!("{}={value}", parameter.name),
                        values => format!("{}=({})", parameter.name, values.join(", ")),
                    }
                })
                .collect();
            let text = format!("{head}: {}", parameters.join(", "));
            Effect::parse(&text, &owned, "benchmark").expect("an effect that the robot knows")
        };
        Self {
            name: name.to_owned(),
            place,
            amplitudes,
            period_m,
            of_size: Box::new(of_size),
        }
    }

    /// An effect that no catalogue lists.
    pub(crate) fn unlisted(robot: &Robot, name: &str, random: &mut Random) -> Self {
        let cart = Place::Cart {
            track: random.below(robot.tracks.len()),
            source: None,
        };
        let link = random.below(robot.links.len());
        let start = random.uniform(-0.3, 0.35);
        let wave = random.uniform(0.1, 0.5);
        let (way, across) = (random.axis(), random.axis());
        let along = |error: fn(&CartReading, f64, f64) -> f64| {
            move |size: f64| {
                Physics::Cart(Arc::new(move |at: &CartReading| CartError {
                    shift_m: [size * error(at, start, wave), 0.0, 0.0],
                    turn_rad: [0.0; 3],
                }))
            }
        };
        let (place, physics): (Place, OfSize) = match name {
            // Two racks that do not meet.
            "rack_joint" => (
                cart,
                Box::new(along(|at, start, _| {
                    1e-4 * f64::from(u8::from(at.q_m > start))
                })),
            ),
            // A measuring system that is set right once a wave.
            "sawtooth" => (
                cart,
                Box::new(along(|at, start, wave| {
                    1e-4 * (((at.q_m - start) / wave).rem_euclid(1.0) - 0.5)
                })),
            ),
            // Lost motion that grows along the track.
            "growing_backlash" => (
                cart,
                Box::new(along(|at, _, _| 1e-4 * at.direction * at.q_m)),
            ),
            // A link that rolls over something as its cart goes.
            "link_ripple" => (
                Place::Link(link),
                Box::new(move |size| {
                    Physics::Link(Arc::new(move |at| LinkError {
                        length_m: 1e-4 * size * (TAU * (at.q_m - start) / wave).sin(),
                        joint_m: [0.0; 3],
                    }))
                }),
            ),
            // The tracker settles after it was switched on.
            "settling" => (
                Place::Tcp,
                Box::new(move |size| {
                    let at = move |at: &TcpReading| {
                        way.map(|x| 1e-4 * size * x * (1.0 - (-at.time_s / 900.0).exp()))
                    };
                    Physics::Tcp(Arc::new(at))
                }),
            ),
            // Air of uneven temperature bends the beam.
            _ => (
                Place::Tcp,
                Box::new(move |size| {
                    Physics::Tcp(Arc::new(move |at: &TcpReading| {
                        let depth: f64 = across.iter().zip(at.position_m).map(|(a, x)| a * x).sum();
                        way.map(|x| 1e-4 * size * x * (TAU * (depth - start)).sin())
                    }))
                }),
            ),
        };
        Self::of_one_amplitude(robot, name, place, physics)
    }
}

/// Names of the effects that no catalogue lists.
pub(crate) const UNLISTED: [&str; 6] = [
    "rack_joint",
    "sawtooth",
    "growing_backlash",
    "link_ripple",
    "settling",
    "refraction",
];

/// Names of faults of drives and joints that no catalogue lists.
pub(crate) const UNLISTED_OF_DRIVES: [&str; 2] = ["out_of_round", "fine_pitch"];

impl Hidden {
    /// A fault of a drive or of a joint at a random place, that no catalogue lists.
    pub(crate) fn unlisted_of_drive(robot: &Robot, name: &str, random: &mut Random) -> Self {
        let link = random.below(robot.links.len());
        let (way, share) = (random.axis(), random.uniform(0.0, 1.0));
        let phase = random.uniform(0.0, TAU);
        let track = robot.clusters[robot.links[link].cluster].track;
        let (place, physics): (Place, OfSize) = match (name, track) {
            // A ball is longer along one of its axes, so that the link's length depends on the direction in which it stands.
            ("out_of_round", _) => (
                Place::Link(link),
                Box::new(move |size| {
                    Physics::Link(Arc::new(move |at| {
                        let pairs = way.iter().zip(at.direction_on_plate);
                        let along: f64 = pairs.map(|(a, b)| a * b).sum();
                        LinkError {
                            length_m: 1e-4 * size * along.powi(2),
                            joint_m: [0.0; 3],
                        }
                    }))
                }),
            ),
            // Periods below the ranges of the catalogue.
            (_, Some(track)) if !robot.is_crank(track) => {
                let period = 1e-3 + 2e-3 * share;
                let place = Place::Cart {
                    track,
                    source: None,
                };
                let physics = move |size: f64| {
                    Physics::Cart(Arc::new(move |at: &CartReading| CartError {
                        shift_m: [
                            1e-4 * size * (TAU * at.q_m / period + phase).sin(),
                            0.0,
                            0.0,
                        ],
                        turn_rad: [0.0; 3],
                    }))
                };
                (place, Box::new(physics))
            }
            (_, crank) => {
                let (place, amount, period) = match crank {
                    Some(track) => (Place::Crank(track), 1e-3, 0.01 + 0.015 * share),
                    None => (Place::Link(link), 1e-4, 3e-4 + 5e-4 * share),
                };
                let physics = move |size: f64| {
                    Physics::Drive(Arc::new(move |at: &DriveReading| {
                        amount * size * (TAU * at.q / period + phase).sin()
                    }))
                };
                (place, Box::new(physics))
            }
        };
        Self::of_one_amplitude(robot, name, place, physics)
    }
}

/// A place as results write it.
fn place_text(robot: &Robot, place: Place) -> String {
    match place {
        Place::Cart {
            track,
            source: None,
        }
        | Place::Crank(track)
        | Place::CrankCentre(track) => robot.tracks[track].clone(),
        Place::Cart {
            track,
            source: Some(source),
        } => format!("{},{}", robot.tracks[track], robot.tracks[source]),
        Place::Link(link) | Place::BaseJoint(link) => robot.links[link].name.clone(),
        Place::AllCarts | Place::AllLinks | Place::AllCranks | Place::AllBaseJoints => {
            "all".to_owned()
        }
        Place::Tcp => "tcp".to_owned(),
    }
}

//! Listed effects: those of the catalogue, each written by hand from its physics.
//!
//! They carry the names and parameters of the catalogue, but nothing here reads its text: what the estimator finds is
//! found in data that another formula made.

use std::f64::consts::TAU;
use std::sync::Arc;

use tau_codegen::language::model::Place;
use tau_robot::robot::Robot;

use super::effect::{
    BaseReading, CartError, CartReading, DriveReading, LinkError, LinkReading, Physics, TcpReading,
};

/// Subject of a listed effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Subject {
    Cart,
    CartFromSource,
    Link,
    DrivenLink,
    LinkByLength,
    LinkByAngle,
    PulledLink,
    Crank,
    /// All joints on the fixed base and all cranks, which stand on one frame.
    Base,
    Tcp,
}

impl Subject {
    /// The part that it acts on, in words.
    pub(crate) fn described(self) -> &'static str {
        match self {
            Self::Cart | Self::CartFromSource => "carts of tracks",
            Self::Link => "links",
            Self::DrivenLink => "links that a drive lengthens",
            Self::LinkByLength => "links whose drive counts a length",
            Self::LinkByAngle => "links that a drum winds up",
            Self::PulledLink => "links that are pulled",
            Self::Crank => "cranks",
            Self::Base => "joints on the base and cranks, all together",
            Self::Tcp => "the tracker's target",
        }
    }

    /// One of these.
    pub(crate) fn described_one(self) -> &'static str {
        match self {
            Self::Cart | Self::CartFromSource => "a track's cart",
            Self::Crank => "a crank",
            _ => "a link",
        }
    }

    /// True if it acts on links.
    pub(crate) fn is_link(self) -> bool {
        !matches!(
            self,
            Self::Cart | Self::CartFromSource | Self::Crank | Self::Base | Self::Tcp
        )
    }

    /// The single places of a robot that it acts on, by name.
    pub(crate) fn places(self, robot: &Robot) -> Vec<(&str, Place)> {
        let tracks = |are_cranks: bool, place: fn(usize) -> Place| {
            let tracks = robot.tracks.iter().enumerate();
            let tracks = tracks.filter(|(track, _)| robot.is_crank(*track) == are_cranks);
            let places = tracks.map(|(track, name)| (name.as_str(), place(track)));
            places.collect()
        };
        match self {
            Self::Cart | Self::CartFromSource => tracks(false, |track| Place::Cart {
                track,
                source: None,
            }),
            Self::Crank => tracks(true, Place::Crank),
            Self::Base => {
                let mut links = robot.links.iter();
                let is_on_base = |cluster: usize| robot.clusters[cluster].track.is_none();
                let has_cranks = (0..robot.tracks.len()).any(|track| robot.is_crank(track));
                let stands = has_cranks || links.any(|link| is_on_base(link.cluster));
                stands
                    .then_some(("all", Place::AllBaseJoints))
                    .into_iter()
                    .collect()
            }
            Self::Tcp => vec![("tcp", Place::Tcp)],
            _ => {
                let links = robot.links.iter().enumerate();
                let links = links.filter(|(link, _)| self.admits(robot, *link));
                links
                    .map(|(link, own)| (own.name.as_str(), Place::Link(link)))
                    .collect()
            }
        }
    }

    /// The place `all`, if it has one.
    pub(crate) fn all(self) -> Option<Place> {
        match self {
            Self::Cart => Some(Place::AllCarts),
            Self::Crank => Some(Place::AllCranks),
            Self::Base => Some(Place::AllBaseJoints),
            Self::CartFromSource | Self::Tcp => None,
            _ => Some(Place::AllLinks),
        }
    }

    /// True if it acts on a link of an index.
    pub(crate) fn admits(self, robot: &Robot, link: usize) -> bool {
        let link = &robot.links[link];
        let drive = link.actuated_by;
        match self {
            Self::Link => true,
            Self::DrivenLink => drive.is_some(),
            Self::LinkByLength => drive.is_some_and(|drive| !robot.is_angle(drive)),
            Self::LinkByAngle => drive.is_some_and(|drive| robot.is_angle(drive)),
            Self::PulledLink => link.pull.is_some(),
            Self::Cart | Self::CartFromSource | Self::Crank | Self::Base | Self::Tcp => false,
        }
    }
}

/// A parameter of a listed effect.
pub(crate) struct Parameter {
    pub(crate) name: &'static str,
    pub(crate) components: usize,
    pub(crate) unit: &'static str,
    /// True if the effect means nothing without it: a period.
    pub(crate) required: bool,
}

/// A listed effect: its physics as a function of its parameters, one number a component.
pub(crate) struct Listed {
    pub(crate) name: &'static str,
    pub(crate) subject: Subject,
    pub(crate) parameters: &'static [Parameter],
    pub(crate) physics: fn(Vec<f64>) -> Physics,
}

const fn amplitude(name: &'static str, unit: &'static str) -> Parameter {
    Parameter {
        name,
        components: 1,
        unit,
        required: false,
    }
}

const fn vector(name: &'static str, unit: &'static str) -> Parameter {
    Parameter {
        name,
        components: 3,
        unit,
        required: false,
    }
}

const fn period(unit: &'static str) -> Parameter {
    Parameter {
        name: "period",
        components: 1,
        unit,
        required: true,
    }
}

/// All listed effects.
pub(crate) const LISTED: &[Listed] = &[
    Listed {
        name: "rack_pitch",
        subject: Subject::Cart,
        parameters: &[
            amplitude("sine", "m"),
            amplitude("cosine", "m"),
            amplitude("second_sine", "m"),
            amplitude("second_cosine", "m"),
            period("m"),
        ],
        physics: |p| {
            let first = wave(p[0], p[1], p[4]);
            let second = wave(p[2], p[3], 0.5 * p[4]);
            shift(move |at| [first(at.q_m) + second(at.q_m), 0.0, 0.0])
        },
    },
    Listed {
        name: "pinion_eccentricity",
        subject: Subject::Cart,
        parameters: &[
            amplitude("sine", "m"),
            amplitude("cosine", "m"),
            period("m"),
        ],
        physics: |p| {
            let wave = wave(p[0], p[1], p[2]);
            shift(move |at| [wave(at.q_m), 0.0, 0.0])
        },
    },
    Listed {
        name: "positioning_error",
        subject: Subject::Cart,
        parameters: &[amplitude("degree2", "m"), amplitude("degree3", "m")],
        physics: |p| {
            shift(move |at| {
                let [_, second, third] = legendre(at.travel);
                [p[0] * second + p[1] * third, 0.0, 0.0]
            })
        },
    },
    Listed {
        name: "positioning_error",
        subject: Subject::LinkByLength,
        parameters: &[amplitude("degree2", "m"), amplitude("degree3", "m")],
        physics: bent,
    },
    Listed {
        name: "positioning_error",
        subject: Subject::Crank,
        parameters: &[amplitude("degree2", "rad"), amplitude("degree3", "rad")],
        physics: bent,
    },
    Listed {
        name: "straightness",
        subject: Subject::Cart,
        parameters: &[
            amplitude("horizontal2", "m"),
            amplitude("horizontal3", "m"),
            amplitude("vertical2", "m"),
            amplitude("vertical3", "m"),
        ],
        physics: |p| {
            shift(move |at| {
                let [_, second, third] = legendre(at.travel);
                [
                    0.0,
                    p[0] * second + p[1] * third,
                    p[2] * second + p[3] * third,
                ]
            })
        },
    },
    Listed {
        name: "angular_motion",
        subject: Subject::Cart,
        parameters: &[
            amplitude("roll1", "rad"),
            amplitude("roll2", "rad"),
            amplitude("roll3", "rad"),
            amplitude("pitch1", "rad"),
            amplitude("pitch2", "rad"),
            amplitude("pitch3", "rad"),
            amplitude("yaw1", "rad"),
            amplitude("yaw2", "rad"),
            amplitude("yaw3", "rad"),
        ],
        physics: |p| {
            cart(move |at| {
                let shapes = legendre(at.travel);
                let angle = |axis: usize| (0..3).map(|k| p[3 * axis + k] * shapes[k]).sum();
                CartError {
                    shift_m: [0.0; 3],
                    turn_rad: [angle(0), angle(1), angle(2)],
                }
            })
        },
    },
    Listed {
        name: "screw_lead",
        subject: Subject::LinkByLength,
        parameters: &[
            amplitude("sine", "m"),
            amplitude("cosine", "m"),
            period("m"),
        ],
        physics: |p| {
            let wave = wave(p[0], p[1], p[2]);
            drive(move |at| wave(at.q))
        },
    },
    Listed {
        name: "gear_error",
        subject: Subject::Crank,
        parameters: &[
            amplitude("sine", "rad"),
            amplitude("cosine", "rad"),
            period("rad"),
        ],
        physics: |p| {
            let wave = wave(p[0], p[1], p[2]);
            drive(move |at| wave(at.q))
        },
    },
    Listed {
        name: "backlash",
        subject: Subject::Cart,
        parameters: &[amplitude("gap", "m")],
        physics: |p| shift(move |at| [rests(p[0], at.direction), 0.0, 0.0]),
    },
    Listed {
        name: "backlash",
        subject: Subject::LinkByLength,
        parameters: &[amplitude("gap", "m")],
        physics: lost_motion,
    },
    Listed {
        name: "backlash",
        subject: Subject::LinkByAngle,
        parameters: &[amplitude("gap", "rad")],
        physics: lost_motion,
    },
    Listed {
        name: "backlash",
        subject: Subject::Crank,
        parameters: &[amplitude("gap", "rad")],
        physics: lost_motion,
    },
    Listed {
        name: "cart_compliance",
        subject: Subject::Cart,
        parameters: &[
            amplitude("along_compliance", "m/N"),
            amplitude("horizontal_compliance", "m/N"),
            amplitude("vertical_compliance", "m/N"),
        ],
        physics: |p| shift(move |at| [0, 1, 2].map(|axis| p[axis] * at.load_n[axis])),
    },
    Listed {
        name: "link_compliance",
        subject: Subject::Link,
        parameters: &[amplitude("strain", "1/N")],
        physics: |p| length(move |at| at.length_m * p[0] * at.tension_n),
    },
    Listed {
        name: "length_offset",
        subject: Subject::DrivenLink,
        parameters: &[amplitude("offset", "m")],
        physics: |p| length(move |_| p[0]),
    },
    Listed {
        name: "length_scale",
        subject: Subject::LinkByLength,
        parameters: &[amplitude("scale", "1")],
        physics: |p| length(move |at| at.q_m * p[0]),
    },
    Listed {
        name: "drum_radius",
        subject: Subject::LinkByAngle,
        parameters: &[amplitude("error", "1")],
        // A turn pays out a larger circumference.
        physics: |p| length(move |at| (1.0 + p[0]) * at.paid_out_m - at.paid_out_m),
    },
    Listed {
        name: "line_buildup",
        subject: Subject::LinkByAngle,
        parameters: &[amplitude("growth", "1/rad")],
        // The mean radius on the way to the command, over that at command zero.
        physics: |p| {
            length(move |at| {
                let radius = |q: f64| 1.0 - p[0] * q;
                at.paid_out_m * (f64::midpoint(radius(0.0), radius(at.q_m)) - 1.0)
            })
        },
    },
    Listed {
        name: "pull_strain",
        subject: Subject::PulledLink,
        parameters: &[amplitude("strain", "1")],
        physics: |p| length(move |at| p[0] * at.length_m),
    },
    Listed {
        name: "anchor_compliance",
        subject: Subject::DrivenLink,
        parameters: &[amplitude("yielding", "m/N")],
        physics: |p| length(move |at| p[0] * at.tension_n),
    },
    Listed {
        name: "link_thermal",
        subject: Subject::Link,
        parameters: &[amplitude("expansion", "1/K")],
        physics: |p| length(move |at| at.length_m * p[0] * (at.temperature_c - REFERENCE_C)),
    },
    Listed {
        name: "track_thermal",
        subject: Subject::Cart,
        parameters: &[amplitude("expansion", "1/K"), amplitude("shift", "m/K")],
        physics: |p| {
            shift(move |at| {
                let warmer = at.temperature_c - REFERENCE_C;
                [warmer * p[0] * at.q_m + warmer * p[1], 0.0, 0.0]
            })
        },
    },
    Listed {
        name: "base_thermal",
        subject: Subject::Base,
        parameters: &[amplitude("expansion", "1/K"), vector("drift", "m/K")],
        physics: |p| {
            base(move |at| {
                let warmer = at.temperature_c - REFERENCE_C;
                // The frame is larger by a factor, and its fixed point is not the origin.
                let larger = 1.0 + p[0] * warmer;
                [0, 1, 2]
                    .map(|axis| larger * at.point_m[axis] - at.point_m[axis] + warmer * p[1 + axis])
            })
        },
    },
    Listed {
        name: "cart_crosstalk",
        subject: Subject::CartFromSource,
        parameters: &[amplitude("gain", "1")],
        physics: |p| shift(move |at| [p[0] * at.source_q_m, 0.0, 0.0]),
    },
    Listed {
        name: "tracker_drift",
        subject: Subject::Tcp,
        parameters: &[vector("rate", "m/s")],
        physics: |p| tcp(move |at| [0, 1, 2].map(|axis| p[axis] * at.time_s)),
    },
    Listed {
        name: "tracker_scale",
        subject: Subject::Tcp,
        parameters: &[amplitude("scale", "1")],
        // The measured length holds the share, so that it is the true one over 1 − scale.
        physics: |p| tcp(move |at| at.position_m.map(|x| x / (1.0 - p[0]) - x)),
    },
    Listed {
        name: JOINT_PLACEMENT,
        subject: Subject::Link,
        parameters: &[vector("offset", "m")],
        physics: |p| {
            Physics::Link(Arc::new(move |_| LinkError {
                length_m: 0.0,
                joint_m: [p[0], p[1], p[2]],
            }))
        },
    },
];

/// Listed effects that follow the forces in the arm, of which there are none without a payload.
pub(super) const LOADED: [&str; 2] = ["cart_compliance", "link_compliance"];

/// The listed effect that moves plate joints.
pub(crate) const JOINT_PLACEMENT: &str = "joint_placement";

/// Reference temperature of ISO 1 (°C).
const REFERENCE_C: f64 = 20.0;

fn cart(error: impl Fn(&CartReading) -> CartError + Send + Sync + 'static) -> Physics {
    Physics::Cart(Arc::new(error))
}

fn shift(error: impl Fn(&CartReading) -> [f64; 3] + Send + Sync + 'static) -> Physics {
    cart(move |at| CartError {
        shift_m: error(at),
        turn_rad: [0.0; 3],
    })
}

fn drive(error: impl Fn(&DriveReading) -> f64 + Send + Sync + 'static) -> Physics {
    Physics::Drive(Arc::new(error))
}

fn base(error: impl Fn(&BaseReading) -> [f64; 3] + Send + Sync + 'static) -> Physics {
    Physics::Base(Arc::new(error))
}

fn length(error: impl Fn(&LinkReading) -> f64 + Send + Sync + 'static) -> Physics {
    Physics::Link(Arc::new(move |at| LinkError {
        length_m: error(at),
        joint_m: [0.0; 3],
    }))
}

fn tcp(error: impl Fn(&TcpReading) -> [f64; 3] + Send + Sync + 'static) -> Physics {
    Physics::Tcp(Arc::new(error))
}

/// Polynomials of degree 2 and 3 along the travel of a drive.
fn bent(p: Vec<f64>) -> Physics {
    drive(move |at| {
        let [_, second, third] = legendre(at.travel);
        p[0] * second + p[1] * third
    })
}

/// Lost motion of a drive.
fn lost_motion(p: Vec<f64>) -> Physics {
    drive(move |at| rests(p[0], at.direction))
}

/// Where a part rests that has some play: on the flank of the side from which it came, half of the gap from the middle.
fn rests(gap: f64, direction: f64) -> f64 {
    if direction < 0.0 {
        -gap / 2.0
    } else {
        gap / 2.0
    }
}

/// The wave of a wheel, a screw or a rack, once every `period` of travel.
fn wave(sine: f64, cosine: f64, period: f64) -> impl Fn(f64) -> f64 + Send + Sync + 'static {
    let (radius, phase) = (sine.hypot(cosine), cosine.atan2(sine));
    move |q| radius * (TAU * (q / period) + phase).sin()
}

/// Legendre's polynomials of degree 1, 2 and 3, by their recurrence (n+1) Pₙ₊₁ = (2n+1) x Pₙ − n Pₙ₋₁.
fn legendre(x: f64) -> [f64; 3] {
    let second = (3.0 * x * x - 1.0) / 2.0;
    [x, second, (5.0 * x * second - 2.0 * x) / 3.0]
}

#[cfg(test)]
mod tests;

//! Physical errors as functions, each written by hand from its physics.
//!
//! They carry the names and parameters of the catalogue, but nothing here reads its text: what the
//! estimator finds is found in data that another formula made.

use std::f64::consts::TAU;
use std::fmt;
use std::sync::Arc;

use tau_codegen::language::model::Place;
use tau_robot::measurements;

/// When, how warm, and from which side.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Conditions {
    /// Side of approach of each command, ±1.
    pub directions: Vec<f64>,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
    /// Deviation of the length of each link, as its noise has drawn it (m); empty for none.
    pub lengths_m: Vec<f64>,
}

impl Conditions {
    /// As a file of measurements holds them.
    pub(crate) fn recorded(&self) -> measurements::Conditions {
        measurements::Conditions {
            time_s: Some(self.time_s),
            temperature_c: Some(self.temperature_c),
        }
    }
}

/// State of a cart on which its errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartReading {
    /// Command of the cart (m).
    pub q_m: f64,
    /// Command of the source cart (m).
    pub source_q_m: f64,
    /// Side of approach, ±1.
    pub direction: f64,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
    /// Force of the arm on the cart (N): along, horizontal, vertical.
    pub load_n: [f64; 3],
    /// Position of the TCP (m).
    pub tcp_m: [f64; 3],
}

/// An error of a cart, in its track's frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CartError {
    /// Along, horizontal, vertical (m).
    pub shift_m: [f64; 3],
    /// Roll, pitch, yaw as a rotation vector (rad).
    pub turn_rad: [f64; 3],
}

/// State of a link on which its errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkReading {
    /// Length without errors, at command zero (m).
    pub length_m: f64,
    /// Tension (N).
    pub tension_n: f64,
    /// Command of its cart, or of its own length (m, rad of a drum).
    pub q_m: f64,
    /// Line that its drum has paid out since command zero (m); zero without a drum.
    pub paid_out_m: f64,
    /// Side of approach of that command, ±1.
    pub direction: f64,
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
    /// Position of the TCP (m).
    pub tcp_m: [f64; 3],
}

/// An error of a link.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LinkError {
    /// Change of length (m).
    pub length_m: f64,
    /// Displacement of the plate joint in TCP coordinates (m).
    pub joint_m: [f64; 3],
}

/// State of the measurement on which the tracker's errors can depend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TcpReading {
    /// True position of the TCP, or of the target that is measured (m).
    pub position_m: [f64; 3],
    /// Time (s).
    pub time_s: f64,
    /// Temperature (°C).
    pub temperature_c: f64,
}

/// Error of a cart as a function.
pub type CartFunction = dyn Fn(&CartReading) -> CartError + Send + Sync;
/// Error of a link as a function.
pub type LinkFunction = dyn Fn(&LinkReading) -> LinkError + Send + Sync;
/// Error of a measured position (m) as a function.
pub type TcpFunction = dyn Fn(&TcpReading) -> [f64; 3] + Send + Sync;

/// Physics of an error.
#[derive(Clone)]
pub enum Physics {
    /// Displaces a cart.
    Cart(Arc<CartFunction>),
    /// Changes a link.
    Link(Arc<LinkFunction>),
    /// Adds to the measured position of the TCP or of a target (m).
    Tcp(Arc<TcpFunction>),
}

/// The part that it acts on: functions show nothing.
impl fmt::Debug for Physics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cart(_) => "Cart",
            Self::Link(_) => "Link",
            Self::Tcp(_) => "Tcp",
        })
    }
}

/// A physical error at a place of the true machine.
#[derive(Clone)]
pub struct Effect {
    /// Name, of the catalogue where it is one of those.
    pub name: String,
    /// Its place.
    pub place: Place,
    /// Links on which it acts where its place is all that it can act on; `None` where that is every link.
    pub links: Option<Vec<usize>>,
    /// True if the catalogue has it.
    pub listed: bool,
    /// Parameters, SI, in the order of the catalogue; empty for one that is not listed.
    pub parameters: Vec<(String, Vec<f64>)>,
    /// Its physics.
    pub physics: Physics,
}

impl fmt::Debug for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Effect")
            .field("name", &self.name)
            .field("place", &self.place)
            .field("parameters", &self.parameters)
            .finish_non_exhaustive()
    }
}

impl Effect {
    /// An error that no catalogue lists.
    pub fn unlisted(name: &str, place: Place, physics: Physics) -> Self {
        Self {
            name: name.to_owned(),
            place,
            links: None,
            listed: false,
            parameters: Vec::new(),
            physics,
        }
    }

    /// Its function of a cart, with the source it reads, where it acts there.
    pub(crate) fn on_cart(&self, track: usize) -> Option<(&CartFunction, Option<usize>)> {
        let source = match self.place {
            Place::Cart {
                track: place,
                source,
            } if place == track => source,
            Place::AllCarts => None,
            _ => return None,
        };
        match &self.physics {
            Physics::Cart(error) => Some((error.as_ref(), source)),
            _ => None,
        }
    }

    /// Its function of a link, where it acts there.
    pub(crate) fn on_link(&self, link: usize) -> Option<&LinkFunction> {
        match (&self.physics, self.place) {
            (Physics::Link(error), Place::AllLinks) => {
                let is_meant = self.links.as_ref().is_none_or(|own| own.contains(&link));
                is_meant.then_some(error.as_ref())
            }
            (Physics::Link(error), Place::Link(place)) if place == link => Some(error.as_ref()),
            _ => None,
        }
    }

    /// Its function of the TCP, where it acts there.
    pub(crate) fn on_tcp(&self) -> Option<&TcpFunction> {
        match &self.physics {
            Physics::Tcp(error) => Some(error.as_ref()),
            _ => None,
        }
    }
}

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
    Tcp,
}

impl Subject {
    /// The links that it acts on, in words; `None` where it acts on none.
    pub(crate) fn links(self) -> Option<&'static str> {
        match self {
            Self::Link => Some("links"),
            Self::DrivenLink => Some("links that a drive lengthens"),
            Self::LinkByLength => Some("links whose drive counts a length"),
            Self::LinkByAngle => Some("links that a drum winds up"),
            Self::PulledLink => Some("links that are pulled"),
            Self::Cart | Self::CartFromSource | Self::Tcp => None,
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

const PERIOD: Parameter = Parameter {
    name: "period",
    components: 1,
    unit: "m",
    required: true,
};

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
            PERIOD,
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
        parameters: &[amplitude("sine", "m"), amplitude("cosine", "m"), PERIOD],
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
                let [_, second, third] = legendre(at.q_m);
                [p[0] * second + p[1] * third, 0.0, 0.0]
            })
        },
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
                let [_, second, third] = legendre(at.q_m);
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
                let shapes = legendre(at.q_m);
                let angle = |axis: usize| (0..3).map(|k| p[3 * axis + k] * shapes[k]).sum();
                CartError {
                    shift_m: [0.0; 3],
                    turn_rad: [angle(0), angle(1), angle(2)],
                }
            })
        },
    },
    Listed {
        name: "backlash",
        subject: Subject::Cart,
        parameters: &[amplitude("gap", "m")],
        physics: |p| {
            shift(move |at| {
                [
                    if at.direction < 0.0 {
                        -p[0] / 2.0
                    } else {
                        p[0] / 2.0
                    },
                    0.0,
                    0.0,
                ]
            })
        },
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

fn length(error: impl Fn(&LinkReading) -> f64 + Send + Sync + 'static) -> Physics {
    Physics::Link(Arc::new(move |at| LinkError {
        length_m: error(at),
        joint_m: [0.0; 3],
    }))
}

fn tcp(error: impl Fn(&TcpReading) -> [f64; 3] + Send + Sync + 'static) -> Physics {
    Physics::Tcp(Arc::new(error))
}

/// The wave of a wheel or a rack, once every `period` of travel.
fn wave(sine: f64, cosine: f64, period: f64) -> impl Fn(f64) -> f64 + Send + Sync + 'static {
    let (radius, phase) = (sine.hypot(cosine), cosine.atan2(sine));
    move |q| radius * (TAU * (q / period) + phase).sin()
}

/// Legendre's polynomials of degree 1, 2 and 3, by their recurrence (n+1) Pₙ₊₁ = (2n+1) x Pₙ − n Pₙ₋₁.
fn legendre(x: f64) -> [f64; 3] {
    let second = (3.0 * x * x - 1.0) / 2.0;
    [x, second, (5.0 * x * second - 2.0 * x) / 3.0]
}

//! Parts of a robot's variants, as data.

use crate::ResidualFamily;

/// A robot: its description and its variants.
#[derive(Debug, Clone, Copy)]
pub struct Robot {
    /// Name in the description.
    pub name: &'static str,
    /// The whole description, in the language.
    pub description: &'static str,
    /// Variants in order of declaration.
    pub variants: &'static [Variant],
}

/// A choice of arm, tracks and effects: what its generated functions take.
#[derive(Debug, Clone, Copy)]
pub struct Variant {
    /// Name in the description.
    pub name: &'static str,
    /// All parameters that any of its residuals depend on.
    pub parameters: &'static [Parameter],
    /// Residuals: each a family, with the parameters and data it takes.
    pub instances: &'static [Instance],
}

/// Owner of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Owner {
    /// A link, by index.
    Link(usize),
    /// A cluster, by index (reduced arms).
    Cluster(usize),
    /// A track, by index (directions shared by the links of a cart).
    Track(usize),
    /// A crank, by its index among the tracks.
    Crank(usize),
    /// The whole machine.
    Robot,
    /// An effect of the variant, by index in its list.
    Effect(usize),
    /// The tracker frame of set 2 or 3.
    Frame(u8),
    /// The target on a cart in set 2 or 3.
    Target {
        /// 2 or 3.
        set: u8,
        /// Index of the track.
        track: usize,
    },
}

/// A scalar parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Full name, such as `l1.track_offset.x` or `rack_pitch(two).sine`.
    pub name: &'static str,
    /// Its owner.
    pub owner: Owner,
    /// `length`, `plate_joint`, `track_offset`, `track_direction`, `track_rotation`, `centre`, `axis`, `translation`,
    /// `rotation`, `position`, or the name of a parameter of the machine or an effect.
    pub quantity: &'static str,
    /// Component 0, 1 or 2 of a vector.
    pub component: Option<usize>,
    /// SI unit, such as `m`, `rad`, `1`, `m/N`.
    pub unit: &'static str,
    /// Nominal value from the description, SI, where it gives one.
    pub nominal: Option<f64>,
    /// Tolerance (one standard deviation of the prior) from the description, SI.
    pub tolerance: Option<f64>,
    /// Range over which discovery searches it, SI.
    pub search: Option<(f64, f64)>,
}

impl Parameter {
    /// A parameter for which the description gives no values.
    pub const fn new(
        name: &'static str,
        owner: Owner,
        quantity: &'static str,
        component: Option<usize>,
        unit: &'static str,
    ) -> Self {
        Self {
            name,
            owner,
            quantity,
            component,
            unit,
            nominal: None,
            tolerance: None,
            search: None,
        }
    }

    /// The same with a nominal value and a tolerance, SI.
    #[must_use]
    pub const fn with_values(self, nominal: Option<f64>, tolerance: Option<f64>) -> Self {
        Self {
            nominal,
            tolerance,
            ..self
        }
    }

    /// The same with a range to search, SI.
    #[must_use]
    pub const fn with_search(self, search: Option<(f64, f64)>) -> Self {
        Self { search, ..self }
    }
}

/// Kind of an instance's residual.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResidualKind {
    /// `L² − ‖T + R P − C(q)‖²` (m²) at a pose of set 1: of a link, or of a cluster where the arm is reduced.
    Closure,
    /// The same as a function of the plate's pose and the commands, for kinematics.
    ///
    /// The pose and the commands are data of the sample. The Jacobian has the columns translation (x, y, z), rotation
    /// vector in the measurement frame (x, y, z; free of the Euler angles' singularity), and the commands among
    /// [`Instance::inputs`], in their order; none for the parameters.
    ClosureByPose,
    /// Position (m) and rotation (rad) of a cart's target in set 2: six residuals.
    CartPose,
    /// Position (m) of a cart's target in set 3: three residuals.
    CartPosition,
    /// Error of the tracker along an axis (m), measured less true position: of the measured position and the parameters of
    /// effects on `tcp`; three instances where a variant has such effects. Closures have it in them already.
    TrackerError,
}

/// A residual family applied to a link, a cluster or a cart.
#[derive(Debug, Clone, Copy)]
pub struct Instance {
    /// Kind of its residual.
    pub kind: ResidualKind,
    /// Index of the link (full arm), cluster (reduced arm), track (`CartPose`, `CartPosition`) or axis (`TrackerError`).
    pub of: usize,
    /// The function; instances of the same form share it.
    pub family: &'static dyn ResidualFamily,
    /// For each parameter of the family, its index in [`Variant::parameters`].
    pub parameters: &'static [u32],
    /// For each datum of the family, what to fill in.
    pub inputs: &'static [Input],
}

/// A number that a sample brings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Input {
    /// Commanded position (m) or angle (rad), by index of the command.
    Command(usize),
    /// Measured position x, y, z (m): of the TCP (set 1) or of the target (sets 2 and 3, registered).
    Position(usize),
    /// Measured ZYZ Euler angle alpha, beta, gamma (rad); of a target, registered.
    Angle(usize),
    /// Entry of the rotation matrix of the plate in the measurement frame, by rows.
    Rotation(usize),
    /// Position x, y, z of the TCP (m), where an effect reads it in a residual of set 2 or 3.
    TcpPosition(usize),
    /// Side of approach, ±1, by index of the command.
    Direction(usize),
    /// Time (s).
    Time,
    /// Temperature (°C).
    Temperature,
    /// Force of the arm on a cart (N): along, horizontal, vertical.
    Load {
        /// Index of the track.
        track: usize,
        /// 0 along, 1 horizontal, 2 vertical.
        component: usize,
    },
    /// Tension of a link (N), by index.
    Tension(usize),
    /// Tension (N) to which a link is pulled, by index, with which forces were computed.
    Pull(usize),
    /// Tension of a link for each newton more to which another, or itself, is pulled.
    TensionByPull {
        /// Index of the link.
        link: usize,
        /// Index of the one that is pulled.
        pulled: usize,
    },
    /// Force of the arm on a cart for each newton more to which a link is pulled: along, horizontal, vertical.
    LoadByPull {
        /// Index of the track.
        track: usize,
        /// 0 along, 1 horizontal, 2 vertical.
        component: usize,
        /// Index of the link that is pulled.
        pulled: usize,
    },
    /// Start of the track segment that holds the command, in the measurement frame relative to the
    /// track's point at q = 0 (m).
    SegmentStart {
        /// Index of the track.
        track: usize,
        /// Component 0, 1 or 2.
        component: usize,
    },
    /// End of that segment (m), likewise.
    SegmentEnd {
        /// Index of the track.
        track: usize,
        /// Component 0, 1 or 2.
        component: usize,
    },
    /// Command at the start of that segment (m).
    SegmentStartCommand(usize),
    /// Command at its end (m).
    SegmentEndCommand(usize),
    /// Value of a parameter that the variant holds, by its index in [`Variant::parameters`].
    Held(usize),
    /// Middle of the travel of a drive (m or rad), by index of the command.
    TravelMiddle(usize),
    /// Half of that travel (m or rad).
    TravelHalf(usize),
}

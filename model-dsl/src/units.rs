//! Units and dimensions.

use std::fmt::Write as _;

/// Exponents of the base quantities. An angle is a dimension of its own here, so that adding an angle
/// to a length is an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, PartialOrd, Ord)]
pub struct Dimension {
    /// Metre.
    pub length: i8,
    /// Kilogram.
    pub mass: i8,
    /// Second.
    pub time: i8,
    /// Kelvin.
    pub temperature: i8,
    /// Radian.
    pub angle: i8,
}

impl Dimension {
    /// A number without unit.
    pub const NUMBER: Self = Self::of(0, 0, 0, 0, 0);
    /// Length (m).
    pub const LENGTH: Self = Self::of(1, 0, 0, 0, 0);
    /// Mass (kg).
    pub const MASS: Self = Self::of(0, 1, 0, 0, 0);
    /// Time (s).
    pub const TIME: Self = Self::of(0, 0, 1, 0, 0);
    /// Temperature (K).
    pub const TEMPERATURE: Self = Self::of(0, 0, 0, 1, 0);
    /// Angle (rad).
    pub const ANGLE: Self = Self::of(0, 0, 0, 0, 1);
    /// Force (N).
    pub const FORCE: Self = Self::of(1, 1, -2, 0, 0);

    const fn of(length: i8, mass: i8, time: i8, temperature: i8, angle: i8) -> Self {
        Self {
            length,
            mass,
            time,
            temperature,
            angle,
        }
    }

    /// Dimension of a product; `None` if an exponent leaves the range of `i8`.
    pub fn multiply(self, other: Self) -> Option<Self> {
        self.combine(other, i8::checked_add)
    }

    /// Dimension of a quotient; `None` if an exponent leaves the range of `i8`.
    pub fn divide(self, other: Self) -> Option<Self> {
        self.combine(other, i8::checked_sub)
    }

    /// Dimension of a whole power; `None` if an exponent leaves the range of `i8`.
    pub fn power(self, exponent: i32) -> Option<Self> {
        self.map(|base| i8::try_from(i32::from(base).checked_mul(exponent)?).ok())
    }

    /// Dimension of a square root; `None` if an exponent is odd.
    pub fn square_root(self) -> Option<Self> {
        self.map(|base| (base % 2 == 0).then_some(base / 2))
    }

    /// Text of the coherent SI unit: `m`, `rad`, `1`, `m/N`, `m/s`. The language reads it back.
    pub fn si_unit(self) -> String {
        let (above, below) = self.si_fraction();
        above + &below
    }

    /// The same in two parts: what multiplies, and what divides from the first `/` on.
    pub fn si_fraction(self) -> (String, String) {
        // With force in place of mass where that leaves no seconds: `m/N`, not `s^2/kg`.
        let (mass, time) = (i16::from(self.mass), i16::from(self.time));
        let force = if mass != 0 && time + 2 * mass == 0 {
            mass
        } else {
            0
        };
        let factors = [
            ("N", force),
            ("kg", mass - force),
            ("m", i16::from(self.length) - force),
            ("rad", self.angle.into()),
            ("K", self.temperature.into()),
            ("s", time + 2 * force),
        ];
        let (mut above, mut below) = (String::new(), String::new());
        for (unit, exponent) in factors.into_iter().filter(|(_, exponent)| *exponent > 0) {
            append(&mut above, '*', unit, exponent);
        }
        if above.is_empty() {
            above.push('1');
        }
        for (unit, exponent) in factors.into_iter().filter(|(_, exponent)| *exponent < 0) {
            append(&mut below, '/', unit, -exponent);
        }
        (above, below)
    }

    /// The dimension in words where it has a name, with its unit: `length (m)`, `number`, `m/K`.
    pub fn describe(self) -> String {
        if self == Self::NUMBER {
            return "number".to_owned();
        }
        let unit = self.si_unit();
        match DIMENSIONS.iter().find(|(_, dimension)| *dimension == self) {
            Some((name, _)) => format!("{name} ({unit})"),
            None => format!("`{unit}`"),
        }
    }

    fn combine(self, other: Self, operation: fn(i8, i8) -> Option<i8>) -> Option<Self> {
        Some(Self {
            length: operation(self.length, other.length)?,
            mass: operation(self.mass, other.mass)?,
            time: operation(self.time, other.time)?,
            temperature: operation(self.temperature, other.temperature)?,
            angle: operation(self.angle, other.angle)?,
        })
    }

    fn map(self, operation: impl Fn(i8) -> Option<i8>) -> Option<Self> {
        Some(Self {
            length: operation(self.length)?,
            mass: operation(self.mass)?,
            time: operation(self.time)?,
            temperature: operation(self.temperature)?,
            angle: operation(self.angle)?,
        })
    }
}

fn append(text: &mut String, operator: char, unit: &str, exponent: i16) {
    if operator == '/' || !text.is_empty() {
        text.push(operator);
    }
    text.push_str(unit);
    if exponent != 1 {
        // Writing to a string cannot fail.
        let _ = write!(text, "^{exponent}");
    }
}

/// A unit: its name, its size in the coherent SI unit of its dimension, and that dimension.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// As it is written.
    pub name: &'static str,
    /// SI units in one of it.
    pub factor: f64,
    /// Its dimension.
    pub dimension: Dimension,
}

const fn unit(name: &'static str, factor: f64, dimension: Dimension) -> Unit {
    Unit {
        name,
        factor,
        dimension,
    }
}

/// Every unit that the language knows.
pub const UNITS: [Unit; 28] = [
    unit("m", 1.0, Dimension::LENGTH),
    unit("km", 1e3, Dimension::LENGTH),
    unit("cm", 1e-2, Dimension::LENGTH),
    unit("mm", 1e-3, Dimension::LENGTH),
    unit("um", 1e-6, Dimension::LENGTH),
    unit("nm", 1e-9, Dimension::LENGTH),
    unit("rad", 1.0, Dimension::ANGLE),
    unit("mrad", 1e-3, Dimension::ANGLE),
    unit("urad", 1e-6, Dimension::ANGLE),
    unit("deg", std::f64::consts::PI / 180.0, Dimension::ANGLE),
    unit("arcmin", std::f64::consts::PI / 10_800.0, Dimension::ANGLE),
    unit("arcsec", std::f64::consts::PI / 648_000.0, Dimension::ANGLE),
    unit("s", 1.0, Dimension::TIME),
    unit("ms", 1e-3, Dimension::TIME),
    unit("min", 60.0, Dimension::TIME),
    unit("h", 3600.0, Dimension::TIME),
    unit("K", 1.0, Dimension::TEMPERATURE),
    unit("mK", 1e-3, Dimension::TEMPERATURE),
    unit("kg", 1.0, Dimension::MASS),
    unit("g", 1e-3, Dimension::MASS),
    unit("N", 1.0, Dimension::FORCE),
    unit("kN", 1e3, Dimension::FORCE),
    unit("Pa", 1.0, PRESSURE),
    unit("MPa", 1e6, PRESSURE),
    unit("GPa", 1e9, PRESSURE),
    unit("Hz", 1.0, FREQUENCY),
    unit("percent", 1e-2, Dimension::NUMBER),
    unit("ppm", 1e-6, Dimension::NUMBER),
];

/// A value in SI units, from one in units of a size.
///
/// Divides where the size is a decimal fraction, so that `100 um` is the number nearest to 1e-4.
pub(crate) fn to_si(value: f64, size: f64) -> f64 {
    let per_si = (1.0 / size).round();
    let fraction = size < 1.0 && (per_si * size - 1.0).abs() <= f64::EPSILON;
    if fraction {
        value / per_si
    } else {
        value * size
    }
}

/// The unit of a name.
pub fn find_unit(name: &str) -> Option<Unit> {
    UNITS.into_iter().find(|unit| unit.name == name)
}

const PRESSURE: Dimension = Dimension::of(-1, 1, -2, 0, 0);
const FREQUENCY: Dimension = Dimension::of(0, 0, -1, 0, 0);

/// Names for dimensions, usable wherever one is wanted: `param sine: length`.
pub const DIMENSIONS: [(&str, Dimension); 20] = [
    ("number", Dimension::NUMBER),
    ("ratio", Dimension::NUMBER),
    ("length", Dimension::LENGTH),
    ("angle", Dimension::ANGLE),
    ("time", Dimension::TIME),
    ("temperature", Dimension::TEMPERATURE),
    ("mass", Dimension::MASS),
    ("force", Dimension::FORCE),
    ("torque", Dimension::of(2, 1, -2, 0, 0)),
    ("pressure", PRESSURE),
    ("area", Dimension::of(2, 0, 0, 0, 0)),
    ("volume", Dimension::of(3, 0, 0, 0, 0)),
    ("curvature", Dimension::of(-1, 0, 0, 0, 0)),
    ("velocity", Dimension::of(1, 0, -1, 0, 0)),
    ("acceleration", Dimension::of(1, 0, -2, 0, 0)),
    ("angular_velocity", Dimension::of(0, 0, -1, 0, 1)),
    ("frequency", FREQUENCY),
    ("compliance", Dimension::of(0, -1, 2, 0, 0)),
    ("stiffness", Dimension::of(0, 1, -2, 0, 0)),
    ("expansion", Dimension::of(0, 0, 0, -1, 0)),
];

/// The dimension of a name.
pub fn find_dimension(name: &str) -> Option<Dimension> {
    DIMENSIONS
        .iter()
        .find(|(own, _)| *own == name)
        .map(|(_, dimension)| *dimension)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{DIMENSIONS, Dimension, UNITS, find_dimension, find_unit, to_si};
    use crate::tests::dimension_of;

    #[test]
    fn si_units() {
        let compliance = find_dimension("compliance").unwrap();
        for (dimension, text) in [
            (Dimension::NUMBER, "1"),
            (Dimension::LENGTH, "m"),
            (Dimension::ANGLE, "rad"),
            (Dimension::FORCE, "N"),
            (Dimension::MASS, "kg"),
            (compliance, "m/N"),
            (Dimension::NUMBER.divide(Dimension::FORCE).unwrap(), "1/N"),
            (Dimension::LENGTH.divide(Dimension::TIME).unwrap(), "m/s"),
            (
                Dimension::NUMBER.divide(Dimension::TEMPERATURE).unwrap(),
                "1/K",
            ),
            (Dimension::LENGTH.power(-2).unwrap(), "1/m^2"),
            (Dimension::MASS.multiply(Dimension::LENGTH).unwrap(), "kg*m"),
        ] {
            assert_eq!(dimension.si_unit(), text);
        }
    }

    #[test]
    fn sizes() {
        for (value, unit, si) in [
            (100.0, "um", 1e-4),
            (0.3, "mm", 3e-4),
            (180.0, "deg", std::f64::consts::PI),
            (3600.0, "arcsec", std::f64::consts::PI / 180.0),
            (2.0, "h", 7200.0),
            (7.0, "ppm", 7e-6),
            (1.5, "kN", 1500.0),
        ] {
            let found = to_si(value, find_unit(unit).unwrap().factor);
            assert!(
                (found - si).abs() <= f64::EPSILON * si,
                "{value} {unit} is {found}"
            );
        }
        // Decimal fractions come out as if they had been written in SI units.
        assert_eq!(to_si(100.0, 1e-6).to_bits(), 1e-4_f64.to_bits());
    }

    #[test]
    fn exponents_do_not_wrap() {
        let large = Dimension::LENGTH.power(100).unwrap();
        assert_eq!(large.multiply(large), None);
        assert_eq!(large.power(2), None);
        assert_eq!(Dimension::LENGTH.power(i32::MAX), None);
        assert_eq!(Dimension::LENGTH.square_root(), None);
        assert_eq!(large.square_root(), Dimension::LENGTH.power(50));
    }

    #[test]
    fn names_are_distinct() {
        for (index, unit) in UNITS.iter().enumerate() {
            assert!(
                UNITS[..index].iter().all(|other| other.name != unit.name),
                "{}",
                unit.name
            );
        }
        for (index, (name, _)) in DIMENSIONS.iter().enumerate() {
            assert!(
                DIMENSIONS[..index].iter().all(|(other, _)| other != name),
                "{name}"
            );
            assert!(find_unit(name).is_none(), "`{name}` is a unit too");
        }
    }

    proptest! {
        #[test]
        fn the_language_reads_units_back(
            length in -9i8..9, mass in -9i8..9, time in -9i8..9, temperature in -9i8..9, angle in -9i8..9,
        ) {
            let dimension = Dimension { length, mass, time, temperature, angle };
            prop_assert_eq!(dimension_of(&dimension.si_unit()), dimension);
        }
    }
}

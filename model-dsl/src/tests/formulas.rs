//! Formulas: precedence, numbers, units, vectors.

use insta::assert_snapshot;

use super::{errors, model, robot, with_formula};
use crate::model::{BinaryOperator, Formula};

/// A formula with all its parentheses.
fn show(formula: &Formula) -> String {
    match formula {
        Formula::Number(value) => format!("{value}"),
        Formula::Parameter(index, component) => format!("p{index}.{component}"),
        Formula::OfRobot(..) | Formula::OfLink(..) => unreachable!("effects read neither"),
        Formula::Read(quantity) => format!("{quantity:?}"),
        Formula::Negate(inner) => format!("(-{})", show(inner)),
        Formula::Binary(operator, left, right) => {
            let sign = match operator {
                BinaryOperator::Add => '+',
                BinaryOperator::Subtract => '-',
                BinaryOperator::Multiply => '*',
                BinaryOperator::Divide => '/',
            };
            format!("({} {sign} {})", show(left), show(right))
        }
        Formula::Power(base, exponent) => format!("{}^{exponent}", show(base)),
        Formula::Call(function, arguments) => {
            let arguments: Vec<_> = arguments.iter().map(show).collect();
            format!("{function:?}({})", arguments.join(", "))
        }
        Formula::Vector(components) => {
            let [x, y, z] = &**components;
            format!("[{}, {}, {}]", show(x), show(y), show(z))
        }
    }
}

/// A formula for `along`, as read.
fn read(formula: &str) -> String {
    let model = model(&with_formula(formula));
    show(&model.effects[0].terms[1].formula)
}

/// The mistake in a formula for `along`.
fn wrong(formula: &str) -> String {
    errors(&with_formula(formula))
}

/// A formula for `position`, as read, with a vector `rate` and a scalar `gain`.
fn read_vector(formula: &str) -> String {
    let model = model(&robot(&format!(
        "effect drift on tcp {{
            param rate[3]: velocity;
            param gain: number;
            position += rate * time * gain;
            position += {formula};
        }}"
    )));
    show(&model.effects[0].terms[1].formula)
}

#[test]
fn operators_bind_as_in_books() {
    assert_snapshot!(read("gap + q * gain - gap"), @"((p0.0 + (Command * p3.0)) - p0.0)");
    assert_snapshot!(read("gap / 2 / gain * 3"), @"(((p0.0 / 2) / p3.0) * 3)");
    assert_snapshot!(read("-q^2 * bend"), @"((-Command^2) * p1.0)");
    assert_snapshot!(read("gap * -gain"), @"(p0.0 * (-p3.0))");
    assert_snapshot!(read("(gap + q) * gain^-3"), @"((p0.0 + Command) * p3.0^-3)");
    assert_snapshot!(read("gap * (-gain)^2"), @"(p0.0 * (-p3.0)^2)");
}

#[test]
fn numbers_bind_their_unit() {
    assert_snapshot!(read("1 / 2 mm * q^2"), @"((1 / 0.002) * Command^2)");
    assert_snapshot!(read("3 mm^2 * bend"), @"(0.000003 * p1.0)");
    assert_snapshot!(read("2 um/N * load_along"), @"((0.000002 / 1) * LoadAlong)");
    assert_snapshot!(read("load_along / N * gap"), @"((LoadAlong / 1) * p0.0)");
    assert_snapshot!(read("1_000.5e-2 mm"), @"0.010005");
    assert_snapshot!(read("gap * (temperature - 20 K) / (5 mK)"), @"((p0.0 * (Temperature - 20)) / 0.005)");
}

#[test]
fn functions_take_units() {
    assert_snapshot!(read("gap * sin(2*pi*q/(20 mm) + phase)"), @"(p0.0 * Sin(((((2 * 3.141592653589793) * Command) / 0.02) + p2.0)))");
    assert_snapshot!(read("gap * cos(90 deg)"), @"(p0.0 * Cos(1.5707963267948966))");
    assert_snapshot!(read("sqrt(q^2 + gap^2)"), @"Sqrt((Command^2 + p0.0^2))");
    assert_snapshot!(read("max(abs(q), min(gap, 1 mm)) * sign(q)"), @"(Max(Abs(Command), Min(p0.0, 0.001)) * Sign(Command))");
    assert_snapshot!(read("gap * atan(q / gap) / (1 rad)"), @"((p0.0 * Atan((Command / p0.0))) / 1)");
    assert_snapshot!(read("gap * exp(-time / (2 h)) * ln(gain) * tanh(gain) * tan(phase)"), @"((((p0.0 * Exp(((-Time) / 7200))) * Ln(p3.0)) * Tanh(p3.0)) * Tan(p2.0))");
}

#[test]
fn commands_of_other_carts() {
    assert_snapshot!(read("gain * q(two) + q"), @"((p3.0 * CommandOf(1)) + Command)");
}

#[test]
fn vectors_become_components() {
    assert_snapshot!(read_vector("rate * time"), @"[(p0.0 * Time), (p0.1 * Time), (p0.2 * Time)]");
    assert_snapshot!(read_vector("gain * (x, y, z) - (1 mm, 0 m, z) / 2"), @"[((p1.0 * Position(0)) - (0.001 / 2)), ((p1.0 * Position(1)) - (0 / 2)), ((p1.0 * Position(2)) - (Position(2) / 2))]");
    assert_snapshot!(read_vector("-(rate[2] * time, x, y)"), @"[(-(p0.2 * Time)), (-Position(0)), (-Position(1))]");
}

#[test]
fn numbers_stand_for_angles() {
    let turned = robot(
        "effect turn on cart {
            param a: rad/m;
            param b: 1/m;
            roll += a * q;
            pitch += b * q;
            yaw += a * q + b * q;
        }",
    );
    assert_eq!(model(&turned).effects[0].terms.len(), 3);
}

#[test]
fn dimensions_do_not_mix() {
    assert_snapshot!(wrong("gap + phase"), @r"
    along += gap + phase;
             ^^^^^^^^^^^
    cannot add length (m) and angle (rad)
    help: both sides must have the same dimension
    ");
    assert_snapshot!(wrong("gap * phase"), @r"
    along += gap * phase;
             ^^^^^^^^^^^
    `along` is length (m), but this formula is `m*rad`
    help: divide an angle by `1 rad` to make a number of it
    ");
    assert_snapshot!(wrong("gap * q"), @r"
    along += gap * q;
             ^^^^^^^
    `along` is length (m), but this formula is area (m^2)
    help: the formula must come out in `m`; it is off by a factor in `m`
    ");
    assert_snapshot!(wrong("load_along * time"), @r"
    along += load_along * time;
             ^^^^^^^^^^^^^^^^^
    `along` is length (m), but this formula is `kg*m/s`
    help: the formula must come out in `m`; it is off by a factor in `kg/s`
    ");
    assert_snapshot!(wrong("gap * atan(phase)"), @r"
    along += gap * atan(phase);
                        ^^^^^
    `atan` takes a number, found angle (rad)
    help: divide by something in `rad`
    ");
    assert_snapshot!(wrong("min(gap, phase)"), @r"
    along += min(gap, phase);
             ^^^^^^^^^^^^^^^
    `min` cannot compare length (m) and angle (rad)
    help: both sides must have the same dimension
    ");
    assert_snapshot!(wrong("gap * exp(time)"), @r"
    along += gap * exp(time);
                       ^^^^
    `exp` takes a number, found time (s)
    help: divide by something in `s`
    ");
}

#[test]
fn shapes_do_not_mix() {
    assert_snapshot!(wrong("shift * gain"), @r"
    along += shift * gain;
             ^^^^^^^^^^^^
    `along` is a scalar, but this formula is a vector
    help: use one component, such as `rate[0]`
    ");
    assert_snapshot!(wrong("gap + shift"), @r"
    along += gap + shift;
             ^^^^^^^^^^^
    cannot add a scalar and a vector
    help: vectors add to vectors; multiply or divide them by scalars, or use components, such as `rate[0]`
    ");
    assert_snapshot!(wrong("gap / shift"), @r"
    along += gap / shift;
             ^^^^^^^^^^^
    cannot divide a scalar by a vector
    help: vectors add to vectors; multiply or divide them by scalars, or use components, such as `rate[0]`
    ");
    assert_snapshot!(wrong("shift^2"), @r"
    along += shift^2;
             ^^^^^^^
    a vector has no power
    help: take the power of a component, such as `rate[0]^2`
    ");
    assert_snapshot!(wrong("(gap, shift, gap)"), @r"
    along += (gap, shift, gap);
                   ^^^^^
    a component of a vector cannot be a vector
    help: write a scalar
    ");
    assert_snapshot!(wrong("(gap, gap)"), @r"
    along += (gap, gap);
             ^^^^^^^^^^
    a vector has 3 components, found 2
    help: write `(x, y, z)`
    ");
}

#[test]
fn numbers_that_are_not() {
    assert_snapshot!(wrong("1e400 m"), @r"
    along += 1e400 m;
             ^^^^^
    `1e400` is too large
    help: numbers end at 1.7976931348623157e308
    ");
    assert_snapshot!(wrong("1e308 km"), @r"
    along += 1e308 km;
             ^^^^^^^^
    this value is too large
    help: numbers end at 1.7976931348623157e308
    ");
    assert_snapshot!(wrong("3 km^100"), @r"
    along += 3 km^100;
             ^^^^^^^^
    `along` is length (m), but this formula is `m^100`
    help: the formula must come out in `m`; it is off by a factor in `m^99`
    ");
    assert_snapshot!(wrong("2f64 * gap"), @r"
    along += 2f64 * gap;
             ^^^^
    `2f64` is not a decimal number
    help: `f64` does not belong there
    ");
    assert_snapshot!(wrong("\"2\" * gap"), @r#"
    along += "2" * gap;
             ^^^
    expected a number, found `"2"`
    help: a number is decimal, such as `2`, `0.5` or `1e-3`
    "#);
    assert_snapshot!(wrong("gap^1000"), @r"
    along += gap^1000;
                 ^^^^
    this exponent is too large
    help: exponents end at 100
    ");
    assert_snapshot!(wrong("gap^2^3"), @r"
    along += gap^2^3;
                  ^
    expected an operator, found `^`
    help: write parentheses: `(q^2)^3`
    ");
}

#[test]
fn words_out_of_place() {
    assert_snapshot!(wrong("sin * gap"), @r"
    along += sin * gap;
             ^^^
    `sin` is a function
    help: write `sin(…)`
    ");
    assert_snapshot!(wrong("gap(q)"), @r"
    along += gap(q);
             ^^^
    `gap` is not a function
    help: for a product write `gap * (…)`
    ");
    assert_snapshot!(wrong("q[0]"), @r"
    along += q[0];
             ^^^^
    `q` is a scalar and has no components
    help: write `q`
    ");
    assert_snapshot!(wrong("q(two, one)"), @r"
    along += q(two, one);
             ^^^^^^^^^^^
    `q(…)` takes the name of one track
    help: write `q(track)`, or `q * (…)` for a product
    ");
    assert_snapshot!(wrong("q(gap + q)"), @r"
    along += q(gap + q);
             ^^^^^^^^^^
    `q(…)` takes the name of one track
    help: write `q(track)`, or `q * (…)` for a product
    ");
    assert_snapshot!(wrong("gap * --gain"), @r"
    along += gap * --gain;
                   ^
    two signs in a row
    help: write one sign, or parentheses
    ");
    assert_snapshot!(wrong("gap * ()"), @r"
    along += gap * ();
                   ^^
    empty parentheses
    help: write a value, or a vector `(x, y, z)`
    ");
    assert_snapshot!(wrong("gap gain"), @r"
    along += gap gain;
                 ^^^^
    expected `;`, found `gain`
    help: a term ends with `;`, and its formula has an operator between any two values
    ");
}

#[test]
fn depth_is_bounded() {
    let deep = format!("{}gap{}", "(".repeat(100), ")".repeat(100));
    assert!(wrong(&deep).contains("brackets nested more than 64 deep"));
    let long = format!("gap{}", " + gap".repeat(300));
    assert!(wrong(&long).contains("more than 256 levels"));
    let fits = format!("gap{}", " + gap".repeat(200));
    assert_eq!(wrong(&fits), "no errors");
}

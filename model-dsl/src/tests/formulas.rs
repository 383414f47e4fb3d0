//! Formulas: precedence, numbers, units, vectors.

use insta::assert_snapshot;

use super::{model, robot, with_formula};
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
fn long_formulas_are_read() {
    let fits = format!("gap{}", " + gap".repeat(200));
    model(&with_formula(&fits));
}

/// A sign behind an operator is one of a formula, and `percent` a unit.
#[test]
fn signs_and_shares() {
    model(&with_formula("gap + -gap"));
    model(&robot(
        "effect e on cart { param a: ratio = 1 percent tol 10 percent; along += a * q; }",
    ));
}

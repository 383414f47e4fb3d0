//! Tests of the symbolic engine on small expressions.

use proptest::prelude::*;

use crate::differentiate::gradient;
use crate::equations::{self, Context, Equations, Staging};
use crate::evaluate::evaluate;
use crate::graph::{Elementary, Expr, Graph, Node, Stage, Symbol};
use crate::lower::{Programs, lower};
use crate::program::{Operand, Operation, Program};

const GANTRY_TAU: &str = include_str!("../../generated/models/gantry_tau.tau");

fn symbols(graph: &mut Graph, count: usize) -> Vec<Expr> {
    (0..count)
        .map(|i| graph.symbol(format!("s{i}"), Stage::Parameter))
        .collect()
}

#[test]
fn equal_expressions_are_one_node() {
    let mut g = Graph::new();
    let s = symbols(&mut g, 2);
    assert_eq!(g.add(s[0], s[1]), g.add(s[1], s[0]));
    let (p, q) = (g.multiply(s[0], s[1]), g.multiply(s[1], s[0]));
    assert_eq!(p, q);
}

#[test]
fn construction_simplifies() {
    let mut g = Graph::new();
    let x = symbols(&mut g, 1)[0];
    let (zero, one, two) = (g.constant(0.0), g.constant(1.0), g.constant(2.0));
    assert_eq!(g.add(x, zero), x);
    assert_eq!(g.multiply(x, one), x);
    assert_eq!(g.multiply(x, zero), zero);
    assert_eq!(g.subtract(x, x), zero);
    let minus = g.negate(x);
    assert_eq!(g.negate(minus), x);
    assert_eq!(g.add(x, x), g.multiply(two, x));
    let minus_two = g.constant(-2.0);
    let (a, b) = (g.multiply(minus_two, x), g.multiply(two, minus));
    assert_eq!(a, b);
    let (sine, of_minus) = (g.apply(Elementary::Sin, x), g.apply(Elementary::Sin, minus));
    assert_eq!(of_minus, g.negate(sine));
    assert_eq!(g.turn(zero, x, one), (x, one));
}

/// An operation that would fold to an infinity stays: Rust has no literal for it.
#[test]
fn constants_fold_while_they_are_finite() {
    let mut g = Graph::new();
    let x = symbols(&mut g, 1)[0];
    let (large, zero) = (g.constant(1e300), g.constant(0.0));
    let minus = g.negate(large);
    let power = g.power(large, 2);
    let inner = g.multiply(large, x);
    let nested = g.multiply(large, inner);
    let quotient = g.divide(large, zero);
    let mut sum = g.multiply(minus, large);
    for _ in 0..2 {
        sum = g.add(sum, minus);
    }
    for expr in [power, nested, quotient, sum] {
        for node in g.reachable(&[expr]) {
            assert!(g.constant_value(node).is_none_or(f64::is_finite));
        }
        assert!(evaluate(&g, &[expr], &[1.0])[0].is_infinite());
    }
    let small = g.constant(1e-300);
    let (one, product) = (g.constant(1.0), g.multiply(large, small));
    assert_eq!(product, one);
}

/// Parameters that would be one constant, and a variant that would be the robot: at the variants' names.
#[test]
fn names_that_code_cannot_tell_apart() {
    let text = "robot Slide { track one; cluster arm on one { link l1, l2, l3, l4, l5, l6; }
        variant Nominal { arm reduced; tracks linear; }
        effect shift on cart { param a, A: length; along += a - A; }
        variant Shifted = Nominal + shift(one);
        variant Robot { arm full; tracks linear; } }";
    let model = tau_model_dsl::check_text(text).expect("a valid description");
    let tokens = tau_model_dsl::tokens(text).expect("tokens");
    let errors = crate::check_names(&crate::compile(&model, text), &tokens).unwrap_err();
    let found: Vec<_> = (errors.diagnostics.iter())
        .map(|one| (one.code, one.line(), &text[one.byte_range()]))
        .collect();
    let code = tau_model_dsl::codes::NAMES_CLASH_IN_CODE;
    assert_eq!(found, [(code, 4, "Shifted"), (code, 5, "Robot")]);
}

/// Code of the closure of a link whose length has a term.
fn closure_with(term: &str) -> Programs {
    let text = format!(
        "robot Slide {{ track one, two, three; cluster arm on one {{ link l1; }}
            cluster second on two {{ link l2; }} cluster third on three {{ link l3; }}
            effect e on link {{ param a, b: length; length += {term}; }}
            variant Nominal {{ arm reduced; tracks linear; }}
            variant More = Nominal + e(l1); }}"
    );
    let model = tau_model_dsl::check_text(&text).expect("a valid description");
    let variant = model.variant("More").expect("a variant");
    let table = equations::parameters(&model, variant);
    equations::closure(
        Context::new(&model, variant, &table, Staging::Staged),
        0,
        false,
    )
    .lower()
}

#[test]
fn nested_magnitudes_take_code_in_proportion() {
    let nested = |levels: usize| {
        let term = format!("{}a{} + b", "abs(b - ".repeat(levels), ")".repeat(levels));
        closure_with(&term).linearize.counts().total()
    };
    let (ten, twenty) = (nested(10), nested(20));
    assert_eq!(nested(40) - twenty, 2 * (twenty - ten));
}

/// A published derive crate has the wrong sign here.
#[test]
fn derivative_of_a_negated_square() {
    let mut g = Graph::new();
    let s = symbols(&mut g, 2);
    let difference = g.subtract(s[1], s[0]);
    let square = g.multiply(difference, difference);
    let one = g.constant(1.0);
    let f = g.subtract(one, square);
    let gradient = gradient(&mut g, f, &[Symbol(0), Symbol(1)]);
    assert_eq!(evaluate(&g, &gradient, &[2.0, 5.0]), [6.0, -6.0]);
}

#[test]
fn derivative_ignores_infinities_of_the_branch_not_taken() {
    // if x < 0 { 3 x } else { sqrt(x) } at x = −1, where the other branch is not a number.
    let mut g = Graph::new();
    let x = symbols(&mut g, 1)[0];
    let (zero, three) = (g.constant(0.0), g.constant(3.0));
    let (below, above) = (g.multiply(three, x), g.apply(Elementary::Sqrt, x));
    let f = g.select(x, zero, below, above);
    let row = gradient(&mut g, f, &[Symbol(0)]);
    assert_eq!(evaluate(&g, &row, &[-1.0]), [3.0]);
    assert_eq!(evaluate(&g, &row, &[4.0]), [0.25]);
    // One-sided at the boundary: from above.
    assert_eq!(evaluate(&g, &row, &[0.0]), [f64::INFINITY]);
}

#[test]
fn turn_keeps_its_chain_factored() {
    let mut g = Graph::new();
    let s = symbols(&mut g, 3);
    let (first, _) = g.turn(s[0], s[1], s[2]);
    let row = gradient(&mut g, first, &[Symbol(0)]);
    // d(cos θ x − sin θ y)/dθ is minus the other coordinate: no new sines.
    let (_, second) = g.turn(s[0], s[1], s[2]);
    assert_eq!(row[0], g.negate(second));
}

fn closure(staging: Staging, pose: bool) -> Equations {
    let model = tau_model_dsl::check_text(GANTRY_TAU).expect("a valid description");
    let variant = model.variant("Full").expect("a variant");
    let table = equations::parameters(&model, variant);
    equations::closure(Context::new(&model, variant, &table, staging), 0, pose)
}

#[test]
fn operation_counts_of_the_closure_equation_are_pinned() {
    let count = |staging, pose| {
        let programs = closure(staging, pose).lower();
        [programs.prepare, programs.value, programs.linearize].map(|p| p.counts().total())
    };
    // Residual and ten derivatives, everything at every evaluation: CasADi reaches 69, by hand 71.
    assert_eq!(count(Staging::Unstaged, false), [0, 43, 69]);
    // With the plate's position and angles too, sixteen derivatives: CasADi 105, by hand 83.
    assert_eq!(count(Staging::Unstaged, true), [0, 43, 81]);
    // Data-only work hoisted: by hand 56.
    assert_eq!(count(Staging::Staged, false), [25, 34, 56]);
}

/// Runs a program.
fn run(program: &Program, inputs: &[f64]) -> Vec<f64> {
    assert_eq!(program.inputs.len(), inputs.len());
    let mut registers: Vec<f64> = Vec::new();
    let read = |operand: Operand, registers: &[f64]| match operand {
        Operand::Constant(value) => value,
        Operand::Input(index) => inputs[index],
        Operand::Temporary(index) => registers[index],
    };
    for operation in &program.operations {
        let values: Vec<f64> = operation
            .operands()
            .map(|operand| read(operand, &registers))
            .collect();
        registers.push(match operation {
            Operation::Add(..) => values[0] + values[1],
            Operation::Subtract(..) => values[0] - values[1],
            Operation::Multiply(..) => values[0] * values[1],
            Operation::Divide(..) => values[0] / values[1],
            Operation::Negate(_) => -values[0],
            Operation::Apply(function, _) => match function {
                Elementary::Sqrt => values[0].sqrt(),
                Elementary::Sin => values[0].sin(),
                Elementary::Cos => values[0].cos(),
                Elementary::Tan => values[0].tan(),
                Elementary::Atan => values[0].atan(),
                Elementary::Exp => values[0].exp(),
                Elementary::Ln => values[0].ln(),
                Elementary::Tanh => values[0].tanh(),
            },
            Operation::Select(_) => {
                if values[0] < values[1] {
                    values[2]
                } else {
                    values[3]
                }
            }
        });
    }
    program
        .outputs
        .iter()
        .map(|&output| read(output, &registers))
        .collect()
}

/// A random expression over two data and three parameters, built bottom up from a list of choices.
fn random_expression(
    g: &mut Graph,
    leaves: &[Expr],
    choices: &[(u8, usize, usize, usize)],
) -> Expr {
    let mut pool = leaves.to_vec();
    for &(kind, i, j, k) in choices {
        let pick = |index: usize| pool[index % pool.len()];
        let (a, b, c) = (pick(i), pick(j), pick(k));
        let expr = match kind % 11 {
            0 | 1 => g.add(a, b),
            2 => g.subtract(a, b),
            3 | 4 => g.multiply(a, b),
            5 => {
                // Denominators stay away from zero.
                let square = g.multiply(b, b);
                let one = g.constant(1.0);
                let positive = g.add(one, square);
                g.divide(a, positive)
            }
            6 => g.apply(Elementary::Sin, a),
            7 => g.turn(a, b, c).0,
            8 => g.turn(a, b, c).1,
            9 => g.apply(Elementary::Tanh, a),
            _ => {
                let zero = g.constant(0.0);
                g.select(a, zero, b, c)
            }
        };
        pool.push(expr);
    }
    *pool.last().expect("leaves")
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Lowering loses nothing: the programs compute what the graph says.
    #[test]
    fn lowering_preserves_values(
        choices in prop::collection::vec(any::<(u8, usize, usize, usize)>(), 1..40),
        values in prop::array::uniform5(-1.5_f64..1.5),
    ) {
        let mut g = Graph::new();
        let data = [g.symbol("d0", Stage::Data), g.symbol("d1", Stage::Data)];
        let parameters: Vec<Expr> =
            (0..3).map(|i| g.symbol(format!("p{i}"), Stage::Parameter)).collect();
        let mut leaves = data.to_vec();
        leaves.extend(&parameters);
        leaves.push(g.constant(2.0));
        let root = random_expression(&mut g, &leaves, &choices);
        let row = gradient(&mut g, root, &[Symbol(2), Symbol(3), Symbol(4)]);
        let wanted: Vec<Expr> = std::iter::once(root).chain(row.iter().copied()).collect();
        let expected = evaluate(&g, &wanted, &values);
        let programs = lower(&mut g, &[root], &row, &data, &parameters);
        let prepared = run(&programs.prepare, &values[..2]);
        let mut inputs = prepared;
        inputs.extend(&values[2..]);
        let found = run(&programs.linearize, &inputs);
        let value = run(&programs.value, &inputs);
        let close = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-9 * a.abs().max(b.abs()).max(1e-3);
        // Values grow without bound in deep products; compare where they are of a size.
        prop_assume!(expected.iter().all(|x| x.abs() < 1e6));
        prop_assert_eq!((found.len(), value.len()), (4, 1));
        for (a, b) in found.iter().zip(&expected) {
            prop_assert!(close(*a, *b), "{a} and {b}");
        }
        prop_assert!(close(value[0], expected[0]));
        // No parameter-dependent program repeats an operation.
        let mut seen: Vec<Operation> = Vec::new();
        for operation in &programs.linearize.operations {
            prop_assert!(!seen.contains(operation), "{operation:?} twice");
            seen.push(*operation);
        }
    }

    /// Reverse derivatives equal complex-free central differences of the graph.
    #[test]
    fn gradients_equal_differences(
        choices in prop::collection::vec(any::<(u8, usize, usize, usize)>(), 1..16),
        values in prop::array::uniform3(-1.0_f64..1.0),
    ) {
        let mut g = Graph::new();
        let leaves = symbols(&mut g, 3);
        // Selects jump; differences across a jump mean nothing.
        let smooth: Vec<_> = choices.iter().map(|&(kind, i, j, k)| (kind % 10, i, j, k)).collect();
        let root = random_expression(&mut g, &leaves, &smooth);
        let row = gradient(&mut g, root, &[Symbol(0), Symbol(1), Symbol(2)]);
        let exact = evaluate(&g, &row, &values);
        let at = |values: &[f64]| evaluate(&g, &[root], values)[0];
        prop_assert_eq!(exact.len(), 3);
        prop_assume!(exact.iter().all(|x| x.abs() < 1e3) && at(&values).abs() < 1e3);
        for (variable, exact) in exact.iter().enumerate() {
            // Richardson-extrapolated central difference.
            let difference = |h: f64| {
                let (mut up, mut down) = (values, values);
                up[variable] += h;
                down[variable] -= h;
                (at(&up) - at(&down)) / (2.0 * h)
            };
            let (coarse, fine) = (difference(2e-4), difference(1e-4));
            let estimate = (4.0 * fine - coarse) / 3.0;
            let uncertainty = (fine - coarse).abs() + 1e-7 * exact.abs().max(1.0);
            prop_assert!((exact - estimate).abs() <= uncertainty + 1e-7, "{exact} and {estimate}");
        }
    }
}

#[test]
fn nothing_data_only_is_left_in_the_iteration() {
    let equations = closure(Staging::Staged, false);
    let programs = equations.lower();
    assert_eq!(programs.linearize.counts().functions, 0);
    let prepared = programs.prepare.outputs.len();
    for operation in &programs.linearize.operations {
        let data_only = operation.operands().all(|operand| match operand {
            Operand::Constant(_) => true,
            Operand::Input(index) => index < prepared,
            Operand::Temporary(_) => false,
        });
        assert!(!data_only, "{operation:?} depends on data alone");
    }
    assert!(equations.graph.len() > 40);
    assert!(matches!(
        equations.graph.node(equations.residuals[0]),
        Node::Add(..)
    ));
}

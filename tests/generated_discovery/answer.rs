//! What a residual family answers to arbitrary numbers.

use tau::runtime::ResidualFamily;

/// Arbitrary numbers between 0 and 1.
fn numbers(start: usize, count: usize) -> Vec<f64> {
    let number = |k: usize| ((29 * k + 11) % 97 + 1) as f64 / 98.0;
    (start..start + count).map(number).collect()
}

/// Value, residuals and Jacobian, as bits.
pub(crate) fn answer(family: &dyn ResidualFamily, sample: usize) -> String {
    let shape = family.shape();
    let parameters = numbers(3 * sample, shape.parameters);
    let mut prepared = vec![0.0; shape.prepared];
    family.prepare(&numbers(sample, shape.data), &mut prepared);
    let (mut value, mut residuals) = (vec![0.0; shape.residuals], vec![0.0; shape.residuals]);
    family.value(&prepared, &parameters, &mut value);
    let mut jacobian = vec![0.0; family.pattern().columns.len()];
    family.linearize(&prepared, &parameters, &mut residuals, &mut jacobian);
    let all = [value, residuals, jacobian].concat();
    assert!(all.iter().all(|number| number.is_finite()));
    let bits = all.iter().map(|number| format!("{:x} ", number.to_bits()));
    bits.collect()
}

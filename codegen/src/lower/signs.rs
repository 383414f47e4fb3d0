//! Which values to store negated, so that few negations remain.
//!
//! A sum can be computed with either sign at no cost unless all its terms come out negative; the sign of
//! a product follows from its factors; results and arguments of functions need the true sign. A local
//! search over single and paired flips finds, for the closure equation, the one negation that a careful
//! programmer would leave.

use std::collections::BTreeSet;

use super::instructions::{Form, Value};

/// The chosen signs; true is negated.
#[derive(Debug, Clone)]
pub(super) struct Signs {
    /// Of each value.
    pub(super) values: Vec<bool>,
    /// Of each free input, by position: how it must be prepared.
    pub(super) inputs: Vec<bool>,
}

/// Chooses the signs of all values, and of the first `free_inputs` inputs.
pub(super) fn choose(form: &Form, free_inputs: usize) -> Signs {
    Search::new(form, &vec![false; free_inputs]).run(free_inputs)
}

/// Chooses the signs of all values for inputs whose signs are given.
pub(super) fn choose_with_inputs(form: &Form, inputs: &[bool]) -> Signs {
    let mut signs = Search::new(form, inputs).run(0);
    signs.inputs = inputs.to_vec();
    signs
}

struct Search<'a> {
    form: &'a Form,
    /// Stored sign of each value.
    signs: Vec<bool>,
    /// Products that read a value and take over its sign.
    products: Vec<Vec<usize>>,
    /// Sums that read a value.
    sums: Vec<Vec<usize>>,
    /// Signs that readers other than sums and products see the value with: each must come out true.
    needs: Vec<Vec<bool>>,
}

impl<'a> Search<'a> {
    fn new(form: &'a Form, inputs: &[bool]) -> Self {
        let count = form.values.len();
        let mut search = Self {
            form,
            signs: vec![false; count],
            products: vec![vec![]; count],
            sums: vec![vec![]; count],
            needs: vec![vec![]; count],
        };
        for (index, value) in form.values.iter().enumerate() {
            match value {
                Value::Input(input) => {
                    search.signs[index] = inputs.get(*input).copied().unwrap_or(false);
                }
                Value::Constant(_) => {}
                Value::Sum(terms) => {
                    for &(_, term) in terms {
                        search.sums[term].push(index);
                    }
                }
                // The sign of a number times a value is free, so nothing flows through.
                Value::Product(a, b) if search.is_constant(*a) || search.is_constant(*b) => {}
                Value::Quotient(a, _) if search.is_constant(*a) => {}
                Value::Product(a, b) | Value::Quotient(a, b) => {
                    search.signs[index] = search.signs[*a] != search.signs[*b];
                    search.products[*a].push(index);
                    search.products[*b].push(index);
                }
                Value::Apply(_, (minus, operand)) => search.needs[*operand].push(*minus),
                Value::Select(operands) => {
                    for &(minus, operand) in operands {
                        search.needs[operand].push(minus);
                    }
                }
            }
        }
        for &(minus, output) in &form.outputs {
            search.needs[output].push(minus);
        }
        search
    }

    fn is_constant(&self, value: usize) -> bool {
        matches!(self.form.values[value], Value::Constant(_))
    }

    fn run(mut self, free_inputs: usize) -> Signs {
        let free: Vec<bool> = self
            .form
            .values
            .iter()
            .map(|value| match value {
                Value::Input(input) => *input < free_inputs,
                Value::Sum(_) => true,
                Value::Product(a, b) => self.is_constant(*a) || self.is_constant(*b),
                _ => false,
            })
            .collect();
        let singles = (0..free.len())
            .filter(|&value| free[value])
            .map(|value| vec![value]);
        let moves: Vec<Vec<usize>> = singles.chain(self.pairs(&free)).collect();
        let mut improved = true;
        while improved {
            improved = false;
            // Only a flip that reaches a negation can save one.
            let reaches = self.reaching_negations(&free);
            for flips in moves
                .iter()
                .filter(|flips| flips.iter().any(|&value| reaches[value]))
            {
                let flipped = self.flipped(flips);
                let before = self.cost_around(&flipped);
                if before == 0 {
                    continue;
                }
                self.toggle(&flipped);
                if self.cost_around(&flipped) < before {
                    improved = true;
                } else {
                    self.toggle(&flipped);
                }
            }
        }
        let mut inputs = vec![false; free_inputs];
        for (index, value) in self.form.values.iter().enumerate() {
            if let Value::Input(input) = value
                && *input < free_inputs
            {
                inputs[*input] = self.signs[index];
            }
        }
        Signs {
            values: self.signs,
            inputs,
        }
    }

    /// The free values on whose sign a negation depends.
    fn reaching_negations(&self, free: &[bool]) -> Vec<bool> {
        let mut reaches = vec![false; free.len()];
        let mut open = Vec::new();
        for (index, value) in self.form.values.iter().enumerate() {
            if self.needs[index]
                .iter()
                .any(|&minus| minus != self.signs[index])
            {
                open.push(index);
            }
            if let Value::Sum(terms) = value
                && self.is_negative_sum(index, terms)
            {
                open.push(index);
                open.extend(terms.iter().map(|&(_, term)| term));
            }
        }
        let mut seen = vec![false; free.len()];
        while let Some(index) = open.pop() {
            if std::mem::replace(&mut seen[index], true) {
                continue;
            }
            reaches[index] = free[index];
            if let Value::Product(a, b) | Value::Quotient(a, b) = self.form.values[index]
                && !free[index]
            {
                open.extend([a, b]);
            }
        }
        reaches
    }

    /// Whether all terms of a sum come out negative.
    fn is_negative_sum(&self, sum: usize, terms: &[(bool, usize)]) -> bool {
        terms
            .iter()
            .all(|&(minus, term)| (minus != self.signs[term]) != self.signs[sum])
    }

    /// Free values that meet in one sum, directly or through a product, and that sum itself.
    fn pairs(&self, free: &[bool]) -> Vec<Vec<usize>> {
        let mut pairs = Vec::new();
        for (index, value) in self.form.values.iter().enumerate() {
            let Value::Sum(terms) = value else { continue };
            let mut met = vec![index];
            for &(_, term) in terms {
                match self.form.values[term] {
                    Value::Product(a, b) if !free[term] => {
                        met.extend([a, b].into_iter().filter(|&factor| free[factor]));
                    }
                    _ if free[term] => met.push(term),
                    _ => {}
                }
            }
            for (i, &a) in met.iter().enumerate() {
                pairs.extend(
                    met[i + 1..]
                        .iter()
                        .filter(|&&b| a != b)
                        .map(|&b| vec![a, b]),
                );
            }
        }
        pairs
    }

    /// All values whose sign changes with the given ones: products take over the signs of factors.
    fn flipped(&self, flips: &[usize]) -> BTreeSet<usize> {
        let mut flipped = BTreeSet::new();
        let mut open = flips.to_vec();
        while let Some(value) = open.pop() {
            // Two changed factors cancel.
            if !flipped.insert(value) {
                flipped.remove(&value);
            }
            open.extend(&self.products[value]);
        }
        flipped
    }

    fn toggle(&mut self, values: &BTreeSet<usize>) {
        for &value in values {
            self.signs[value] ^= true;
        }
    }

    /// Negations that the given values and the sums around them cost.
    fn cost_around(&self, values: &BTreeSet<usize>) -> usize {
        let mut sums: BTreeSet<usize> = BTreeSet::new();
        let mut cost = 0;
        for &value in values {
            if matches!(self.form.values[value], Value::Sum(_)) {
                sums.insert(value);
            }
            sums.extend(&self.sums[value]);
            let needs_copy = self.needs[value]
                .iter()
                .any(|&minus| minus != self.signs[value]);
            cost += usize::from(needs_copy && !self.is_constant(value));
        }
        for sum in sums {
            if let Value::Sum(terms) = &self.form.values[sum] {
                let negative =
                    |&(minus, term): &(bool, usize)| (minus != self.signs[term]) != self.signs[sum];
                cost += usize::from(terms.iter().all(negative));
            }
        }
        cost
    }
}

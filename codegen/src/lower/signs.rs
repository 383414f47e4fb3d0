//! Choice of the values to store negated, so that few negations remain.
//!
//! A sum can be computed with either sign at no cost unless all its terms come out negative; the sign of
//! a product follows from its factors; results and arguments of functions need the true sign. A local
//! search over single and paired flips finds, for the closure equation, the one negation that a careful
//! programmer would leave.

use super::form::{Form, Value};

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
    products: Lists<usize>,
    /// Sums that read a value.
    sums: Lists<usize>,
    /// Signs that readers other than sums and products see the value with: each must come out true.
    needs: Lists<bool>,
    /// Values that flips change, and sums around them: kept because there are many flips to try.
    changed: Vec<usize>,
    around: Vec<usize>,
}

/// A list for each value, one after the other.
struct Lists<T> {
    starts: Vec<usize>,
    entries: Vec<T>,
}

impl<T: Copy> Lists<T> {
    /// Of entries with the value whose list they belong to.
    fn of(count: usize, entries: &[(usize, T)]) -> Self {
        let mut starts = vec![0; count + 1];
        for &(value, _) in entries {
            starts[value + 1] += 1;
        }
        for value in 0..count {
            starts[value + 1] += starts[value];
        }
        let mut next = starts.clone();
        let mut sorted: Vec<T> = entries.iter().map(|entry| entry.1).collect();
        for &(value, entry) in entries {
            sorted[next[value]] = entry;
            next[value] += 1;
        }
        Self {
            starts,
            entries: sorted,
        }
    }

    fn get(&self, value: usize) -> &[T] {
        &self.entries[self.starts[value]..self.starts[value + 1]]
    }
}

/// One value to flip, or two.
type Flips = (usize, Option<usize>);

impl<'a> Search<'a> {
    fn new(form: &'a Form, inputs: &[bool]) -> Self {
        let count = form.values.len();
        let mut signs = vec![false; count];
        let (mut products, mut sums, mut needs) = (Vec::new(), Vec::new(), Vec::new());
        for (index, value) in form.values.iter().enumerate() {
            match value {
                Value::Input(input) => {
                    signs[index] = inputs.get(*input).copied().unwrap_or(false);
                }
                Value::Constant(_) => {}
                Value::Sum(terms) => sums.extend(terms.iter().map(|&(_, term)| (term, index))),
                // The sign of a number times a value is free, so nothing flows through.
                Value::Product(a, b) if is_constant(form, *a) || is_constant(form, *b) => {}
                Value::Quotient(a, _) if is_constant(form, *a) => {}
                Value::Product(a, b) | Value::Quotient(a, b) => {
                    signs[index] = signs[*a] != signs[*b];
                    products.extend([(*a, index), (*b, index)]);
                }
                Value::Apply(_, (minus, operand)) => needs.push((*operand, *minus)),
                Value::Select(operands) => {
                    needs.extend(operands.map(|(minus, operand)| (operand, minus)));
                }
            }
        }
        needs.extend(form.outputs.iter().map(|&(minus, output)| (output, minus)));
        Self {
            form,
            signs,
            products: Lists::of(count, &products),
            sums: Lists::of(count, &sums),
            needs: Lists::of(count, &needs),
            changed: Vec::new(),
            around: Vec::new(),
        }
    }

    fn is_constant(&self, value: usize) -> bool {
        is_constant(self.form, value)
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
            .map(|value| (value, None));
        let moves: Vec<Flips> = singles.chain(self.pairs(&free)).collect();
        let mut improved = true;
        while improved {
            improved = false;
            // Only a flip that reaches a negation can save one.
            let reaches = self.reaching_negations(&free);
            for &(one, other) in moves
                .iter()
                .filter(|(one, other)| reaches[*one] || other.is_some_and(|other| reaches[other]))
            {
                self.change(one, other);
                let before = self.cost_around();
                if before == 0 {
                    continue;
                }
                self.toggle();
                if self.cost_around() < before {
                    improved = true;
                } else {
                    self.toggle();
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
            if self.needs_copy(index) {
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

    /// True if any reader needs the value with the other sign.
    fn needs_copy(&self, value: usize) -> bool {
        let mut needs = self.needs.get(value).iter();
        needs.any(|&minus| minus != self.signs[value])
    }

    /// True if all terms of a sum come out negative.
    fn is_negative_sum(&self, sum: usize, terms: &[(bool, usize)]) -> bool {
        terms
            .iter()
            .all(|&(minus, term)| (minus != self.signs[term]) != self.signs[sum])
    }

    /// Free values that meet in one sum, directly or through a product, and that sum itself.
    fn pairs(&self, free: &[bool]) -> Vec<Flips> {
        let mut pairs = Vec::new();
        let mut met = Vec::new();
        for (index, value) in self.form.values.iter().enumerate() {
            let Value::Sum(terms) = value else { continue };
            met.clear();
            met.push(index);
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
                        .map(|&b| (a, Some(b))),
                );
            }
        }
        pairs
    }

    /// Finds all values whose sign changes with the given ones: products take over the signs of factors.
    fn change(&mut self, one: usize, other: Option<usize>) {
        self.changed.clear();
        self.changed.push(one);
        self.changed.extend(other);
        let mut next = 0;
        while let Some(&value) = self.changed.get(next) {
            self.changed.extend(self.products.get(value));
            next += 1;
        }
        if self.changed.len() > 1 {
            // Two changed factors cancel.
            self.changed.sort_unstable();
            let mut kept = 0;
            for place in 0..self.changed.len() {
                let value = self.changed[place];
                if kept > 0 && self.changed[kept - 1] == value {
                    kept -= 1;
                } else {
                    self.changed[kept] = value;
                    kept += 1;
                }
            }
            self.changed.truncate(kept);
        }
    }

    fn toggle(&mut self) {
        for &value in &self.changed {
            self.signs[value] ^= true;
        }
    }

    /// Negations that the changed values and the sums around them cost.
    fn cost_around(&mut self) -> usize {
        let mut around = std::mem::take(&mut self.around);
        around.clear();
        let mut cost = 0;
        for &value in &self.changed {
            if matches!(self.form.values[value], Value::Sum(_)) {
                around.push(value);
            }
            around.extend(self.sums.get(value));
            cost += usize::from(self.needs_copy(value) && !self.is_constant(value));
        }
        around.sort_unstable();
        around.dedup();
        for &sum in &around {
            if let Value::Sum(terms) = &self.form.values[sum] {
                cost += usize::from(self.is_negative_sum(sum, terms));
            }
        }
        self.around = around;
        cost
    }
}

fn is_constant(form: &Form, value: usize) -> bool {
    matches!(form.values[value], Value::Constant(_))
}

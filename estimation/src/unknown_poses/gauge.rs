//! Gauge freedoms: combinations that measurements leave open, in words of the machine.

mod motions;

use crate::numerics::order::{largest_first, smallest_first};
use nalgebra::{DMatrix, DVector};

use super::elimination::Reduced;
use motions::Motion;
pub(super) use motions::Shared;

/// A direction of which the data know less than this share of what they know best is open: between the rounding of
/// squares (1e-16 to 1e-12) and the weakest that measurements of a machine determine (1e-6).
const OPEN: f64 = 1e-9;
/// Share of a motion outside the open directions up to which it is one of them: rounding in the null space, below the
/// millimetre in a hundred metres that would make it another. So is the share of what is seen of an open scale that does
/// not cancel.
const NAMED: f64 = 1e-5;
/// Share of a motion within the directions not yet named from which on it names another one; what others have named
/// leaves rounding alone.
const INDEPENDENT: f64 = 1e-3;

/// A motion or change of the machine that no residual sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Freedom {
    /// True for a motion that no more measurements of these kinds would settle; otherwise there are too few of them, or
    /// they are too much alike.
    pub is_motion: bool,
    /// In words, such as `rotation of the machine about z`.
    pub words: String,
    /// True for the scale of the whole machine.
    pub is_scale: bool,
    /// Change of each shared unknown, in units of its tolerance, of length one.
    pub(super) direction: DVector<f64>,
}

/// Motions whose changes add up to less, each of length one, cancel but for rounding.
const CANCELLED: f64 = 1e-6;
/// Shares of the largest from which on motions that are open together, and unknowns of a direction, are named: what changes
/// less tells a reader nothing.
const LEAST_OF_MOTIONS: f64 = 0.1;
const LEAST_OF_UNKNOWNS: f64 = 0.2;
/// Motions or unknowns that are named of those that are open together: more tell a reader nothing.
const NAMED_TOGETHER: usize = 4;

impl Shared<'_> {
    /// The motions and changes that a triangle does not see, in `scaled` units with its singular values and vectors.
    pub(super) fn freedoms(
        &self,
        reduced: &Reduced,
        scaled: &DMatrix<f64>,
        (values, v_t): (&DVector<f64>, &DMatrix<f64>),
    ) -> Vec<Freedom> {
        let largest = values.max();
        let open: Vec<usize> = (0..values.len())
            .filter(|&k| values[k] <= OPEN * largest)
            .collect();
        let mut basis: Vec<DVector<f64>> = open.iter().map(|&k| v_t.row(k).transpose()).collect();
        let mut freedoms = vec![];
        let motions = self.motions();
        let mut take = |direction: &DVector<f64>,
                        words: String,
                        (is_motion, is_scale): (bool, bool),
                        basis: &mut Vec<DVector<f64>>| {
            freedoms.push(Freedom {
                is_motion,
                words,
                is_scale,
                direction: direction.clone(),
            });
            without(basis, direction);
        };
        let all = basis.clone();
        // A motion that is open by itself; what is left of it once others are taken must still be open.
        let mut used: Vec<&Motion> = vec![];
        for motion in &motions {
            let is_open = share(&all, &motion.change) > 1.0 - NAMED;
            if is_open && share(&basis, &motion.change) > INDEPENDENT {
                take(
                    &motion.change,
                    motion.words.clone(),
                    (true, motion.is_scale),
                    &mut basis,
                );
                used.push(motion);
            }
        }
        // Motions that are open together, such as a rotation about an axis that is none of the frame's.
        let together: Vec<&Motion> = motions
            .iter()
            .filter(|motion| !used.iter().any(|known| std::ptr::eq(*known, *motion)))
            .collect();
        if !together.is_empty() && !basis.is_empty() {
            let columns: Vec<DVector<f64>> = together.iter().map(|m| m.change.clone()).collect();
            let seen = scaled * DMatrix::from_columns(&columns);
            let svd = seen.svd(false, true);
            if let Some(v_t) = svd.v_t {
                for k in 0..svd.singular_values.len() {
                    if svd.singular_values[k] > 100.0 * OPEN * largest {
                        continue;
                    }
                    let shares = v_t.row(k);
                    let mut direction = DVector::zeros(self.scale.len());
                    let mut named: Vec<(f64, &Motion)> = vec![];
                    for (share, motion) in shares.iter().zip(&together) {
                        direction.axpy(*share, &motion.change, 1.0);
                        named.push((share.abs(), motion));
                    }
                    if direction.norm() < CANCELLED {
                        continue;
                    }
                    direction.normalize_mut();
                    if share(&basis, &direction) < INDEPENDENT {
                        continue;
                    }
                    largest_first(&mut named, |own| own.0);
                    let most = named[0].0;
                    named.retain(|(share, _)| *share > LEAST_OF_MOTIONS * most);
                    let is_scale = named.iter().any(|(_, motion)| motion.is_scale);
                    take(
                        &direction,
                        together_in_words(&named),
                        (true, is_scale),
                        &mut basis,
                    );
                }
            }
        }
        // Closures are homogeneous of degree two: as long as they are not met, a scale changes them in proportion, and
        // makes them the smaller the smaller the machine.
        for motion in motions.iter().filter(|motion| motion.is_scale) {
            let seen = (scaled * &motion.change).insert_row(self.scale.len(), 0.0) * motion.size;
            let left = &seen - &reduced.projected * 2.0;
            let is_known = used.iter().any(|known| known.is_scale);
            if !is_known && left.norm() < NAMED * seen.norm() {
                take(
                    &motion.change,
                    motion.words.clone(),
                    (true, true),
                    &mut basis,
                );
            }
        }
        for direction in basis.clone() {
            take(
                &direction,
                self.in_parameters(&direction),
                (false, false),
                &mut basis,
            );
        }
        freedoms
    }

    /// A direction by the unknowns that it changes most.
    fn in_parameters(&self, direction: &DVector<f64>) -> String {
        let mut largest: Vec<usize> = (0..direction.len()).collect();
        largest_first(&mut largest, |&place| direction[place].abs());
        let most = direction[largest[0]].abs();
        let named = largest
            .iter()
            .filter(|&&place| direction[place].abs() > LEAST_OF_UNKNOWNS * most);
        let names: Vec<&str> = named
            .take(NAMED_TOGETHER)
            .map(|&place| self.name(place))
            .collect();
        in_parameters(&names)
    }

    fn name(&self, place: usize) -> &str {
        match self.used.get(place) {
            Some(&index) => &self.machine.variant.parameters[index].name,
            None => {
                let mut unknowns = self.objects.iter().flat_map(|object| &object.unknowns);
                let own = unknowns.nth(place - self.used.len());
                own.map_or("?", |unknown| &unknown.name)
            }
        }
    }
}

/// Unknowns that are open together, or one alone.
fn in_parameters(names: &[&str]) -> String {
    match names {
        [name] => (*name).to_owned(),
        names => format!("a combination of {}", names.join(", ")),
    }
}

/// Motions that are open together, those with the largest share first.
fn together_in_words(named: &[(f64, &Motion)]) -> String {
    let mut words: Vec<String> = (named.iter().take(NAMED_TOGETHER))
        .map(|(_, motion)| motion.words.clone())
        .collect();
    match named.len() - words.len() {
        0 => {}
        1 => words.push("one other".to_owned()),
        others => words.push(format!("{others} others")),
    }
    words.join(" with ")
}

/// Length of the part of a unit vector within the span of an orthonormal basis.
fn share(basis: &[DVector<f64>], vector: &DVector<f64>) -> f64 {
    let squares = basis.iter().map(|own| own.dot(vector).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Takes from an orthonormal basis the direction within its span that is nearest to a vector.
fn without(basis: &mut Vec<DVector<f64>>, vector: &DVector<f64>) {
    if basis.is_empty() {
        return;
    }
    let mut nearest = DVector::zeros(vector.len());
    for own in basis.iter() {
        nearest.axpy(own.dot(vector), own, 1.0);
    }
    nearest.normalize_mut();
    let mut left: Vec<DVector<f64>> = vec![];
    // The ones farthest from it first, which lose least.
    smallest_first(basis, |own| own.dot(&nearest).abs());
    for own in basis.iter().take(basis.len().saturating_sub(1)) {
        let mut own = own - &nearest * nearest.dot(own);
        for _ in 0..2 {
            for known in &left {
                let share = known.dot(&own);
                own.axpy(-share, known, 1.0);
            }
        }
        left.push(own.normalize());
    }
    *basis = left;
}

#[cfg(test)]
mod tests {
    use super::in_parameters;

    #[test]
    fn one_parameter_is_no_combination() {
        assert_eq!(in_parameters(&["c3.track_offset.z"]), "c3.track_offset.z");
        assert_eq!(in_parameters(&["a", "b"]), "a combination of a, b");
    }
}

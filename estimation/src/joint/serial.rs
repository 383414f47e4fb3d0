//! Rows of poses whose noise follows itself, less the share that rows before predict: see
//! [`Serial`](crate::calibration::Serial). Of the points of measured paths, a row depends on those beside its own command.

use super::{Component, Joint, Rows};
use crate::samples::Sample;

/// Correlation of each sample of set 1 with the one before it, where lines that follow each other have a correlation.
pub(crate) fn links(samples: &[Sample], rho: f64) -> Vec<f64> {
    let orders = samples.iter().filter(|sample| sample.set == 1);
    let orders: Vec<usize> = orders.map(|sample| sample.order).collect();
    let link = |pair: &[usize]| match pair[1].checked_sub(pair[0]) {
        None | Some(0) => 0.0,
        Some(lines) => rho.powf(lines as f64),
    };
    let of_others = orders.windows(2).map(link);
    orders
        .iter()
        .take(1)
        .map(|_| 0.0)
        .chain(of_others)
        .collect()
}

/// Takes from the numbers of each sample the share that the sample before predicts, and scales the rest to the variance that
/// they had; each sample has `each` numbers.
pub(crate) fn filtered(numbers: &mut [f64], each: usize, links: &[f64]) {
    for (sample, link) in links
        .iter()
        .enumerate()
        .rev()
        .filter(|(_, link)| **link > 0.0)
    {
        let scale = (1.0 - link * link).sqrt().recip();
        let (before, own) = numbers.split_at_mut(sample * each);
        let before = &before[(sample - 1) * each..];
        for (own, before) in own[..each].iter_mut().zip(before) {
            *own = scale * (*own - link * before);
        }
    }
}

impl Joint {
    /// Filters the numbers of a part's rows, if these are closures.
    pub(super) fn filter(&self, rows: &Rows, numbers: &mut [f64]) {
        let is_of_closures = rows.part.components.first() == Some(&Component::Closure);
        if is_of_closures && !self.links.is_empty() {
            filtered(numbers, numbers.len() / self.links.len(), &self.links);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A process that follows itself becomes the noise that drives it.
    #[test]
    fn what_drives_a_process_is_left() {
        let (rho, driving) = (0.8_f64, [0.3, -1.0, 0.7, 2.0]);
        let scale = (1.0 - rho * rho).sqrt();
        let mut process = driving;
        for k in 1..4 {
            process[k] = rho * process[k - 1] + scale * driving[k];
        }
        filtered(&mut process, 1, &[0.0, rho, rho, rho]);
        for (found, expected) in process.iter().zip(driving) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }
}

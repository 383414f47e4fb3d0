//! Coverage of intervals, with its standard error.

/// Intervals that hold the truth or not, of parameters by folder.
#[derive(Clone, Default)]
pub(crate) struct Coverage {
    /// Within and all, of each folder.
    folders: Vec<[f64; 2]>,
}

impl Coverage {
    /// Begins another folder.
    pub(crate) fn next(&mut self) {
        self.folders.push([0.0; 2]);
    }

    /// Counts an interval of the last folder.
    pub(crate) fn add(&mut self, is_within: bool) {
        if let Some([within, all]) = self.folders.last_mut() {
            *within += f64::from(u8::from(is_within));
            *all += 1.0;
        }
    }

    /// Number of intervals.
    pub(crate) fn count(&self) -> f64 {
        self.folders.iter().map(|[_, all]| all).sum()
    }

    /// Share that holds the truth.
    pub(crate) fn share(&self) -> f64 {
        self.folders.iter().map(|[within, _]| within).sum::<f64>() / self.count()
    }

    /// Its standard error. Errors of one folder go together, so folders are the sample (W. G. Cochran, *Sampling Techniques*,
    /// 1977, section 9A.1).
    pub(crate) fn standard_error(&self) -> f64 {
        let share = self.share();
        let squares: f64 = (self.folders.iter())
            .map(|[within, all]| (within - share * all).powi(2))
            .sum();
        squares.sqrt() / self.count()
    }
}

impl std::fmt::Display for Coverage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.3} ± {:.3}", self.share(), self.standard_error())
    }
}

//! Reasons why outliers take part all the same.

/// A reason why poses far off are not left out.
#[derive(Debug, Clone, PartialEq)]
pub enum Kept {
    /// More lie further off than most let expect than outliers can be.
    TooMany {
        /// Number of poses that lie so far off.
        far: usize,
        /// Number of all poses.
        poses: usize,
        /// True if none of them is left out.
        are_all_kept: bool,
    },
    /// Without them nothing can be calibrated, for a reason in words.
    Needed(String),
}

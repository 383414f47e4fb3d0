//! Fits whose solution is known by another way.
//!
//! | file | promise |
//! | --- | --- |
//! | `errors_in_variables` | estimates and standard deviations are those of the truth and of a dense solution by hand |
//! | `curvature` | standard deviations along motions that measurements leave to the tolerances |
//! | `memory` (a binary of its own) | memory is linear in the number of poses |

mod curvature;
mod errors_in_variables;

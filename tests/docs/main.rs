//! What the documentation and the packages state.
//!
//! | file | promise |
//! | --- | --- |
//! | `docs.rs` | descriptions, tables, commands and links of the pages hold |
//! | `codes.rs` | each code is used, documented, and shown by a snapshot |
//! | `layers.rs` | modules of the estimation import those below them |
//! | `packages.rs` | packages hold what they need; generated code needs no standard library |

mod codes;
mod docs;
mod layers;
mod packages;

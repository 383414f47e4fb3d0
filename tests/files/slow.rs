//! What takes longer, and data that the repository does not hold.

mod hangprinter;
mod mutations;
mod printers;
mod struts;

//! Descriptions: what is said of their mistakes.

mod messages;

//! Standard robots.

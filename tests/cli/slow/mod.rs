//! What needs a browser.

mod browser;
mod devtools;

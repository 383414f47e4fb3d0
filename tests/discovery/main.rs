//! Discovery of effects that a model lacks.

mod belts;
mod discover_command;
mod discovery;
mod discovery_counts;
mod discovery_folders;
mod discovery_robots;
mod discovery_tracks;
mod drums;
mod evidence;
mod generated_discovery;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
mod tracker_errors;

//! Measurements of a simulated Gantry-Tau prototype: the files of `prototype/`, as text.
//!
//! A package of its own, so that the folder stands where people look for it and ships with the library as well.

/// `tcp_poses.csv`, set 1: commands and measured poses of the plate.
pub const TCP_POSES: &str = include_str!("prototype/tcp_poses.csv");
/// `cart_poses.csv`, set 2: poses of the carts along their tracks.
pub const CART_POSES: &str = include_str!("prototype/cart_poses.csv");
/// `cart_positions.csv`, set 3: positions of the carts at random poses.
pub const CART_POSITIONS: &str = include_str!("prototype/cart_positions.csv");
/// `robot.toml`: nominal parameters with tolerances, noise and loads.
pub const ROBOT: &str = include_str!("prototype/robot.toml");

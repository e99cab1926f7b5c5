//! The gap between the calibrated simulation and reality: which effect explains it.

pub mod adequacy;
pub mod attribution;
pub mod discrepancy;
pub mod evidence;
pub mod gaussian;
pub mod hypothesis;
pub mod measurement;
pub mod mode;
pub mod model;
pub mod path;
pub mod predictor;
pub mod problem;
#[cfg(test)]
mod synthetic_world;

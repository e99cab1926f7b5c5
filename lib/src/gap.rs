//! The gap that is left after calibration: where it lies, which effect explains it, and how far it
//! closes.

pub mod adequacy;
pub mod attribution;
pub mod closure;
pub mod confounding;
pub mod diagnosis;
pub mod discrepancy;
pub mod evidence;
pub mod gaussian;
mod hat;
pub mod hypothesis;
pub mod locate;
pub mod measurement;
pub mod mode;
pub mod model;
pub mod noise;
pub mod path;
mod precision;
pub mod predictor;
pub mod problem;
pub mod residual;
mod scatter;
pub mod self_check;
pub mod shrink;
pub mod standardised;
#[cfg(test)]
mod synthetic;
#[cfg(test)]
mod synthetic_world;
pub mod verdict;

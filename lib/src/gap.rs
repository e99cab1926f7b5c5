//! The gap that is left after calibration: where it lies, and how far it closes.

pub mod locate;
pub mod noise;
mod precision;
pub mod residual;
#[cfg(test)]
mod synthetic;

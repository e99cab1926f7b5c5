//! The gap that is left after calibration: where it lies, and how far it closes.

mod hat;
pub mod locate;
pub mod noise;
mod precision;
pub mod residual;
mod scatter;
pub mod shrink;
#[cfg(test)]
mod synthetic;

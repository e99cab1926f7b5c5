//! The gap that is left after calibration: where it lies, which effect explains it, and how far it
//! closes.
//!
//! * [`locate`] — where: stretches of the control over which the calibrated model misses the measurement.
//! * [`attribute`] — which: the probability of every set of candidate effects.
//! * [`design_box`] — the base parameters of a design that tells hypotheses apart.
//! * [`blind`] — riddles: a truth that is drawn and hidden, and whether it was found.
//! * [`shrink`] — how far: the gap before and after an effect is in the simulation.
//!
//! The first and the last work on calibrated runs, and share what a gap is (`residual`), how large
//! and how correlated the noise is ([`noise`]), and what a fit takes out of it (`hat`, `scatter`).

pub mod attribute;
pub mod blind;
pub mod design_box;
mod hat;
pub mod locate;
pub mod noise;
mod precision;
pub mod residual;
mod scatter;
pub mod shrink;
pub mod standardised;
#[cfg(test)]
mod synthetic;

//! Simulation-based calibration of the loop through an emulator, on problems in closed form.
//!
//! A truth is drawn from the prior and measured; the loop runs until it stops; what it says is held against
//! the posterior by the function itself (Talts et al. 2018, arXiv:1804.06788).

pub mod looped;
pub mod problem;
pub mod reference;

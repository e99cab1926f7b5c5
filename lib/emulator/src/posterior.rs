//! The posterior of the parameters through an emulator.

pub mod mixture;
pub mod smc;

//! Numbers that know nothing of tables: weighted statistics, the normal distribution, densities and
//! low-discrepancy sequences.

pub mod density;
pub mod normal;
pub mod quadratic;
pub mod sequence;
pub mod statistics;

pub use anyhow::Result;

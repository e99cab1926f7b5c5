//! The withheld check: how often the diagnosis is right, on measurements whose effect it is not told.
//!
//! The generator draws cases by a seed and writes, for each, the measurement that a user would have; the
//! answers go into a file of their own. The diagnosis reads the former, the scorer both.

pub mod bench;
pub mod condition;
pub mod diagnose;
pub mod exact;
pub mod fit;
pub mod generate;
pub mod page;
pub mod score;
pub mod specimen;
pub mod weigh;

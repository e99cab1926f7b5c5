//! How runs are started, and which of them are complete.

pub mod command;
pub mod lock;
pub mod pbs;
pub mod scheduler;
pub mod slurm;

//! How runs are started, and which of them are complete.

pub mod command;
pub mod lock;
pub mod pbs;
pub mod scheduler;
pub mod slurm;

/// Whoever hears what an engine has to say while it works.
pub type Say<'a> = &'a (dyn Fn(&str) + Sync);

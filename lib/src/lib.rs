//! Bayesian calibration of particle simulations, and diagnosis of the gap that a calibration leaves.
//!
//! Tables come in through [`table`], and everything else works on plain numbers:
//!
//! | step of the work | modules |
//! | --- | --- |
//! | what may vary, and which samples to run | [`prior`], [`sequence`], [`design`], [`samples`] |
//! | what was measured, what the runs gave | [`observations`], [`collect`], [`alignment`], [`ensemble`] |
//! | how far each run is from the measurement | [`misfit`] |
//! | weights of the runs, and what they say | [`filter`], [`weights`], [`summary`], [`predict`], [`stop`] |
//! | the next samples | [`mixture`], [`proposal`], [`resample`] |
//! | runs that were never made | [`emulator`] |
//! | what the best calibration still misses, and why | [`gap`] |
//! | simulators of known physics | [`world`] |
//! | how far a long computation has come | [`progress`] |
//!
//! The mathematics is written down in `docs/design.md`.

pub mod alignment;
pub mod cli;
pub mod collect;
pub mod density;
pub mod design;
pub mod emulator;
pub mod ensemble;
pub mod filter;
pub mod gap;
pub mod misfit;
pub mod mixture;
pub mod normal;
pub mod observations;
pub mod predict;
pub mod prior;
pub mod progress;
pub mod proposal;
pub mod resample;
pub mod samples;
pub mod sequence;
pub mod statistics;
pub mod stop;
pub mod summary;
pub mod table;
pub mod weights;
pub mod world;

pub use anyhow::Result;

//! Bayesian calibration of particle simulations.
//!
//! Tables come in through [`gl_table`], and everything else works on plain numbers:
//!
//! | step of the work | modules |
//! | --- | --- |
//! | what may vary, and which samples to run | [`prior`], [`design`], [`samples`] |
//! | what was measured, what the runs gave | [`observations`], [`path`], [`rig`], [`collect`], [`times`], [`alignment`], [`ensemble`], [`stack`] |
//! | how far each run is from the measurement | [`misfit`] |
//! | weights of the runs, and what they say | [`filter`], [`weights`], [`summary`], [`predict`], [`loo`], [`stop`] |
//! | the next samples | [`mixture`], [`proposal`], [`resample`] |
//!
//! The mathematics is written down in `docs/design.md`.

pub mod alignment;
pub mod collect;
pub mod design;
pub mod ensemble;
pub mod filter;
pub mod fit;
pub mod loo;
pub mod misfit;
pub mod mixture;
pub mod observations;
pub mod path;
pub mod predict;
pub mod prior;
pub mod proposal;
pub mod resample;
pub mod rig;
pub mod samples;
pub mod stack;
pub mod stop;
pub mod summary;
pub mod times;
pub mod units;
pub mod weights;

pub use anyhow::Result;

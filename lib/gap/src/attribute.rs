//! Which effect explains the gap.
//!
//! From the question to the answer:
//!
//! 1. What is known. [`hypothesis`]: the candidates, and every set of a few of them. [`measurement`]:
//!    errors of the rig as candidates, which transform a curve along the control's [`path`]; each is of one
//!    [`test`](mod@test). [`predictor`]: the simulation at any parameters, by
//!    an emulator of a design's runs in [`simulation`].
//! 2. One hypothesis. [`problem`]: what all of them share, among it the covariance of the readings,
//!    which [`gaussian`] factors and [`discrepancy`] gives its smooth part; [`visible`] says which candidates
//!    the measurement can show at all, [`belief`] what was believed of parameters whose bounds were made wider. [`model`]: the
//!    parameters of one of them and the density of the measurement.
//! 3. Its evidence. [`mode`] climbs to the most probable parameters, [`evidence`] integrates from there.
//! 4. All of them. [`attribution`] weighs them against each other and against something that is no
//!    candidate; [`adequacy`] says whether the winner fits at all, [`confounding`] which of them the
//!    measurement cannot tell apart, [`told`] which of several tests does, [`forecast`] what it would take to, [`closure`] how far the gap should close, [`marginals`] what is known
//!    of the parameters then.
//! 5. For a user. [`diagnosis`] goes from tables to a table, [`verdict`] to a few sentences;
//!    [`next_runs`] says where further runs would teach the emulator most, and [`rounds`] how many and when there are
//!    enough; [`self_check`] diagnoses runs of the
//!    design, whose cause is known.

pub mod adequacy;
pub mod attribution;
pub mod belief;
pub mod closure;
pub mod confounding;
pub mod diagnosis;
pub mod discrepancy;
pub mod draws;
pub mod evidence;
pub mod forecast;
pub mod gaussian;
pub mod hypothesis;
pub mod ignorance;
pub mod lean;
pub mod marginals;
pub mod measurement;
pub mod mode;
pub mod model;
pub mod next_runs;
pub mod path;
pub mod predictor;
pub mod problem;
pub mod rest;
pub mod rounds;
pub mod self_check;
pub mod simulation;
#[cfg(test)]
mod synthetic_world;
pub mod test;
pub mod told;
pub mod untried;
pub mod verdict;
pub mod visible;
pub mod winner;

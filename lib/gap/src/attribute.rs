//! Which effect explains the gap.
//!
//! From the question to the answer, each module in terms of those before it:
//!
//! 1. [`problem`]: what is asked. The candidates and every set of a few of them, the tests and the errors of their rig, the
//!    simulation at any parameters by an emulator of a design's runs, and the covariance of the readings.
//! 2. [`evidence`]: how probable a measurement is under one hypothesis, and whether that fits at all.
//! 3. [`attribution`]: all hypotheses weighed against each other and against something that is no candidate; how far the gap
//!    closes, which of them the measurement cannot tell apart and what would, and what is known of the parameters then.
//! 4. For a user: [`diagnosis`] goes from tables to a table, [`settled`] says whether it is beyond doubt, [`verdict`] goes to
//!    a few sentences, [`winner`] from the table back to what is put into the simulation. [`next_runs`] says where further runs would teach the emulator most, among them
//!    those at [`full_strength`] of an effect, and [`rounds`] how many and when there are enough; [`self_check`] diagnoses runs of the design, whose cause is known.

pub mod attribution;
pub mod diagnosis;
pub mod evidence;
mod full_strength;
pub mod next_runs;
pub mod problem;
pub mod rounds;
pub mod self_check;
pub mod settled;
#[cfg(test)]
mod synthetic_world;
pub mod verdict;
pub mod winner;

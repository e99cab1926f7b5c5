//! A case: what is calibrated against which measurement, by which model and with which settings.
//!
//! A case is a folder with `params.txt`, `obs.txt` and `case.toml`. [`Case::load`] reads the last of these;
//! nothing in it is expanded or run but the command of a [`Model`], which is as much as a program of whoever
//! wrote the case.

mod case;
mod cluster;
mod engine;
mod fields;
mod file;
pub mod folders;
mod model;
mod overrides;
mod places;
mod settings;
pub mod shell;
mod values;
mod winner;

pub use case::{Case, Column, Posterior, Test, Tolerances};
pub use cluster::Cluster;
pub use engine::Engine;
pub use model::Model;
pub use places::{Places, suggestion};
pub use settings::Settings;
pub use winner::Winner;

//! The order of the steps: a calibration, a diagnosis, the check before them, a new case.
//!
//! Each step is a call of one of the tools, which a user could type: `commands.log` has them all. A step is done
//! when its output is there and not older than what it is made from; outputs appear whole or not at all. So
//! whatever is interrupted goes on where it was when it is called again.

pub mod arguments;
pub mod calibrate;
pub mod check;
mod columns;
pub mod diagnose;
mod forecast;
pub mod init;
pub mod iterate;
mod step;
pub mod words;

pub use arguments::{Request, Results};

/// How far a driver has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// It is done.
    Finished,
    /// Runs are in the queue of a scheduler; called again it goes on.
    InQueue,
}

impl gl_cli::Outcome for Progress {
    fn code(self) -> u8 {
        u8::from(self == Self::InQueue)
    }
}

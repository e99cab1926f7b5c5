//! How runs of a simulator are started, and which of them are complete.
//!
//! | part | modules |
//! | --- | --- |
//! | a call, checked before anything runs | [`call`], [`batch_table`], [`model`] |
//! | which runs there are already | [`complete`] |
//! | the folder of the runs, one engine at a time | [`folder`] |
//! | one run, from its scratch folder to its published files | [`row`], [`process`], [`publish`] |
//! | many runs | [`local`], [`yade_batch`], [`embedded`] |
//! | how it went | [`report`] |
//! | many runs in one file | [`pack`] |
//! | runs that were made before | [`kept`] |
//! | job arrays | [`cluster`]; [`scheduler`], which is [`slurm`] or [`pbs`], called by [`command`] |
//! | what lives in a queue | [`control`]; [`standing`], how far it is; [`lock`], one driver at a time |
//!
//! An engine that starts runs elsewhere, such as a job array, goes these steps:
//!
//! 1. [`call::Call::check`] reads and checks everything and makes the folder: a [`call::Batch`].
//! 2. [`folder::RunFolder::lock`], then [`folder::RunFolder::begin`] unless the runs of an earlier call are
//!    still in the queue (`.run/jobs` is there).
//! 3. [`complete::missing`] says which rows are to run; [`folder::RunFolder::forget`] removes what is left
//!    of an earlier attempt, so that from then on a row with a status is one that was tried.
//! 4. [`job::Job::save`] leaves in `.run` how a row is run. A task of the array loads it, takes its share of
//!    the rows, asks [`complete::missing_of`] which of them are missing still, and calls [`row::run_rows`].
//! 5. [`report::report`] looks at how it went; then [`folder::RunFolder::end`].
//!
//! Nothing here prints: messages go to a [`Say`], and how far it has come to `gl_progress`.

pub mod batch_table;
pub mod call;
pub mod cluster;
pub mod command;
pub mod complete;
pub mod control;
pub mod embedded;
pub mod folder;
pub mod job;
pub mod kept;
pub mod local;
pub mod lock;
pub mod model;
pub mod pack;
pub mod pbs;
pub mod process;
pub mod publish;
pub mod report;
pub mod row;
pub mod scheduler;
pub mod slurm;
pub mod standing;
mod times;
pub mod yade_batch;

/// Whoever hears what an engine has to say while it works.
pub type Say<'a> = &'a (dyn Fn(&str) + Sync);

//! What is said of runs that are there, and other forms of them.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use gl_engine::batch_table::BatchTable;
use gl_engine::folder::RunFolder;
use gl_engine::{complete, pack};
use gl_inference::collect::{Failure, RunStatus};
use gl_table::write_rows;

use crate::say;

#[derive(Args)]
pub struct Status {
    /// Table of the samples
    samples: PathBuf,
    /// Folder of the runs
    dir: PathBuf,
    /// Where the table goes; stdout when absent
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Status {
    /// Write the table.
    pub fn run(&self) -> Result<bool> {
        let table = BatchTable::read(&self.samples)?;
        let status = complete::status(&table, &self.dir)?;
        let is_held = RunFolder::is_held(&self.dir);
        let row = |(name, status): (&String, &Result<(), Failure>)| {
            let mut row = RunStatus::new(name, status);
            if status.is_err() && complete::is_running(&self.dir, name, is_held) {
                row = RunStatus { status: "running".to_owned(), detail: String::new(), ..row };
            }
            row
        };
        let rows: Vec<RunStatus> = table.samples().names.iter().zip(&status).map(row).collect();
        write_rows(self.output.as_deref(), &rows)?;
        Ok(true)
    }
}

#[derive(Args)]
pub struct Pack {
    /// Folder of the runs
    dir: PathBuf,
}

impl Pack {
    pub fn run(&self) -> Result<bool> {
        let packed = pack::pack(&self.dir, &say)?;
        say(&format!("{packed} runs packed"));
        Ok(true)
    }
}

#[derive(Args)]
pub struct Unpack {
    /// Packed files, *_packed.txt, and at the end the folder for the files in them
    #[arg(value_name = "PACKED… DIR", num_args = 2.., required = true)]
    paths: Vec<PathBuf>,
}

impl Unpack {
    pub fn run(&self) -> Result<bool> {
        let Some((dir, packed)) = self.paths.split_last() else { return Ok(true) };
        let problems = pack::unpack(packed, dir)?;
        problems.iter().for_each(|problem| say(problem));
        ensure!(
            problems.is_empty(),
            "{} packed files are damaged; what stands before the damage is out",
            problems.len()
        );
        Ok(true)
    }
}

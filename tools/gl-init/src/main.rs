//! Make a new case.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use gl_drive::init::{examples, init};
use gl_table::TableWriter;

/// Make a new case: a copy of an example, or an empty one with comments to fill in
#[derive(Parser)]
#[command(name = "gl-init", version, after_help = EXAMPLE)]
struct Args {
    /// Folder of the new case, which must not be there yet
    #[arg(value_name = "CASE", required_unless_present = "list")]
    case: Option<PathBuf>,
    /// The example to begin from; an empty case when absent
    #[arg(short, long, value_name = "EXAMPLE")]
    from: Option<String>,
    /// List the examples: example about
    #[arg(short, long, conflicts_with_all = ["case", "from"])]
    list: bool,
}

const EXAMPLE: &str = "\
Example:
  gl-init --list
  gl-init my-case --from collision";

fn run(args: &Args) -> Result<()> {
    if args.list {
        let mut table = TableWriter::create(None, &["example", "about"])?;
        for (name, about) in examples() {
            table.text(name).text(&about).end_row()?;
        }
        return table.finish();
    }
    let case = args.case.as_deref().context("no folder for the case")?;
    init(case, args.from.as_deref())?;
    gl_cli::note("gl-init", format_args!("{}: a new case; gl-check {0} goes on from here", case.display()));
    Ok(())
}

fn main() -> ExitCode {
    gl_cli::finish("gl-init", run(&gl_cli::parse()))
}

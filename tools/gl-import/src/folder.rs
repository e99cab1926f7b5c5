//! A folder of runs as GrainLearning leaves it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use gl_cli::note;
use gl_table::{Table, TableWriter};

use crate::npy;

/// The numbers of the folders iter0, iter1, …
///
/// # Errors
/// If the folder cannot be read.
pub fn iterations(root: &Path) -> Result<Vec<usize>> {
    let names = names(root)?;
    let mut numbers: Vec<usize> =
        names.iter().filter_map(|name| name.strip_prefix("iter")?.parse().ok()).collect();
    numbers.sort_unstable();
    Ok(numbers)
}

/// Columns of text, by name.
type Columns = Vec<(String, Vec<String>)>;

/// One iteration: a table of samples, and the runs that can be read.
pub struct Iteration {
    samples: Columns,
    /// Shape (samples,), where GrainLearning calls them so.
    descriptions: Vec<String>,
    /// By the name of the files.
    runs: Vec<(String, Run)>,
}

struct Run {
    simulation: Columns,
    parameters: Columns,
}

impl Iteration {
    /// Read iteration `number` of a folder.
    ///
    /// # Errors
    /// If the folder, or its table, cannot be read.
    pub fn read(root: &Path, number: usize) -> Result<Self> {
        let folder = root.join(format!("iter{number}"));
        let runs = runs(&folder)?;
        let samples = match table_of_samples(root, &folder, number)? {
            Some(path) => read(&path)?.into_iter().filter(|(name, _)| !name.starts_with('!')).collect(),
            None => {
                let runs: Vec<(&str, &Columns)> =
                    runs.iter().map(|(name, run)| (name.as_str(), &run.parameters)).collect();
                samples_of(&runs).with_context(|| format!("{}: no table of samples", folder.display()))?
            }
        };
        let descriptions = column(&samples, "description");
        let descriptions =
            descriptions.with_context(|| format!("{}: no column description", folder.display()))?.to_vec();
        Ok(Self { samples, descriptions, runs })
    }

    /// How many samples it has.
    pub fn samples(&self) -> usize {
        self.descriptions.len()
    }

    /// Write its tables into a folder, and its runs into `runs` there; how many were written.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn write(&self, to: &Path) -> Result<usize> {
        let folder = to.join("runs");
        fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let parameters: Vec<&str> = self.samples.iter().map(|(name, _)| name.as_str()).collect();
        let parameters: Vec<&str> =
            parameters.into_iter().filter(|name| !matches!(*name, "description" | "key")).collect();
        let mut written = 0;
        for description in &self.descriptions {
            let Some(run) = self.run(description) else { continue };
            let own = |name: &&str| column(&run.parameters, name).is_some();
            if let Some(lacking) = parameters.iter().find(|name| !own(name)) {
                note("gl-import", format_args!("left out: {description} has no parameter {lacking}"));
                continue;
            }
            let of_table =
                parameters.iter().flat_map(|&name| run.parameters.iter().find(|(own, _)| own == name));
            write(&folder.join(format!("{description}_param.txt")), of_table)?;
            let rest = run.simulation.iter().filter(|(name, _)| !parameters.contains(&name.as_str()));
            write(&folder.join(format!("{description}_sim.txt")), rest)?;
            written += 1;
        }
        write(&to.join("samples.txt"), &self.samples)?;
        Ok(written)
    }

    /// The run of a sample; GrainLearning lets more stand behind its number.
    fn run(&self, description: &str) -> Option<&Run> {
        let is_its = |name: &str| {
            name.strip_prefix(description).is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        let mut own = self.runs.iter().filter(|(name, _)| is_its(name));
        let (_, run) = own.next()?;
        own.next().is_none().then_some(run)
    }
}

/// The runs of a folder that can be read, in the order of their names.
fn runs(folder: &Path) -> Result<Vec<(String, Run)>> {
    let files = names(folder)?;
    let packed: Vec<PathBuf> =
        files.iter().filter(|name| name.ends_with(".npy")).map(|name| folder.join(name)).collect();
    let unpacked = tempfile::tempdir()?;
    npy::unpack(&packed, unpacked.path())?;
    let mut runs = Vec::new();
    for folder in [folder, unpacked.path()] {
        for name in names(folder)? {
            let Some(name) = name.strip_suffix("_sim.txt") else { continue };
            match run(folder, name) {
                Ok(run) => runs.push((name.to_owned(), run)),
                Err(error) => note("gl-import", format_args!("left out: {error:#}")),
            }
        }
    }
    runs.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(runs)
}

fn run(folder: &Path, name: &str) -> Result<Run> {
    let table = |end: &str| read(&folder.join(format!("{name}{end}")));
    Ok(Run { simulation: table("_sim.txt")?, parameters: table("_param.txt")? })
}

/// The table of samples, in the folder of the iteration or beside it, if there is one.
fn table_of_samples(root: &Path, folder: &Path, number: usize) -> Result<Option<PathBuf>> {
    let end = format!("Iter{number}_Samples.txt");
    let parent = fs::canonicalize(root)?.parent().map(Path::to_owned);
    for (folder, end) in [(Some(folder), "Samples.txt"), (Some(root), &end), (parent.as_deref(), &end)] {
        let Some(folder) = folder else { continue };
        if let Some(name) = names(folder)?.into_iter().find(|name| name.ends_with(end)) {
            return Ok(Some(folder.join(name)));
        }
    }
    Ok(None)
}

/// A table of samples from the parameters of the runs themselves.
fn samples_of(runs: &[(&str, &Columns)]) -> Result<Columns> {
    let Some((_, first)) = runs.first() else { bail!("and no runs") };
    let mut samples = vec![
        ("description".to_owned(), runs.iter().map(|(name, _)| (*name).to_owned()).collect()),
        ("key".to_owned(), (0..runs.len()).map(|key| key.to_string()).collect()),
    ];
    for (name, _) in *first {
        let value = |(run, own): &(&str, &Columns)| {
            let value = column(own, name).and_then(|values| values.first());
            value.cloned().with_context(|| format!("and the run {run} has no parameter {name}"))
        };
        samples.push((name.clone(), runs.iter().map(value).collect::<Result<_>>()?));
    }
    Ok(samples)
}

fn column<'a>(columns: &'a Columns, name: &str) -> Option<&'a [String]> {
    columns.iter().find(|(own, _)| own == name).map(|(_, values)| values.as_slice())
}

fn read(path: &Path) -> Result<Columns> {
    let table = Table::read(path)?;
    let names = table.format().columns().to_vec();
    let values = |j: usize| (0..table.len()).map(|row| table.field(row, j).to_owned()).collect();
    ensure!(!names.is_empty(), "{}: no columns", path.display());
    Ok(names.into_iter().enumerate().map(|(j, name)| (name, values(j))).collect())
}

fn write<'a>(path: &Path, columns: impl IntoIterator<Item = &'a (String, Vec<String>)>) -> Result<()> {
    let columns: Vec<_> = columns.into_iter().collect();
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    let mut table = TableWriter::create(Some(path), &names)?;
    for row in 0..columns.first().map_or(0, |(_, values)| values.len()) {
        for (_, values) in &columns {
            table.text(&values[row]);
        }
        table.end_row()?;
    }
    table.finish()
}

/// Names of the files and folders in a folder, in order.
fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).with_context(|| format!("{}: cannot be read", folder.display()))?;
    let name = |entry: std::io::Result<fs::DirEntry>| Ok(entry?.file_name().to_string_lossy().into_owned());
    let mut names = entries.map(name).collect::<Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

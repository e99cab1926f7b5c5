//! Runs that were made before and are kept in a packed file, taken over instead of running them again.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use anyhow::{Context, Result, bail};
use flate2::bufread::MultiGzDecoder;
use gl_inference::collect::RTOL;
use gl_inference::samples::Samples;
use gl_table::{Table, write_whole};

use crate::Say;
use crate::batch_table::BatchTable;
use crate::call::file;
use crate::complete::missing;
use crate::folder::RunFolder;
use crate::pack::each_file;

/// Take over, for the rows whose run is not complete in `dir`, the kept runs of the same parameters, under the
/// names of the rows. Names in the kept file say nothing: it may hold the runs of many tables. Of several runs of
/// the same parameters the first counts.
///
/// * `kept` — a packed file (see [`crate::pack`]), compressed if its name ends in `.gz`.
///
/// Returns how many runs were taken.
///
/// # Errors
/// If the file is damaged, or the folder cannot be read or written.
pub fn take(kept: &Path, table: &BatchTable, dir: &Path, say: Say) -> Result<usize> {
    let mut folder = RunFolder::create(dir)?;
    folder.lock(say)?;
    let mut wanted = missing(table, folder.dir())?;
    let before = wanted.len();
    if wanted.is_empty() {
        return Ok(0);
    }
    let mut parameters: Option<(String, Vec<u8>)> = None;
    let problem = each_file(kept, open(kept)?, |name, bytes| {
        if let Some(run) = name.strip_suffix("_param.txt") {
            parameters = Some((run.to_owned(), bytes));
            return Ok(());
        }
        let (Some(run), Some((of, text))) = (name.strip_suffix("_sim.txt"), parameters.take()) else {
            return Ok(());
        };
        if of != run {
            return Ok(());
        }
        let is_of = Parameters::read(&name, &text, table.samples())?;
        if let Some(place) = wanted.iter().position(|&row| is_of.row(&table.samples().values[row])) {
            let name = table.name(wanted.swap_remove(place));
            write_whole(&file(folder.dir(), name, "_param.txt"), &text)?;
            write_whole(&file(folder.dir(), name, "_sim.txt"), &bytes)?;
        }
        Ok(())
    })?;
    if let Some(problem) = problem {
        bail!("{problem}");
    }
    Ok(before - wanted.len())
}

fn open(path: &Path) -> Result<Box<dyn BufRead>> {
    let input = File::open(path).with_context(|| format!("{}: cannot be opened", path.display()))?;
    let input = BufReader::new(input);
    let is_compressed = path.extension().is_some_and(|ending| ending == "gz");
    Ok(if is_compressed { Box::new(BufReader::new(MultiGzDecoder::new(input))) } else { Box::new(input) })
}

/// The parameters of a kept run, in the order of a samples table; `None` for one that the run does not know.
struct Parameters(Vec<Option<f64>>);

impl Parameters {
    fn read(name: &str, text: &[u8], samples: &Samples) -> Result<Self> {
        let table = Table::parse(name, text.to_vec())?;
        let of = |parameter: &String| {
            let place = table.format().find(parameter)?;
            Ok(place.filter(|_| table.len() == 1).and_then(|place| table.field(0, place).parse().ok()))
        };
        Ok(Self(samples.parameters.iter().map(of).collect::<Result<_>>()?))
    }

    /// Whether they are those of a row, up to what two programs may round differently.
    fn row(&self, row: &[f64]) -> bool {
        self.0.iter().zip(row).all(|(own, &other)| {
            own.is_some_and(|own| (own - other).abs() <= RTOL * own.abs().max(other.abs()))
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;
    use crate::pack::push;

    fn table(rows: &str) -> BatchTable {
        BatchTable::parse("samples.txt", format!("description\tkey\ta\n{rows}").into_bytes()).unwrap()
    }

    fn kept(runs: &[(&str, &str, &str)]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (name, a, curve) in runs {
            push(&mut bytes, &format!("{name}_param.txt"), format!("a\n{a}\n").as_bytes());
            push(&mut bytes, &format!("{name}_sim.txt"), format!("u\tf\n0\t{curve}\n").as_bytes());
        }
        bytes
    }

    #[test]
    fn a_run_of_the_same_parameters_is_taken_whatever_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let (file, runs) = (dir.path().join("kept.gz"), dir.path().join("runs"));
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        // Two calibrations have given the same name to two runs.
        encoder.write_all(&kept(&[("x", "1", "10"), ("x", "2.000001", "20"), ("y", "1", "30")])).unwrap();
        fs::write(&file, encoder.finish().unwrap()).unwrap();
        let table = table("s0\t0\t2\ns1\t1\t3\ns2\t2\t1\n");
        assert_eq!(take(&file, &table, &runs, &|_| {}).unwrap(), 2);
        assert_eq!(missing(&table, &runs).unwrap(), [1]);
        assert_eq!(fs::read_to_string(runs.join("s0_sim.txt")).unwrap(), "u\tf\n0\t20\n");
        assert_eq!(fs::read_to_string(runs.join("s2_sim.txt")).unwrap(), "u\tf\n0\t10\n");
        assert_eq!(take(&file, &table, &runs, &|_| {}).unwrap(), 0, "what is there is left alone");
    }

    #[test]
    fn a_damaged_file_is_an_error_with_its_place() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("kept.txt");
        let mut bytes = kept(&[("x", "1", "10")]);
        bytes.truncate(bytes.len() - 4);
        fs::write(&file, bytes).unwrap();
        let error = take(&file, &table("s0\t0\t1\n"), &dir.path().join("runs"), &|_| {}).unwrap_err();
        assert!(format!("{error:#}").contains("kept.txt:"), "{error:#}");
    }
}

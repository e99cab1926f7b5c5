use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::str;

use anyhow::{Context, Result};
use rayon::prelude::*;

use super::Failure;
use crate::samples::Samples;

/// What a packed file is called after the name of its first run.
const ENDING: &str = "_packed.txt";

/// The packed runs of a folder: where in which file each of them stands.
///
/// A packed file holds files of runs one after the other, each behind a line `# file NAME BYTES` and
/// before a line end. What stands behind the first thing that is no such file, as where the writer was
/// killed, is not read.
#[derive(Debug, Default)]
pub(super) struct Packs {
    paths: Vec<PathBuf>,
    /// Every copy of every run, in the order of the samples; of one sample, in the order of `paths` and
    /// within a file.
    copies: Vec<(usize, Copy)>,
    /// The first file that ends in something else, and where.
    damage: Option<String>,
}

/// The two files of a run within a packed file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Copy {
    pack: usize,
    parameters: Option<Span>,
    simulation: Span,
}

#[derive(Clone, Copy, Debug)]
struct Span {
    start: u64,
    length: u64,
}

/// The files of a copy, in bytes.
pub(super) struct CopyBytes {
    pub parameters: Option<Vec<u8>>,
    pub simulation: Vec<u8>,
}

/// One packed file: the runs in it, and where it is damaged.
type Scan = (Vec<(usize, Copy)>, Option<u64>);

impl Packs {
    /// Look through the packed files of a folder for the runs of the samples.
    ///
    /// # Errors
    /// If the folder or a packed file cannot be read.
    pub(super) fn find(folder: &Path, samples: &Samples) -> Result<Self> {
        let cannot = || format!("{}: cannot be read", folder.display());
        let mut paths = Vec::new();
        for entry in fs::read_dir(folder).with_context(cannot)? {
            let name = entry.with_context(cannot)?.file_name();
            if name.to_str().is_some_and(|name| name.ends_with(ENDING)) {
                paths.push(folder.join(name));
            }
        }
        paths.sort();
        Self::of(paths, samples)
    }

    /// Look through these packed files for the runs of the samples.
    ///
    /// # Errors
    /// If one of them cannot be read.
    pub(super) fn of(paths: Vec<PathBuf>, samples: &Samples) -> Result<Self> {
        if paths.is_empty() {
            return Ok(Self::default());
        }
        let index = samples.index();
        let scans: Vec<Scan> = paths
            .par_iter()
            .enumerate()
            .map(|(pack, path)| {
                scan(path, pack, |name| index.get(name).copied())
                    .with_context(|| format!("{}: cannot be read", path.display()))
            })
            .collect::<Result<_>>()?;
        let mut copies = Vec::new();
        let mut damage = None;
        for ((found, at), path) in scans.into_iter().zip(&paths) {
            copies.extend(found);
            damage = damage.or(at.map(|at| format!("{}: no file of a run at byte {at}", path.display())));
        }
        copies.sort_by_key(|(sample, _)| *sample);
        Ok(Self { paths, copies, damage })
    }

    /// The copies of the run of a sample, the last written first.
    pub(super) fn copies(&self, sample: usize) -> impl Iterator<Item = &Copy> {
        let from = self.copies.partition_point(|(other, _)| *other < sample);
        let to = from + self.copies[from..].partition_point(|(other, _)| *other == sample);
        self.copies[from..to].iter().rev().map(|(_, copy)| copy)
    }

    /// What is damaged, for whoever misses a run.
    pub(super) fn damage(&self) -> Option<&str> {
        self.damage.as_deref()
    }

    /// Open the packed files in which the runs of these samples are.
    ///
    /// # Errors
    /// If one cannot be opened.
    pub(super) fn open(&self, samples: impl Iterator<Item = usize>) -> Result<OpenPacks<'_>> {
        let mut files = Vec::new();
        let mut packs: Vec<usize> =
            samples.flat_map(|sample| self.copies(sample)).map(|copy| copy.pack).collect();
        packs.sort_unstable();
        packs.dedup();
        for pack in packs {
            let path = &self.paths[pack];
            let file = File::open(path).with_context(|| format!("{}: cannot be opened", path.display()))?;
            files.push((pack, file));
        }
        Ok(OpenPacks { packs: self, files })
    }
}

/// Some of the packed files, open.
pub(super) struct OpenPacks<'a> {
    packs: &'a Packs,
    files: Vec<(usize, File)>,
}

impl OpenPacks<'_> {
    /// Read a copy of the run called `name`, or why it cannot be used.
    pub(super) fn read(&self, name: &str, copy: &Copy) -> Result<CopyBytes, Failure> {
        let path = &self.packs.paths[copy.pack];
        let malformed = |problem: String| Failure::Malformed(format!("{}: {problem}", path.display()));
        let Ok(place) = self.files.binary_search_by_key(&copy.pack, |(pack, _)| *pack) else {
            return Err(malformed("was not opened".to_owned()));
        };
        let bytes = |span: Span, ending: &str| match read(&self.files[place].1, span) {
            Ok(bytes) => Ok(bytes),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                Err(Failure::Truncated(format!("{} ends in {name}{ending}", path.display())))
            }
            Err(error) => Err(malformed(error.to_string())),
        };
        Ok(CopyBytes {
            parameters: copy.parameters.map(|span| bytes(span, "_param.txt")).transpose()?,
            simulation: bytes(copy.simulation, "_sim.txt")?,
        })
    }
}

/// Bytes of a file, which has them all and the line end behind them.
fn read(file: &File, span: Span) -> io::Result<Vec<u8>> {
    let available = file.metadata()?.len().saturating_sub(span.start);
    if available <= span.length {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    let mut bytes = vec![0; usize::try_from(span.length).map_err(io::Error::other)?];
    file.read_exact_at(&mut bytes, span.start)?;
    Ok(bytes)
}

/// Go from one `# file NAME BYTES` to the next, past what is between.
fn scan(path: &Path, pack: usize, place: impl Fn(&str) -> Option<usize>) -> io::Result<Scan> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    let mut copies = Vec::new();
    let mut parameters: Option<(usize, Span)> = None;
    let mut at = 0;
    // More than the longest name that a run can have.
    let mut buffer = [0; 512];
    while at < size {
        let read = file.read_at(&mut buffer, at)?;
        let Some(end) = memchr::memchr(b'\n', &buffer[..read]) else {
            let is_cut_off = at + read as u64 >= size;
            return Ok((copies, (!is_cut_off).then_some(at)));
        };
        let start = at + end as u64 + 1;
        let Some((name, length)) = head(&buffer[..end]) else { return Ok((copies, Some(at))) };
        let span = Span { start, length };
        if let Some(sample) = name.strip_suffix("_param.txt").and_then(&place) {
            parameters = Some((sample, span));
        } else if let Some(sample) = name.strip_suffix("_sim.txt").and_then(&place) {
            let parameters = parameters.filter(|(other, _)| *other == sample).map(|(_, span)| span);
            copies.push((sample, Copy { pack, parameters, simulation: span }));
        }
        at = start.saturating_add(length).saturating_add(1);
    }
    Ok((copies, None))
}

/// Name and size in a line `# file NAME BYTES`.
fn head(line: &[u8]) -> Option<(&str, u64)> {
    let (name, size) = str::from_utf8(line).ok()?.strip_prefix("# file ")?.split_once(' ')?;
    Some((name, size.parse().ok()?))
}

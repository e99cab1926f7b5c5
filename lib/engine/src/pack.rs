//! Many runs in one file: `*_packed.txt` holds the files of runs one after the other, each behind a line
//! `# file NAME BYTES` and with a line end after it.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use gl_inference::samples::check_description;
use gl_table::Sink;

use crate::Say;
use crate::call::file;
use crate::folder::RunFolder;

const ENDING: &str = "_packed.txt";

/// Files of runs that [`pack`] takes into one packed file.
const RUNS_A_FILE: usize = 1000;

/// Append a file to the bytes of a packed one.
pub(crate) fn push(bytes: &mut Vec<u8>, name: &str, text: &[u8]) {
    bytes.extend_from_slice(format!("# file {name} {}\n", text.len()).as_bytes());
    bytes.extend_from_slice(text);
    bytes.push(b'\n');
}

/// The packed files in `dir` that begin with the run `name`.
pub fn files_of(dir: &Path, name: &str) -> Vec<PathBuf> {
    (1..).map(|number| path(dir, name, number)).take_while(|path| path.exists()).collect()
}

/// A new packed file in `dir` that begins with the run `name`.
pub(crate) fn create(dir: &Path, name: &str) -> Result<(PathBuf, File)> {
    let mut number = 1;
    loop {
        let path = path(dir, name, number);
        match File::options().append(true).create_new(true).open(&path) {
            Ok(file) => return Ok((path, file)),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            Err(error) => {
                return Err(error).with_context(|| format!("{}: cannot be written", path.display()));
            }
        }
    }
}

fn path(dir: &Path, name: &str, number: usize) -> PathBuf {
    let number = if number > 1 { format!(".{number}") } else { String::new() };
    file(dir, name, &format!("{number}{ENDING}"))
}

/// Pack the loose runs of a folder, in the order of their names: those that have both files. Their files, and
/// what is left of logs and statuses, are removed once the packed file is on disk. Waits where an engine
/// has runs there.
///
/// Returns how many runs were packed.
///
/// # Errors
/// If the folder is not there, or a file cannot be read or written.
pub fn pack(dir: &Path, say: Say) -> Result<usize> {
    let cannot = || format!("{}: cannot be read", dir.display());
    ensure!(dir.is_dir(), "{}: no such folder of runs", dir.display());
    let mut folder = RunFolder::create(dir)?;
    folder.lock(say)?;
    let mut names = Vec::new();
    for entry in fs::read_dir(dir).with_context(cannot)? {
        let name = entry.with_context(cannot)?.file_name();
        let name = name.to_str().and_then(|name| name.strip_suffix("_sim.txt"));
        let is_run = |name: &&str| check_description(name).is_ok() && file(dir, name, "_param.txt").is_file();
        names.extend(name.filter(is_run).map(str::to_owned));
    }
    names.sort();
    for names in names.chunks(RUNS_A_FILE) {
        let (path, file) = create(dir, &names[0])?;
        if let Err(error) = pack_into(dir, names, file) {
            let _ = fs::remove_file(&path);
            return Err(error.context(format!("{}: cannot be written", path.display())));
        }
        for name in names {
            for ending in ["_sim.txt", "_param.txt", ".log", ".status"] {
                gl_table::remove(&self::file(dir, name, ending))?;
            }
        }
    }
    Ok(names.len())
}

fn pack_into(dir: &Path, names: &[String], mut packed: File) -> Result<()> {
    for name in names {
        let mut bytes = Vec::new();
        for ending in ["_param.txt", "_sim.txt"] {
            let path = file(dir, name, ending);
            let text = fs::read(&path).with_context(|| path.display().to_string())?;
            push(&mut bytes, &format!("{name}{ending}"), &text);
        }
        packed.write_all(&bytes)?;
    }
    Ok(packed.sync_all()?)
}

/// Take the files of runs out of packed files, into `dir`, which is made if need be. A run that is there more
/// than once is taken as it was last.
///
/// Returns what is wrong with files that are damaged or cut off, with file and line; what stands before
/// that is out.
///
/// # Errors
/// If a file cannot be read or written.
pub fn unpack(packed: &[PathBuf], dir: &Path) -> Result<Vec<String>> {
    fs::create_dir_all(dir).with_context(|| format!("{}: cannot be made", dir.display()))?;
    let mut problems = Vec::new();
    for path in packed {
        let input = File::open(path).with_context(|| format!("{}: cannot be opened", path.display()))?;
        problems.extend(unpack_one(path, BufReader::new(input), dir)?);
    }
    Ok(problems)
}

/// What is wrong with the file, if it is damaged.
fn unpack_one(path: &Path, input: impl BufRead, dir: &Path) -> Result<Option<String>> {
    each_file(path, input, |name, bytes| {
        let file = dir.join(&name);
        let mut sink = Sink::create(Some(&file))?;
        sink.write_all(&bytes).with_context(|| format!("{}: cannot be written", file.display()))?;
        sink.finish()
    })
}

/// Give the files of a packed one to `take`, name and bytes, one after the other: what is wrong with the file, if it
/// is damaged; what stands before that was given.
///
/// * `path` — what the file is called in messages.
///
/// # Errors
/// If it cannot be read, or `take` fails.
pub(crate) fn each_file(
    path: &Path,
    mut input: impl BufRead,
    mut take: impl FnMut(String, Vec<u8>) -> Result<()>,
) -> Result<Option<String>> {
    let cannot = || format!("{}: cannot be read", path.display());
    let mut lines = 0;
    loop {
        let mut line = Vec::new();
        if input.read_until(b'\n', &mut line).with_context(cannot)? == 0 {
            return Ok(None);
        }
        lines += 1;
        let place = |line: usize, problem: String| Ok(Some(format!("{}:{line}: {problem}", path.display())));
        let Some((name, length)) = head(&line) else {
            let is_whole = line.ends_with(b"\n");
            let problem = if is_whole { "no file of a run begins here" } else { "cut off" };
            return place(lines, problem.to_owned());
        };
        // A line end follows that is not of the file.
        let mut bytes = Vec::new();
        (&mut input).take(length.saturating_add(1)).read_to_end(&mut bytes).with_context(cannot)?;
        let read = lines + bytes.iter().filter(|&&byte| byte == b'\n').count();
        if bytes.len() as u64 <= length {
            return place(read, format!("cut off in {name}"));
        }
        if bytes.pop() != Some(b'\n') {
            return place(read, format!("no line end after {name}, which is longer than its {length} bytes"));
        }
        lines = read;
        take(name, bytes)?;
    }
}

/// Name and length of the file that follows a line `# file NAME BYTES`. A name that could leave its folder is
/// none.
fn head(line: &[u8]) -> Option<(String, u64)> {
    let line = std::str::from_utf8(line).ok()?.trim_end();
    let (name, length) = line.strip_prefix("# file ")?.split_once(' ')?;
    let run = name.strip_suffix("_param.txt").or_else(|| name.strip_suffix("_sim.txt"));
    check_description(run.unwrap_or(name)).ok()?;
    Some((name.to_owned(), length.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            fs::write(dir.path().join(name), text).unwrap();
        }
        dir
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn quiet(message: &str) {
        // Programs that other tests of this process start inherit the lock of a folder for as long as they live.
        assert!(message.contains("waiting for the runs that another process"), "{message}");
    }

    #[test]
    fn what_is_packed_comes_out_as_it_was() {
        let files = [
            ("a_param.txt", "x\n1\n"),
            ("a_sim.txt", "u f\n0 1\n"),
            ("a.log", "words\n"),
            ("a.status", "0\n"),
            ("b_param.txt", "x\n2"),
            ("b_sim.txt", ""),
            ("c_sim.txt", "half a run\n"),
            ("b_grains.txt", "beside\n"),
        ];
        let dir = folder(&files);
        assert_eq!(pack(dir.path(), &quiet).unwrap(), 2);
        assert_eq!(names(dir.path()), ["a_packed.txt", "b_grains.txt", "c_sim.txt"]);
        assert_eq!(pack(dir.path(), &quiet).unwrap(), 0);
        let out = dir.path().join("out");
        assert!(unpack(&[dir.path().join("a_packed.txt")], &out).unwrap().is_empty());
        assert_eq!(names(&out), ["a_param.txt", "a_sim.txt", "b_param.txt", "b_sim.txt"]);
        for (name, text) in files.iter().filter(|(name, _)| out.join(name).exists()) {
            assert_eq!(fs::read_to_string(out.join(name)).unwrap(), *text, "{name}");
        }
    }

    #[test]
    fn a_packed_file_that_is_there_is_not_added_to() {
        let dir = folder(&[
            ("a_packed.txt", "# file a_sim.txt 99\ncut"),
            ("a_sim.txt", "u\n1\n"),
            ("a_param.txt", "x\n1\n"),
        ]);
        pack(dir.path(), &quiet).unwrap();
        assert_eq!(names(dir.path()), ["a.2_packed.txt", "a_packed.txt"]);
        assert_eq!(files_of(dir.path(), "a").len(), 2);
    }

    #[test]
    fn damage_is_told_by_line_and_what_stands_before_is_out() {
        for (text, problem) in [
            ("# file a_sim.txt 4\nu\n1\n\n# file ../b_sim.txt 2\n1\n\n", ":5: no file of a run begins here"),
            ("# file a_sim.txt 4\nu\n1\n\n# file .b_sim.txt 2\n1\n\n", ":5: no file of a run begins here"),
            ("# file a_sim.txt 4\nu\n1\n\n# file b_sim.txt x\n", ":5: no file of a run begins here"),
            ("# file a_sim.txt 4\nu\n1\n\n# file b_s", ":5: cut off"),
            ("# file a_sim.txt 4\nu\n1\n\n# file b_sim.txt 9\nu\n", ":6: cut off in b_sim.txt"),
            ("# file a_sim.txt 4\nu\n1\n\n# file b_sim.txt 2\nu\n1\n", ":6: no line end after b_sim.txt"),
            (
                "# file a_sim.txt 4\nu\n1\n\n# file b_sim.txt 18446744073709551615\nu\n",
                ":6: cut off in b_sim.txt",
            ),
        ] {
            let dir = folder(&[("x_packed.txt", text)]);
            let out = dir.path().join("out");
            let problems = unpack(&[dir.path().join("x_packed.txt")], &out).unwrap();
            assert!(
                problems.len() == 1 && problems[0].contains(&format!("x_packed.txt{problem}")),
                "{problems:?}"
            );
            assert_eq!(names(&out), ["a_sim.txt"], "{text}");
            assert_eq!(fs::read_to_string(out.join("a_sim.txt")).unwrap(), "u\n1\n");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_bring_unpack_out_of_its_folder(bytes in prop::collection::vec(any::<u8>(), 0..300), name in "[ -~]{0,12}", length in 0_u64..9) {
            let dir = tempfile::tempdir().unwrap();
            let packed = dir.path().join("x_packed.txt");
            let mut text = format!("# file {name} {length}\n").into_bytes();
            text.extend(bytes);
            fs::write(&packed, text).unwrap();
            let _ = unpack(&[packed], &dir.path().join("a/out"));
            prop_assert_eq!(names(dir.path()), ["a", "x_packed.txt"]);
            prop_assert_eq!(names(&dir.path().join("a")), ["out"]);
        }
    }
}

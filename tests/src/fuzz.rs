//! Calls of the tools with tables and flags that were spoilt at random, and what is not to come of them.

#![allow(clippy::unwrap_used)]

pub mod calls;
pub mod flags;
pub mod judge;
pub mod tables;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};

use gl_case::shell::quoted;
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::folder::Folder;
use crate::{path_with_tools, programs};
use calls::Call;
use judge::Outcome;

/// What a call may take: seconds of one processor, and KiB of addresses.
const SECONDS: u32 = 20;
const KIB: u32 = 3 << 20;

/// The valid calls, and the files that they read.
pub struct World {
    files: BTreeMap<PathBuf, Vec<u8>>,
    calls: Vec<Call>,
}

/// A call that went wrong.
pub struct Failure {
    /// Why, what was called and what it said, and how to see it again.
    pub report: String,
}

impl World {
    /// Make the tables, each by the tool that makes it, and learn the flags of every tool.
    pub fn new() -> Self {
        let folder = calls::tables();
        let calls = calls::calls(&folder);
        Self { files: folder.files(), calls }
    }

    /// Every call as it is, which must end well.
    pub fn sound(&self) -> Vec<Failure> {
        let calls = self.calls.iter().filter_map(|call| {
            let inputs = self.inputs(call);
            self.run(call, call.words(), &inputs, |outcome| {
                let problem = outcome.problem(&inputs, &[]);
                problem
                    .or_else(|| (!outcome.ends_well()).then(|| "a sound call does not end well".to_owned()))
            })
        });
        calls.collect()
    }

    /// The call that a seed spoils.
    pub fn spoilt(&self, seed: u64) -> Option<Failure> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let call = self.calls.choose_weighted(&mut rng, |call| call.weight).unwrap();
        let mut inputs = self.inputs(call);
        let mut words = call.words();
        let spoils_tables = rng.random_bool(0.75) && !inputs.is_empty();
        if spoils_tables {
            for _ in 0..if rng.random_bool(0.2) { 2 } else { 1 } {
                let names: Vec<PathBuf> = inputs.keys().cloned().collect();
                if let Some(name) = names.choose(&mut rng) {
                    tables::spoil(&mut rng, name, &mut inputs);
                }
            }
        }
        if !spoils_tables || rng.random_bool(0.1) {
            flags::spoil(&mut rng, call, &mut words);
        }
        let failure =
            self.run(call, words.clone(), &inputs, |outcome| outcome.problem(&self.inputs(call), &words));
        failure.map(|failure| Failure {
            report: format!(
                "seed {seed}: {}again: FUZZ_SEED={seed} cargo test --release -p pipelines --test all fuzz\n",
                failure.report
            ),
        })
    }

    /// The files that a call names, or that lie in folders that it names.
    fn inputs(&self, call: &Call) -> BTreeMap<PathBuf, Vec<u8>> {
        let line = call.line;
        let named: Vec<&str> = line.split([' ', ',', '=', ':']).collect();
        let is_named = |path: &PathBuf| {
            path.ancestors().any(|part| {
                !part.as_os_str().is_empty() && named.iter().any(|name| part == std::path::Path::new(name))
            })
        };
        self.files
            .iter()
            .filter(|(path, _)| is_named(path))
            .map(|(path, bytes)| (path.clone(), bytes.clone()))
            .collect()
    }

    fn run(
        &self,
        call: &Call,
        words: Vec<String>,
        inputs: &BTreeMap<PathBuf, Vec<u8>>,
        problem: impl FnOnce(&Outcome) -> Option<String>,
    ) -> Option<Failure> {
        let folder = Folder::default();
        for (path, bytes) in inputs {
            folder.write(&path.display().to_string(), bytes);
        }
        let status = limited(&folder, &words);
        let outcome = Outcome::new(call, status, &folder, inputs);
        let problem = problem(&outcome)?;
        let said = String::from_utf8_lossy(&outcome.stderr).chars().take(2000).collect::<String>();
        let kept = folder.keep();
        let typed: Vec<String> = words.iter().map(|word| quoted(word)).collect();
        Some(Failure {
            report: format!(
                "{problem}\n  cd {} && {}\n  {status}\n{said}\n",
                kept.display(),
                typed.join(" ")
            ),
        })
    }
}

impl Default for World {
    fn default() -> Self {
        Self::new()
    }
}

/// Call a tool with limits, its outputs in `.stdout` and `.stderr` of the folder.
fn limited(folder: &Folder, words: &[String]) -> ExitStatus {
    let script = format!("ulimit -t {SECONDS}; ulimit -v {KIB}; ulimit -c 0; exec \"$@\"");
    Command::new("sh")
        .args(["-c", &script, "sh"])
        .arg(programs().join(&words[0]))
        .args(&words[1..])
        .current_dir(folder.path(""))
        .env("PATH", path_with_tools())
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .stdout(File::create(folder.path(".stdout")).unwrap())
        .stderr(File::create(folder.path(".stderr")).unwrap())
        .status()
        .unwrap()
}

/// Why the system ended it, if it did.
fn signal(status: ExitStatus) -> Option<String> {
    const OUT_OF_TIME: [i32; 2] = [9, 24];
    let signal = status.signal()?;
    Some(match OUT_OF_TIME.contains(&signal) {
        true => format!("more than {SECONDS} s of a processor"),
        false => format!("ended by signal {signal}"),
    })
}

/// The bytes of a file, or none.
fn read(folder: &Folder, name: &str) -> Vec<u8> {
    fs::read(folder.path(name)).unwrap_or_default()
}

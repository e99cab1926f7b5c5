//! What a call is not to do, whatever it is given.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitStatus;

use super::calls::Call;
use super::{read, signal};
use crate::folder::Folder;

/// What became of a call.
pub struct Outcome<'a> {
    call: &'a Call,
    status: ExitStatus,
    stdout: Vec<u8>,
    /// What it said.
    pub stderr: Vec<u8>,
    /// The files that it wrote or changed.
    written: BTreeMap<PathBuf, Vec<u8>>,
}

impl<'a> Outcome<'a> {
    /// Look at what a call left in its folder.
    pub fn new(
        call: &'a Call,
        status: ExitStatus,
        folder: &Folder,
        inputs: &BTreeMap<PathBuf, Vec<u8>>,
    ) -> Self {
        let mut written = folder.files();
        written.retain(|path, bytes| inputs.get(path) != Some(bytes));
        let own = |path: &PathBuf| path.to_string_lossy().starts_with(".std");
        written.retain(|path, _| !own(path));
        Self { call, status, stdout: read(folder, ".stdout"), stderr: read(folder, ".stderr"), written }
    }

    /// Whether it did what it was asked for, or answered.
    pub fn ends_well(&self) -> bool {
        self.status.code() == Some(0) || self.call.answers && self.status.code() == Some(1)
    }

    /// What is wrong with it, if anything is.
    ///
    /// * `inputs` — the files that it was to read, before they were spoilt.
    /// * `words` — its words; empty where nothing was spoilt.
    pub fn problem(&self, inputs: &BTreeMap<PathBuf, Vec<u8>>, words: &[String]) -> Option<String> {
        let said = String::from_utf8_lossy(&self.stderr);
        if said.contains("panicked") {
            return Some("a panic".to_owned());
        }
        if let Some(signal) = signal(self.status) {
            return Some(signal);
        }
        let part = self.written.keys().find(|path| path.to_string_lossy().ends_with(".part"));
        if let Some(part) = part {
            return Some(format!("{} was left", part.display()));
        }
        match self.status.code() {
            Some(0) => self.not_finite(),
            Some(1) if self.call.answers => self.not_finite(),
            Some(2) => self.unclear(&said, inputs, words),
            code => Some(format!("exit code {code:?}")),
        }
    }

    /// A NaN or an infinity in what it wrote or said.
    fn not_finite(&self) -> Option<String> {
        let files = self.written.iter().map(|(path, bytes)| (path.display().to_string(), bytes));
        let streams = [("stdout".to_owned(), &self.stdout), ("stderr".to_owned(), &self.stderr)];
        let found = files.chain(streams).find_map(|(name, bytes)| Some((name, infinite(bytes)?)));
        found.map(|(name, word)| format!("{word} in {name}"))
    }

    /// A message that says neither what it is about nor where.
    fn unclear(&self, said: &str, inputs: &BTreeMap<PathBuf, Vec<u8>>, words: &[String]) -> Option<String> {
        let begins_well = said.lines().any(|line| line.starts_with(&format!("{}: ", self.call.tool())));
        if !begins_well && !said.starts_with("error: ") {
            return Some("no message".to_owned());
        }
        let files =
            inputs.keys().filter_map(|path| path.file_name()).map(|name| name.to_string_lossy().into_owned());
        let folders = inputs
            .keys()
            .filter_map(|path| path.iter().next())
            .map(|name| name.to_string_lossy().into_owned());
        let flags = words.iter().filter(|word| word.starts_with('-') && word.len() > 1).cloned();
        let names = files.chain(folders).chain(flags).chain(self.call.flags.iter().cloned());
        // A word in the place of a name, a file or not.
        let stdin = "stdin".to_owned();
        let mut words = words.iter().skip(1).chain([&stdin]);
        let is_clear = said.starts_with("error: ")
            || names.into_iter().any(|name| said.contains(&name))
            || words.any(|word| {
                word.split(',').chain([word.as_str()]).any(|part| said.contains(&format!(": {part}: ")))
            });
        (!is_clear).then(|| "a message that names no file and no flag".to_owned())
    }
}

/// A word as this project's number writer, or Rust, would write a number that is not finite.
fn infinite(bytes: &[u8]) -> Option<String> {
    let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'=');
    for word in ["NaN", "inf"] {
        let mut start = 0;
        while let Some(place) = find(&bytes[start..], word.as_bytes()) {
            let (from, to) = (start + place, start + place + word.len());
            let before = from.checked_sub(1).map(|i| bytes[i]);
            if !before.is_some_and(|byte| is_letter(byte) || byte == b'+' || byte >= 0x80)
                && !bytes.get(to).is_some_and(|&byte| is_letter(byte) || byte >= 0x80)
            {
                let (low, high) = (from.saturating_sub(30), (to + 30).min(bytes.len()));
                return Some(format!("{word} ({:?})", String::from_utf8_lossy(&bytes[low..high])));
            }
            start = to;
        }
    }
    None
}

fn find(bytes: &[u8], word: &[u8]) -> Option<usize> {
    bytes.windows(word.len()).position(|window| window == word)
}

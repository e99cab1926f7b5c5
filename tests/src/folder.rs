//! A folder of its own for a test, in which the tools are called as in a shell.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use gl_inference::summary::Summary;
use gl_table::Table;
use tempfile::TempDir;

use crate::tool;

/// A temporary folder.
#[derive(Debug)]
pub struct Folder(TempDir);

impl Default for Folder {
    fn default() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
}

impl Folder {
    /// Leave it where it is, and say where.
    pub fn keep(self) -> PathBuf {
        self.0.keep()
    }

    /// The path of a file in it.
    pub fn path(&self, file: &str) -> PathBuf {
        self.0.path().join(file)
    }

    /// Write a file, in a folder that is made if need be.
    pub fn write(&self, file: &str, text: impl AsRef<[u8]>) -> &Self {
        let path = self.path(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
        self
    }

    /// Make a file or folder from elsewhere appear here.
    pub fn link(&self, target: &Path, name: &str) -> &Self {
        std::os::unix::fs::symlink(fs::canonicalize(target).unwrap(), self.path(name)).unwrap();
        self
    }

    /// A file as text.
    pub fn read(&self, file: &str) -> String {
        fs::read_to_string(self.path(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
    }

    /// A file as a table.
    pub fn table(&self, file: &str) -> Table {
        Table::read(&self.path(file)).unwrap()
    }

    /// A column of a table.
    pub fn column(&self, file: &str, name: &str) -> Vec<f64> {
        self.table(file).numbers(name).unwrap()
    }

    /// A column of texts of a table.
    pub fn texts(&self, file: &str, name: &str) -> Vec<String> {
        let table = self.table(file);
        let column = table.format().column(name).unwrap();
        (0..table.len()).map(|row| table.field(row, column).to_owned()).collect()
    }

    /// A quantity of a summary.
    pub fn quantity(&self, summary: &str, name: &str) -> f64 {
        let summary = Summary::read(&self.path(summary)).unwrap();
        summary.quantity(name).unwrap_or_else(|| panic!("no {name}"))
    }

    /// All files below it, with what they hold.
    pub fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut files = BTreeMap::new();
        let mut folders = vec![self.0.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let entry = entry.unwrap();
                let kind = entry.file_type().unwrap();
                if kind.is_dir() {
                    folders.push(entry.path());
                } else if kind.is_file() {
                    let name = entry.path().strip_prefix(self.0.path()).unwrap().to_owned();
                    files.insert(name, fs::read(entry.path()).unwrap());
                }
            }
        }
        files
    }

    /// Call a tool here, with arguments between blanks.
    pub fn call(&self, line: &str, stdin: &str) -> Output {
        let mut words = line.split_whitespace();
        tool(words.next().unwrap())
            .args(words)
            .current_dir(self.0.path())
            .write_stdin(stdin.as_bytes().to_vec())
            .output()
            .unwrap()
    }

    /// Call a tool that ends well, and get what it says on stderr.
    ///
    /// # Panics
    /// If it does not end well.
    pub fn run(&self, line: &str) -> String {
        let output = self.call(line, "");
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{line}\n{stderr}");
        stderr
    }

    /// Call a tool that ends well, and get what it writes on stdout.
    ///
    /// # Panics
    /// If it does not end well.
    pub fn stdout(&self, line: &str) -> String {
        let output = self.call(line, "");
        assert_eq!(output.status.code(), Some(0), "{line}\n{}", text(&output.stderr));
        text(&output.stdout)
    }

    /// Call a tool that must refuse its input: exit code 2, a message that holds each of `says`, nothing
    /// on stdout, and no file written, changed or left half-written.
    ///
    /// # Panics
    /// If any of this does not hold.
    pub fn refuses(&self, line: &str, says: &[&str]) {
        self.refuses_stdin(line, "", says);
    }

    /// [`Folder::refuses`] with something on stdin.
    ///
    /// # Panics
    /// See [`Folder::refuses`].
    pub fn refuses_stdin(&self, line: &str, stdin: &str, says: &[&str]) {
        let before = self.files();
        let output = self.call(line, stdin);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}\n{stderr}");
        assert!(output.stdout.is_empty(), "{line}\n{}", text(&output.stdout));
        for part in says {
            assert!(stderr.contains(part), "{line}\n{stderr}lacks {part}");
        }
        assert!(!stderr.contains("panicked"), "{stderr}");
        assert_eq!(before.keys().collect::<Vec<_>>(), self.files().keys().collect::<Vec<_>>(), "{line}");
        assert_eq!(before, self.files(), "{line}");
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

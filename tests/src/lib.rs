//! Helpers for tests that run the real binaries.

pub mod calibration;
pub mod coverage;
pub mod folder;
pub mod fuzz;
pub mod line;
pub mod packed;
pub mod site;
pub mod withheld;

use std::env;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

/// A tool of this workspace, built by the same profile as the test that asks.
///
/// # Panics
/// If it was not built: `cargo build --release` comes before the tests.
pub fn tool(name: &str) -> Command {
    let program = programs().join(name);
    assert!(program.exists(), "{}: not there; cargo build --release makes it", program.display());
    Command::new(program)
}

/// A script of this project, which finds the tools in its PATH.
pub fn script(name: &str) -> Command {
    let mut command = Command::new(root().join("scripts").join(name));
    command.env("PATH", path_with_tools());
    command
}

/// The PATH with the tools of this workspace before everything else.
pub fn path_with_tools() -> String {
    format!("{}:{}", programs().display(), env::var("PATH").unwrap_or_default())
}

/// Where cargo puts the binaries: the test itself stands in `deps` beside them.
pub fn programs() -> PathBuf {
    let test = env::current_exe().unwrap_or_default();
    test.ancestors().nth(2).map(Path::to_owned).unwrap_or_default()
}

/// The top folder of the project.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The folder of an example.
pub fn example(name: &str) -> PathBuf {
    root().join("examples").join(name)
}

/// A file of numbers that an independent program made.
pub fn oracle(name: &str) -> PathBuf {
    root().join("tests/oracle").join(name)
}

/// Whether `program` is there; if not, says that the test skips.
///
/// # Panics
/// If it is not there and `GL_REQUIRE`, a list of names separated by commas or blanks, holds it.
pub fn require(program: &str) -> bool {
    let is_there = |folder: PathBuf| folder.join(program).is_file();
    found(program, env::var_os("PATH").is_some_and(|path| env::split_paths(&path).any(is_there)))
}

/// A folder of the data that tests may use, beside the project; if it is not there, says that the test
/// skips.
///
/// # Panics
/// If it is not there and `GL_REQUIRE` holds its name.
pub fn require_data(name: &str) -> Option<PathBuf> {
    let folder = root().join("../shared/data").join(name);
    found(name, folder.is_dir()).then_some(folder)
}

fn found(name: &str, is_there: bool) -> bool {
    if !is_there {
        let required = env::var("GL_REQUIRE").unwrap_or_default();
        assert!(
            !required.split([',', ' ']).any(|required| required == name),
            "{name} is not there, and GL_REQUIRE={required}"
        );
        eprintln!("skip: {name} is not there");
    }
    is_there
}

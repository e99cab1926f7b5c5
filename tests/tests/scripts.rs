//! The tests of the scripts, which are scripts themselves and say what they do while they do it. Those that wait for a scheduler
//! run beside the pipelines (`all/cluster.rs`).

use std::io::{Error, Result};
use std::process::Command;

use pipelines::{path_with_tools, root};

fn main() -> Result<()> {
    let folder = root().join("tests/scripts");
    let mut files = Vec::new();
    for entry in folder.read_dir()? {
        let name = entry?.file_name().into_string().unwrap_or_default();
        if name.ends_with("-test.sh") && !["cluster-test.sh", "queue-test.sh"].contains(&name.as_str()) {
            files.push(name);
        }
    }
    files.sort();
    let status = Command::new(folder.join("run")).args(files).env("PATH", path_with_tools()).status()?;
    if status.success() { Ok(()) } else { Err(Error::other("a test failed")) }
}

//! The tests of the scripts, which are scripts themselves.

#![allow(clippy::unwrap_used)]

use std::process::Command;

use pipelines::{path_with_tools, root};

#[test]
fn the_scripts_pass_their_own_tests() {
    let run = root().canonicalize().unwrap().join("tests/scripts/run");
    let output = Command::new(run).env("PATH", path_with_tools()).output().unwrap();
    let said =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}");
    eprint!("{said}");
}

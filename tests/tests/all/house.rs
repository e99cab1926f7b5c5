//! What the folders promise.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pipelines::root;

/// A tool is tested through its binary: `test = false` spares each the link of a program of tests.
#[test]
fn a_tool_without_a_program_of_tests_has_no_tests_in_it() {
    for tool in fs::read_dir(root().join("tools")).unwrap().map(|entry| entry.unwrap().path()) {
        let manifest = fs::read_to_string(tool.join("Cargo.toml")).unwrap();
        if !manifest.contains("test = false") {
            continue;
        }
        for source in fs::read_dir(tool.join("src")).unwrap().map(|entry| entry.unwrap().path()) {
            assert!(source.is_file(), "{}: a folder, which this does not look into", source.display());
            let text = fs::read_to_string(&source).unwrap();
            assert!(
                !text.contains("#[test]"),
                "{}: a test that nothing runs; delete `test = false` of Cargo.toml",
                source.display()
            );
        }
    }
}

/// The scripts below a folder that explain themselves.
fn explained(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            found.extend(explained(&path));
        } else if fs::read_to_string(&path)
            .is_ok_and(|text| text.starts_with("#!/bin/bash") && text.contains("-h | --help"))
        {
            found.push(path);
        }
    }
    found
}

#[test]
fn a_script_of_an_example_explains_itself_to_the_last_line() {
    let scripts = explained(&root().join("examples"));
    assert!(scripts.len() >= 5, "{scripts:?}");
    for script in scripts {
        let text = fs::read_to_string(&script).unwrap();
        let head: Vec<&str> =
            text.lines().skip(1).map_while(|line| line.strip_prefix('#')).map(str::trim_start).collect();
        let output = Command::new("bash").arg(&script).arg("--help").output().unwrap();
        assert!(output.status.success(), "{}", script.display());
        let said = String::from_utf8(output.stdout).unwrap();
        let said: Vec<&str> = said.lines().map(str::trim_start).collect();
        assert_eq!(said, head, "{}", script.display());
    }
}

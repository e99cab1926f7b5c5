//! What the folders promise.

use std::fs;

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

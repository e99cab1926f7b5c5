//! Puts the examples into the program: a list of their files, for `gl-init`.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let examples = PathBuf::from(env::var("CARGO_MANIFEST_DIR").unwrap_or_default()).join("../../examples");
    println!("cargo::rerun-if-changed={}", examples.display());
    let mut text = "&[\n".to_owned();
    for example in sorted(&examples)? {
        if !example.join("case.toml").is_file() {
            continue;
        }
        println!("cargo::rerun-if-changed={}", example.display());
        let _ = writeln!(text, "    Example {{ name: {:?}, files: &[", name(&example));
        for file in sorted(&example)? {
            // How the measurement of an example was made is no part of a case.
            if file.is_file() && name(&file) != "make-obs" {
                let whole = fs::canonicalize(&file)?;
                let _ = writeln!(text, "        ({:?}, include_bytes!({whole:?})),", name(&file));
            }
        }
        text += "    ] },\n";
    }
    text += "]\n";
    fs::write(PathBuf::from(env::var("OUT_DIR").unwrap_or_default()).join("examples.rs"), text)
}

fn sorted(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut paths = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

fn name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

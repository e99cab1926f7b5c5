//! Runs whose files are packed into one.

use std::fmt::Write;

use crate::folder::Folder;

/// Pack the runs of these names, which have their files in the folder `runs`, as the engines do: an
/// absent file is left out.
pub fn pack(folder: &Folder, runs: &str, names: &[String]) -> String {
    let mut text = String::new();
    for name in names {
        for file in [format!("{name}_param.txt"), format!("{name}_sim.txt")] {
            if let Ok(bytes) = std::fs::read_to_string(folder.path(&format!("{runs}/{file}"))) {
                let _ = writeln!(text, "# file {file} {}\n{bytes}", bytes.len());
            }
        }
    }
    text
}

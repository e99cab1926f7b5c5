//! A new case: one of the examples, or an empty one with comments.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use gl_case::suggestion;

use crate::step::make_folder;

/// A case that is in the program.
struct Example {
    name: &'static str,
    files: &'static [(&'static str, &'static [u8])],
}

const EXAMPLES: &[Example] = include!(concat!(env!("OUT_DIR"), "/examples.rs"));

/// Names of the examples, and the heading of the page of each.
pub fn examples() -> Vec<(&'static str, String)> {
    let heading = |example: &Example| {
        let page = example.files.iter().find(|(name, _)| *name == "README.md");
        let text = page.map(|(_, bytes)| String::from_utf8_lossy(bytes).into_owned()).unwrap_or_default();
        text.lines().next().unwrap_or_default().trim_start_matches(['#', ' ']).to_owned()
    };
    EXAMPLES.iter().map(|example| (example.name, heading(example))).collect()
}

/// Make a new case in a folder that is not there yet, or empty: a copy of an example, or one to fill in.
///
/// # Errors
/// If there is no such example, or something in the folder.
pub fn init(folder: &Path, from: Option<&str>) -> Result<()> {
    let files = match from {
        None => EMPTY.iter().map(|(name, text)| (*name, text.as_bytes())).collect::<Vec<_>>(),
        Some(name) => match EXAMPLES.iter().find(|example| example.name == name) {
            Some(example) => example.files.to_vec(),
            None => {
                let names: Vec<&str> = EXAMPLES.iter().map(|example| example.name).collect();
                bail!("no example {name}; {}", suggestion(name, &names, "there are"))
            }
        },
    };
    let is_free = std::fs::read_dir(folder).map_or(!folder.exists(), |mut entries| entries.next().is_none());
    ensure!(is_free, "{}: something is there already; name a new folder", folder.display());
    make_folder(folder)?;
    // The case itself comes last, so that what has one is whole.
    let (case, others): (Vec<_>, Vec<_>) = files.into_iter().partition(|(name, _)| *name == "case.toml");
    others
        .into_iter()
        .chain(case)
        .try_for_each(|(name, bytes)| gl_table::write_whole(&folder.join(name), bytes))
}

const EMPTY: [(&str, &str); 3] = [
    ("case.toml", include_str!("init/case.toml")),
    ("params.txt", "name\tlower\tupper\tscale\teffect\toff\tunit\n"),
    ("obs.txt", "u\tf\n"),
];

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use gl_case::Case;

    use super::*;

    #[test]
    fn every_example_is_a_case() {
        let folder = tempfile::tempdir().unwrap();
        for (name, heading) in examples() {
            assert!(!heading.is_empty(), "{name}");
            let case = folder.path().join(name);
            init(&case, Some(name)).unwrap();
            let case = Case::load::<&str>(&case, &[]).unwrap();
            let (_, model) = case.engine(None).unwrap();
            assert!(!model.ends_with(".py") || case.folder.join(model).is_file(), "{name}: {model}");
            assert!(init(&case.folder, None).unwrap_err().to_string().contains("there already"));
        }
        assert!(examples().len() >= 8);
        let said = init(&folder.path().join("x"), Some("colision")).unwrap_err().to_string();
        assert_eq!(said, "no example colision; did you mean collision?");
    }

    /// Each setting is in the empty case, in a comment or not, and its comments are right once they are none.
    #[test]
    fn the_empty_case_says_every_setting() {
        let folder = tempfile::tempdir().unwrap();
        init(&folder.path().join("new"), None).unwrap();
        let text = EMPTY[0].1;
        Case::parse::<&str>(Path::new("new"), "case.toml", text, &[]).unwrap();
        let uncommented: String = text
            .lines()
            .map(|line| line.strip_prefix('#').filter(|rest| !rest.starts_with(' ')).unwrap_or(line))
            .flat_map(|line| [line, "\n"])
            .collect();
        Case::parse::<&str>(Path::new("new"), "case.toml", &uncommented, &[]).unwrap();
        for setting in Case::settings() {
            let is_there = uncommented.lines().any(|line| {
                line.starts_with(&format!("{setting} =")) || line.trim_matches(['[', ']']) == setting
            });
            assert!(is_there, "{setting} is not in the empty case");
        }
    }
}

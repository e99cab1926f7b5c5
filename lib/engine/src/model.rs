//! What is run for a row: a Yade script, or a command with placeholders.

use std::collections::HashMap;
use std::env;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use gl_inference::samples::is_word;
use serde::{Deserialize, Serialize};

use crate::batch_table::BatchTable;

/// What is run for a row.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Model {
    /// A Yade script, as an absolute path.
    Yade(PathBuf),
    /// The words of a command, in which `{NAME}` stands for a column, `{dir}` for the scratch folder of the
    /// run and `{case}` for the folder of the case.
    Command(Vec<String>),
}

impl Model {
    /// Check a model as a user gives it, before anything has run: a word that ends in `.py`, or a file of
    /// such a name, is a Yade script, looked for in `case`, then here; anything else is a command.
    ///
    /// # Errors
    /// If it is empty, a quote is not closed, a placeholder is no column of the table, or the script or the
    /// program is not there.
    pub fn check(text: &str, table: &BatchTable, case: &Path) -> Result<Self> {
        ensure!(!text.trim().is_empty(), "MODEL is empty; give a Yade script or a command");
        if let Some(name) = yade_script(text, case) {
            let script = [case.join(name), PathBuf::from(name)].into_iter().find(|path| path.is_file());
            let script = script
                .with_context(|| format!("{name}: no such script, neither in {} nor here", case.display()))?;
            ensure!(
                find_program("yade").is_some(),
                "yade is not installed, which {name} needs: apt-get install yade"
            );
            let script = fs::canonicalize(&script).with_context(|| script.display().to_string())?;
            return Ok(Self::Yade(script));
        }
        let mut words = split_words(text)?;
        for word in &words {
            for name in placeholders(word) {
                let is_known =
                    matches!(name, "dir" | "case") || table.columns().iter().any(|column| column == name);
                ensure!(
                    is_known,
                    "MODEL: {{{name}}} is no column of {}; the columns are {}, and {{dir}} and {{case}} are folders",
                    table.samples().source,
                    table.columns().join(", ")
                );
            }
        }
        check_program(&mut words[0], case)?;
        Ok(Self::Command(words))
    }

    /// The files in the folder of the case that a run is made with: those that a command is given, or the script.
    pub fn files(&self, case: &Path) -> Vec<PathBuf> {
        let words = match self {
            Self::Yade(script) => return vec![case.join(script)],
            Self::Command(words) => words,
        };
        let of_case = words
            .iter()
            .filter(|word| word.starts_with("{case}/") && placeholders(word).all(|name| name == "case"));
        let folder = case.display().to_string();
        of_case.map(|word| replace(word, &HashMap::from([("case", folder.as_str())])).into()).collect()
    }

    /// A file in the folder of the case that a command is given, and that is not there.
    pub fn missing(&self, case: &Path) -> Option<PathBuf> {
        let Self::Command(_) = self else { return None };
        self.files(case).into_iter().find(|file| !file.exists())
    }

    /// Columns that a command does not have, although it has some of them: what they are changes nothing in its runs. A
    /// script is given all of them.
    pub fn unused<'n>(&self, columns: &'n [String]) -> Vec<&'n str> {
        let Self::Command(words) = self else { return Vec::new() };
        let is_used =
            |column: &&String| words.iter().any(|word| placeholders(word).any(|name| name == *column));
        if !columns.iter().any(|column| is_used(&column)) {
            return Vec::new();
        }
        columns.iter().filter(|column| !is_used(column)).map(String::as_str).collect()
    }

    /// Whether a command is given what its run is called, and so what to call its results. A script is.
    pub fn is_told_its_name(&self) -> bool {
        let Self::Command(words) = self else { return true };
        words.iter().any(|word| placeholders(word).any(|name| name == "description"))
    }

    /// The words of the command for a row, its placeholders filled in.
    pub fn fill_in(
        words: &[String],
        table: &BatchTable,
        row: usize,
        case: &Path,
        scratch: &Path,
    ) -> Vec<String> {
        let (case, scratch) = (case.display().to_string(), scratch.display().to_string());
        let mut values: HashMap<&str, &str> =
            table.columns().iter().filter_map(|name| Some((name.as_str(), table.cell(row, name)?))).collect();
        values.extend([("case", case.as_str()), ("dir", scratch.as_str())]);
        words.iter().map(|word| replace(word, &values)).collect()
    }
}

/// The words of a command that is called once for a whole table: only `{case}` is filled in.
///
/// # Errors
/// If a quote is not closed.
pub fn command_words(text: &str, case: &Path) -> Result<Vec<String>> {
    let folder = case.display().to_string();
    let values = HashMap::from([("case", folder.as_str())]);
    Ok(split_words(text)?.iter().map(|word| replace(word, &values)).collect())
}

/// The words of a line: blanks part them, single and double quotes group, a backslash outside quotes takes
/// the next character as it is. Nothing is expanded.
///
/// # Errors
/// If a quote is not closed.
pub fn split_words(text: &str) -> Result<Vec<String>> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        match c {
            '\'' | '"' => {
                let word = word.get_or_insert_default();
                loop {
                    match characters.next() {
                        Some(end) if end == c => break,
                        Some(inner) if inner != '\n' => word.push(inner),
                        _ => bail!("MODEL: a quote is not closed: {text}"),
                    }
                }
            }
            '\\' => word.get_or_insert_default().extend(characters.next()),
            c if c.is_whitespace() => words.extend(word.take()),
            c => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    Ok(words)
}

/// Where a program is: in PATH, or beside this one.
pub fn find_program(name: &str) -> Option<PathBuf> {
    let path = env::var_os("PATH").unwrap_or_default();
    env::split_paths(&path)
        .chain(env::current_exe().ok().and_then(|own| own.parent().map(Path::to_owned)))
        .map(|folder| folder.join(name))
        .find(|file| is_program(file))
}

/// The PATH with the folder of this program behind everything else, so that a model may be one of the tools.
pub fn path_with_own() -> std::ffi::OsString {
    let path = env::var_os("PATH").unwrap_or_default();
    let own = env::current_exe().ok().and_then(|own| own.parent().map(Path::to_owned));
    env::join_paths(env::split_paths(&path).chain(own)).unwrap_or(path)
}

fn is_program(file: &Path) -> bool {
    fs::metadata(file).is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o111 != 0)
}

/// The name of a Yade script, if the model is one.
pub fn yade_script<'a>(text: &'a str, case: &Path) -> Option<&'a str> {
    let name = text.trim();
    let is_script = Path::new(name).extension() == Some(OsStr::new("py"));
    let is_name =
        !name.contains(char::is_whitespace) || case.join(name).is_file() || Path::new(name).is_file();
    (is_script && is_name).then_some(name)
}

/// Refuse a program that is not there. One that is given by a relative path is made absolute, since the
/// runs are started in folders of their own.
fn check_program(word: &mut String, case: &Path) -> Result<()> {
    let folder = case.display().to_string();
    let program = replace(word, &HashMap::from([("case", folder.as_str())]));
    if placeholders(word).any(|name| name != "case") {
        return Ok(());
    }
    if !program.contains('/') {
        ensure!(find_program(&program).is_some(), "MODEL: no program {program} in PATH");
        return Ok(());
    }
    let path = std::path::absolute(&program).with_context(|| format!("MODEL: {program}"))?;
    ensure!(path.is_file(), "MODEL: no program {program}");
    ensure!(is_program(&path), "MODEL: {program} cannot be executed; chmod +x makes it a program");
    if !word.contains("{case}") {
        *word = path.into_os_string().into_string().unwrap_or(program);
    }
    Ok(())
}

/// The names in `{NAME}`.
pub(crate) fn placeholders(word: &str) -> impl Iterator<Item = &str> {
    word.split('{')
        .skip(1)
        .filter_map(|rest| rest.split_once('}'))
        .map(|(name, _)| name)
        .filter(|name| is_word(name))
}

/// Put values in place of `{NAME}`; what a value holds is left as it is.
fn replace(word: &str, values: &HashMap<&str, &str>) -> String {
    let mut text = String::new();
    let mut rest = word;
    while let Some((before, after)) = rest.split_once('{') {
        text.push_str(before);
        match after.split_once('}').and_then(|(name, after)| Some((values.get(name)?, after))) {
            Some((value, after)) => {
                text.push_str(value);
                rest = after;
            }
            None => {
                text.push('{');
                rest = after;
            }
        }
    }
    text.push_str(rest);
    text
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn table() -> BatchTable {
        BatchTable::parse("samples.txt", b"description key E_m mu.0\nr0 0 9.3 1\n".to_vec()).unwrap()
    }

    fn words(text: &str) -> Vec<String> {
        split_words(text).unwrap()
    }

    #[test]
    fn quotes_group_and_nothing_is_expanded() {
        assert_eq!(
            words("a 'b  c'\t\"d'e\" '' $HOME * `id`"),
            ["a", "b  c", "d'e", "", "$HOME", "*", "`id`"]
        );
        assert_eq!(words("a\\ b x'y z'w \\'"), ["a b", "xy zw", "'"]);
        for open in ["a 'b", "\"", "a 'b\nc'"] {
            assert!(split_words(open).unwrap_err().to_string().contains("a quote is not closed"), "{open}");
        }
    }

    #[test]
    fn placeholders_are_filled_in_once() {
        let command = words("prog {E_m} {{mu.0}} {description}{key} {case}/x {dir} {print $1} {} {");
        let filled = Model::fill_in(&command, &table(), 0, Path::new("/a {key} b"), Path::new("/s"));
        assert_eq!(filled, ["prog", "9.3", "{1}", "r00", "/a {key} b/x", "/s", "{print", "$1}", "{}", "{"]);
    }

    #[test]
    fn what_a_command_is_not_given_is_said() {
        let columns = ["E_m", "mu.0", "key"].map(str::to_owned);
        let unused = |text: &str| Model::Command(words(text)).unused(&columns).join(" ");
        assert_eq!(unused("prog {E_m} --x={mu.0}"), "key");
        assert_eq!(unused("prog {E_m} {mu.0} {key}"), "");
        // It reads its parameters by another way.
        assert_eq!(unused("prog {description}"), "");
        assert!(Model::Yade("model.py".into()).unused(&columns).is_empty());
        let is_told = |text: &str| Model::Command(words(text)).is_told_its_name();
        assert!(is_told("prog {E_m} -o {description}_sim.txt") && !is_told("prog {E_m}"));
        let missing = |text: &str| Model::Command(words(text)).missing(Path::new("/etc"));
        assert_eq!(missing("awk -f {case}/passwd {case}/{E_m}"), None);
        assert_eq!(
            missing("awk -f {case}/no-such-script.awk"),
            Some(PathBuf::from("/etc/no-such-script.awk"))
        );
    }

    #[test]
    fn models_that_cannot_run_are_refused_with_what_would_be_right() {
        for (model, message) in [
            (" \t", "MODEL is empty"),
            ("true {b}", "{b} is no column of samples.txt; the columns are description, key, E_m, mu.0"),
            ("no-such-program {E_m}", "no program no-such-program"),
            ("./no-such-program", "no program ./no-such-program"),
            ("{case}/no-such-program", "no program"),
            ("/etc/passwd", "chmod +x"),
            ("true 'a", "a quote is not closed"),
            ("absent.py", "no such script"),
        ] {
            let error = Model::check(model, &table(), Path::new("/")).unwrap_err().to_string();
            assert!(error.contains(message), "{model}: {error}");
        }
        for model in ["true {E_m} {dir} {case} {description} {key}", "{E_m} x", "sh -c '{ echo; }'"] {
            assert!(
                matches!(Model::check(model, &table(), Path::new("/")), Ok(Model::Command(_))),
                "{model}"
            );
        }
    }

    proptest! {
        #[test]
        fn what_is_quoted_comes_back_as_it_was(parts in prop::collection::vec("[^'\n]{0,8}", 1..5)) {
            let line = parts.iter().map(|part| format!("'{part}'")).collect::<Vec<_>>().join(" ");
            prop_assert_eq!(split_words(&line).unwrap(), parts);
        }
    }
}

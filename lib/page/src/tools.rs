//! The other tools, which a report asks as a user would.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

/// A tool with its arguments.
#[derive(Clone, Debug)]
pub struct Call {
    tool: &'static str,
    arguments: Vec<String>,
}

impl Call {
    pub fn new(tool: &'static str) -> Self {
        Self { tool, arguments: Vec::new() }
    }

    /// Add arguments.
    pub fn with<S: Into<String>>(mut self, arguments: impl IntoIterator<Item = S>) -> Self {
        self.arguments.extend(arguments.into_iter().map(Into::into));
        self
    }

    /// Add an option with a file.
    pub fn file(self, option: &str, path: &Path) -> Self {
        self.with([option.to_owned(), path.display().to_string()])
    }

    /// Add an option, unless its value is empty.
    pub fn option(self, option: &str, value: &str) -> Self {
        if value.is_empty() { self } else { self.with([option, value]) }
    }

    /// What it writes to standard output.
    ///
    /// # Errors
    /// If it cannot be started or ends with another code than 0; then with what it said.
    pub fn output(&self) -> Result<String> {
        let output =
            Command::new(gl_cli::sibling(self.tool)).args(&self.arguments).output().with_context(|| {
                format!("{}: cannot be started; is it installed beside gl-report?", self.tool)
            })?;
        let said = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{}", said.trim_end());
        String::from_utf8(output.stdout).with_context(|| format!("{}: its output is no text", self.tool))
    }
}

/// As it would be typed.
impl std::fmt::Display for Call {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}", self.tool)?;
        self.arguments.iter().try_for_each(|argument| write!(formatter, " {}", quoted(argument)))
    }
}

/// A word as a shell reads it.
pub fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+%@{}".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_is_shown_as_it_would_be_typed() {
        let call =
            Call::new("gl-plot").with(["fit"]).file("-b", Path::new("a b/obs.txt")).option("--noise", "");
        assert_eq!(call.to_string(), "gl-plot fit -b 'a b/obs.txt'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
    }
}

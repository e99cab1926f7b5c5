//! The other tools, which a report asks as a user would.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::rc::Rc;

use anyhow::{Context, Result, ensure};
use gl_case::shell::quoted;

/// A tool with its arguments.
#[derive(Clone, Debug)]
pub struct Call {
    tool: &'static str,
    arguments: Vec<String>,
    /// What it reads, and the call that wrote that.
    fed: Option<(Rc<str>, String)>,
}

impl Call {
    pub fn new(tool: &'static str) -> Self {
        Self { tool, arguments: Vec::new(), fed: None }
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

    /// Let it read what another call writes.
    ///
    /// # Errors
    /// See [`Call::output`].
    pub fn fed(mut self, other: &Self) -> Result<Self> {
        self.fed = Some((other.output()?.into(), other.to_string()));
        Ok(self)
    }

    /// What it writes to standard output.
    ///
    /// # Errors
    /// If it cannot be started or ends with another code than 0; then with what it said.
    pub fn output(&self) -> Result<String> {
        let mut command = Command::new(gl_cli::sibling(self.tool));
        let cannot = || format!("{}: cannot be started; is it installed beside gl-report?", self.tool);
        command.args(&self.arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
        command.stdin(if self.fed.is_some() { Stdio::piped() } else { Stdio::inherit() });
        let mut started = command.spawn().with_context(cannot)?;
        // These tools read all before they write; one that does not want it says why.
        if let (Some(mut stdin), Some((text, _))) = (started.stdin.take(), &self.fed) {
            let _ = stdin.write_all(text.as_bytes());
        }
        let output = started.wait_with_output().with_context(cannot)?;
        let said = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "{}", said.trim_end());
        String::from_utf8(output.stdout).with_context(|| format!("{}: its output is no text", self.tool))
    }
}

/// As it would be typed.
impl std::fmt::Display for Call {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some((_, before)) = &self.fed {
            write!(formatter, "{before} | ")?;
        }
        write!(formatter, "{}", self.tool)?;
        self.arguments.iter().try_for_each(|argument| write!(formatter, " {}", quoted(argument)))
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
    }
}

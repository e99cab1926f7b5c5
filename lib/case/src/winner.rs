use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use gl_inference::observations::ByName;

/// What a diagnosis puts in where it calibrates again, as it stands in its `winner.txt`: the effects of the simulation on
/// the first line, and the errors of the rig with their sizes on a second one, if there are any.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Winner {
    /// Effects of the simulation.
    pub effects: Vec<String>,
    /// Errors of the rig: name, and size in the units of its kind.
    pub rig: ByName,
}

impl Winner {
    /// Name of the file.
    pub const FILE: &str = "winner.txt";

    /// That of the diagnosis in a folder; none before it is known.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn read(out: &Path) -> Result<Option<Self>> {
        let path = out.join(Self::FILE);
        if !path.exists() {
            return Ok(None);
        }
        let text =
            std::fs::read_to_string(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        Self::parse(&text)
            .with_context(|| format!("{}: is no winner; call gl-diagnose again", path.display()))
            .map(Some)
    }

    fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines();
        let effects = lines.next()?.split(',').filter(|name| !name.is_empty()).map(str::to_owned).collect();
        let rig = lines.next().map_or(Some(ByName::default()), |line| line.parse().ok())?;
        Some(Self { effects, rig })
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let rig = &self.rig;
        let end = if rig.is_empty() { "" } else { "\n" };
        format!("{}\n{rig}{end}", self.effects.join(","))
    }

    /// Whether nothing is put in.
    pub fn is_nothing(&self) -> bool {
        self.effects.is_empty() && self.rig.is_empty()
    }

    /// Names of the effects, and of the errors behind them.
    pub fn names(&self) -> Vec<&str> {
        self.effects.iter().map(String::as_str).chain(self.rig.names()).collect()
    }

    /// The calibration with it in, of a diagnosis in `out`: its name has no comma, since commas part the tables that tools
    /// take, and none of what has to be quoted.
    pub fn folder(&self, out: &Path) -> PathBuf {
        let mut parts = self.effects.clone();
        if !self.rig.is_empty() {
            parts.push("rig".to_owned());
        }
        out.join(format!("after-{}", parts.join("+")))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_winner_is_read_as_it_was_written() {
        for (effects, rig, text, folder) in [
            (vec![], vec![], "\n", "after-"),
            (vec!["lugs", "hub"], vec![], "lugs,hub\n", "after-lugs+hub"),
            (vec!["lugs"], vec![("offset(z)", 5.6)], "lugs\noffset(z)=5.6\n", "after-lugs+rig"),
            (
                vec![],
                vec![("lag(a)", 1e-9), ("gain(a.q)", -0.5)],
                "\nlag(a)=1e-9,gain(a.q)=-0.5\n",
                "after-rig",
            ),
        ] {
            let winner = Winner {
                effects: effects.into_iter().map(str::to_owned).collect(),
                rig: rig.into_iter().map(|(name, size)| (name.to_owned(), size)).collect(),
            };
            assert_eq!(winner.text(), text);
            assert_eq!(Winner::parse(text).unwrap(), winner);
            assert_eq!(winner.folder(Path::new("out")), Path::new("out").join(folder));
        }
        assert_eq!(Winner::parse("lugs\noffset(z)\n"), None);
    }
}

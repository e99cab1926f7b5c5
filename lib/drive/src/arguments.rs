//! What all drivers are called with.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use gl_case::{Case, Engine, Settings};

use crate::step::put;

/// The case, how its runs are made, where the results go, and settings for this call.
#[derive(Args, Clone, Debug)]
pub struct Request {
    /// Folder of the case, with params.txt, obs.txt and case.toml
    #[arg(value_name = "CASE")]
    pub case: PathBuf,
    /// How the runs are made: embedded, local, yade-batch, slurm or pbs; by default the first of the first
    /// three that the case has a model for
    #[arg(short, long, value_name = "ENGINE")]
    pub engine: Option<Engine>,
    /// Folder of the results
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Settings of case.toml for this call, such as num=40 or noise=f=0.01
    #[arg(value_name = "KEY=VALUE")]
    pub given: Vec<String>,
}

/// What a folder of results is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Results {
    /// A calibration.
    Calibration,
    /// A diagnosis.
    Diagnosis,
}

impl Results {
    /// What its folder is called by, behind the name of the case.
    fn suffix(self) -> &'static str {
        match self {
            Self::Calibration => "",
            Self::Diagnosis => "-diagnosis",
        }
    }

    /// The other kind, and what is in a folder of that alone.
    fn other(self) -> (&'static str, &'static str) {
        match self {
            Self::Calibration => ("diagnosis", "base/iter0"),
            Self::Diagnosis => ("calibration", "iter0"),
        }
    }
}

impl Request {
    /// Read the case, with the settings of this call.
    ///
    /// # Errors
    /// If there is none, or a setting is wrong.
    pub fn load(&self) -> Result<Case> {
        ensure!(
            !self.case.as_os_str().is_empty() && !is_setting(&self.case),
            "{}: is no folder of a case; CASE comes first",
            self.case.display()
        );
        ensure!(!self.case.is_file(), "{}: is a file; give the folder that it is in", self.case.display());
        Case::load(&as_operand(&self.case), &self.given)
    }

    /// Where the results go: `out/NAME-OF-CASE-FOLDER`, of a diagnosis with `-diagnosis` behind it, if nothing was said.
    ///
    /// # Errors
    /// If the folder of the case has no name.
    pub fn folder(&self, of: Results) -> Result<PathBuf> {
        if let Some(out) = &self.out {
            return Ok(as_operand(out));
        }
        let folder = self.case.canonicalize().with_context(|| self.case.display().to_string())?;
        let Some(name) = folder.file_name() else {
            bail!("{}: has no name to call the results by; give --out", folder.display())
        };
        let mut name = name.to_owned();
        name.push(of.suffix());
        Ok(Path::new("out").join(name))
    }

    /// The same, if there are no results of the other kind in it, whose files would be mixed with its own.
    ///
    /// # Errors
    /// If there are some, or the folder of the case has no name.
    pub fn own_folder(&self, of: Results) -> Result<PathBuf> {
        let out = self.folder(of)?;
        let (other, mark) = of.other();
        ensure!(
            !out.join(mark).exists(),
            "{}: has a {other} in it ({mark}), with which this would be mixed; give another --out",
            out.display()
        );
        Ok(out)
    }

    /// Keep what was given, where it changes what is computed; the time of the file is that of the last change.
    ///
    /// # Errors
    /// If the results of another case are kept there.
    pub(crate) fn keep(&self, case: &Case, engine: Engine, out: &Path) -> Result<PathBuf> {
        if let Some(before) = Settings::read(out)? {
            ensure!(
                before.case == case.name,
                "{}: has the results of another case in it, {} ({}), and this is {}; give another --out",
                out.display(),
                before.case,
                Settings::FILE,
                case.name
            );
        }
        let limits = |text: &&String| !text.to_lowercase().starts_with("iterations=");
        let given = self.given.iter().filter(limits).cloned().collect();
        let file = out.join(Settings::FILE);
        put(&file, Settings { case: case.name.clone(), engine, given }.text()?.as_bytes())?;
        Ok(file)
    }
}

/// A path that none of the tools which get it takes for an option.
fn as_operand(path: &Path) -> PathBuf {
    let is_like_an_option = path.as_os_str().as_encoded_bytes().starts_with(b"-");
    if is_like_an_option { Path::new(".").join(path) } else { path.to_owned() }
}

fn is_setting(path: &Path) -> bool {
    path.to_str().is_some_and(|text| text.contains('=')) && !path.exists()
}

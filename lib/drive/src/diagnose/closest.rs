//! The fits that a shrink is measured between beside a rest: those that come as close to the measurement as the model can.
//!
//! A calibration takes what a rest leaves for a noise that is correlated. That is right for the parameters, but does not
//! come as close as the model can, least of all without the effect. The fit of least squares, by a white noise, does.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_case::{Case, Winner, folders};
use gl_gap::attribute::winner::MostProbable;

use super::Diagnosis;
use crate::Progress;
use crate::calibrate::emulated::of_test_or_none;
use crate::calibrate::{done, is_settled};
use crate::step::{copy, join, make_folder};

/// Iterations of a closest fit at the most: it begins with the runs of a calibration, and takes few more.
pub(crate) fn iterations(case: &Case) -> usize {
    case.iterations.min(6)
}

impl Diagnosis<'_> {
    /// The folders of the fits that the shrink is measured between: the calibrations without and with the winner, beside a
    /// rest the closest fits, if both settle; none where runs are in a queue.
    pub(super) fn between(
        &self,
        base: PathBuf,
        after: PathBuf,
        winner: &Winner,
    ) -> Result<Option<(PathBuf, PathBuf)>> {
        if self.is_weighed() || !MostProbable::of(&self.attributed()?.0)?.is_beside_a_rest {
            return Ok(Some((base, after)));
        }
        let say = |text: &str| gl_cli::note("gl-diagnose", text);
        let closest = [folders::closest(&base), folders::closest(&after)];
        if closest.iter().any(|out| done(out) == 0) {
            say(
                "beside a rest the gap is measured between closest fits, which go on from the runs of both calibrations",
            );
        }
        for (of, with) in [(&base, None), (&after, Some(winner))] {
            if self.closest(of, with)? == Progress::InQueue {
                return Ok(None);
            }
        }
        let [before, with] = closest;
        if is_settled(&before)? && is_settled(&with)? {
            return Ok(Some((before, with)));
        }
        say("a closest fit has not settled: the gap is measured between the calibrations");
        Ok(Some((base, after)))
    }

    /// Go on from the runs of a calibration to the closest fit.
    fn closest(&self, of: &Path, with: Option<&Winner>) -> Result<Progress> {
        let out = folders::closest(of);
        let mut inputs = self.inputs();
        inputs.push(of.join("posterior.txt"));
        let known = || self.runs_of(of, &out.join("known")).map(Some);
        let settings = ["white=true".to_owned(), format!("iterations={}", iterations(self.case))];
        self.calibrated(&out, with, known, &inputs, &settings)
    }

    /// The runs of a calibration as `samples.txt` and the ensemble of each test in a folder.
    fn runs_of(&self, calibration: &Path, folder: &Path) -> Result<PathBuf> {
        make_folder(folder)?;
        for test in &self.case.tests {
            let ensemble = of_test_or_none("ensemble", test, "");
            copy(&calibration.join(&ensemble), &folder.join(&ensemble))?;
        }
        let made = (0..done(calibration)).map(|i| calibration.join(format!("iter{i}/samples.txt")));
        let known = Some(calibration.join("known/samples.txt")).filter(|known| known.is_file());
        join(&known.into_iter().chain(made).collect::<Vec<_>>(), &folder.join("samples.txt"), None)?;
        Ok(folder.to_owned())
    }
}

//! Effects of the measurement itself, which transform a predicted curve and need no runs.

use std::str::FromStr;

use anyhow::{Error, Result, bail};

use crate::attribute::problem::path::Path;
use crate::attribute::problem::test::Test;
use gl_inference::prior::{normal_cdf, normal_quantile};

/// How a measurement may be at fault. Sizes are given as shares of ranges: the observable's, or the
/// control's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A constant added to an observable.
    Offset,
    /// An observable multiplied by 1 + gain.
    Gain,
    /// An error of an observable that grows evenly along the way travelled.
    Drift,
    /// The rig gives way under load: the specimen sees the control less a part proportional to the
    /// first observable, which is taken for the load.
    Compliance,
    /// The observables are recorded late: they belong to an earlier control value.
    Lag,
}

/// Standard deviation of the prior of a size, as a share of the range.
const PRIOR_SD: f64 = 0.1;

impl FromStr for Kind {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Ok(match text.trim() {
            "offset" => Self::Offset,
            "gain" => Self::Gain,
            "drift" => Self::Drift,
            "compliance" => Self::Compliance,
            "lag" => Self::Lag,
            other => bail!(
                "{other:?} is no effect of the measurement; they are offset, gain, drift, compliance, lag"
            ),
        })
    }
}

impl Kind {
    fn word(self) -> &'static str {
        match self {
            Self::Offset => "offset",
            Self::Gain => "gain",
            Self::Drift => "drift",
            Self::Compliance => "compliance",
            Self::Lag => "lag",
        }
    }

    /// Whether it moves the control, not an observable.
    fn is_of_control(self) -> bool {
        matches!(self, Self::Compliance | Self::Lag)
    }
}

/// One effect of the measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasurementEffect {
    /// What kind it is.
    pub kind: Kind,
    /// The test that it acts in.
    pub test: usize,
    /// The observable of the test that it acts on; for compliance the load; 0 for a lag.
    pub observable: usize,
    /// Its name: `offset(q)`, `gain(q)`, `drift(q)`, `compliance`, `lag`; with tests `offset(tx100.q)`,
    /// `compliance(tx100)`.
    pub name: String,
}

impl MeasurementEffect {
    /// The effects of some kinds on one test: one an observable, or one alone for those of the control.
    pub fn all(kinds: &[Kind], observables: &[String]) -> Vec<Self> {
        kinds.iter().flat_map(|&kind| Self::in_test(kind, 0, "", observables)).collect()
    }

    /// The effects of some kinds, each in one of several tests, whose observables stand behind each other.
    pub fn of_tests(kinds: &[Kind], observables: &[String], tests: &[Test]) -> Vec<Self> {
        let of = |&kind: &Kind| {
            let tests = tests.iter().enumerate();
            tests.flat_map(move |(place, test)| {
                Self::in_test(kind, place, &test.name, &observables[test.observables.clone()])
            })
        };
        kinds.iter().flat_map(of).collect()
    }

    fn in_test(kind: Kind, test: usize, name: &str, observables: &[String]) -> Vec<Self> {
        let word = kind.word();
        if kind.is_of_control() {
            let name = if name.is_empty() { word.to_owned() } else { format!("{word}({name})") };
            return vec![Self { kind, test, observable: 0, name }];
        }
        let named = observables.iter().enumerate();
        named.map(|(observable, of)| Self { kind, test, observable, name: format!("{word}({of})") }).collect()
    }

    /// Its size for a standard normal `w`: normal of standard deviation 0.1 of the range, or the
    /// positive half of it where a size cannot be negative (compliance, lag).
    pub fn size(&self, w: f64) -> f64 {
        if self.kind.is_of_control() {
            PRIOR_SD * normal_quantile(0.5 * (1.0 + normal_cdf(w))).min(8.0)
        } else {
            PRIOR_SD * w
        }
    }

    /// Apply it at a size to a curve of its test, shape (observables · steps), with the observables' ranges.
    pub fn apply(&self, size: f64, path: &Path, ranges: &[f64], curve: &mut [f64]) {
        let steps = path.control().len();
        let range = ranges[self.observable];
        let own = self.observable * steps..(self.observable + 1) * steps;
        match self.kind {
            Kind::Offset => curve[own].iter_mut().for_each(|y| *y += size * range),
            Kind::Gain => curve[own].iter_mut().for_each(|y| *y *= 1.0 + size),
            Kind::Drift => {
                for (y, travelled) in curve[own].iter_mut().zip(path.travelled()) {
                    *y += size * range * travelled;
                }
            }
            Kind::Compliance => {
                let shift: Vec<f64> =
                    curve[own].iter().map(|load| -size * path.range() * load / range).collect();
                for observable in curve.chunks_exact_mut(steps) {
                    let seen = path.shifted(observable, &shift);
                    observable.copy_from_slice(&seen);
                }
            }
            Kind::Lag => {
                for observable in curve.chunks_exact_mut(steps) {
                    let seen = path.delayed(observable, size);
                    observable.copy_from_slice(&seen);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_compliance_makes_a_spring_softer() {
        // Load 2u in series with a rig of compliance c: u = x + c·2x, so 2x = 2u / (1 + 2c). To first
        // order in c, as the load that moves the rig is the predicted one.
        let control: Vec<f64> = (0..21).map(|t| f64::from(t) / 20.0).collect();
        let mut curve: Vec<f64> = control.iter().map(|u| 2.0 * u).collect();
        let path = Path::new(&control);
        let effect = &MeasurementEffect::all(&[Kind::Compliance], &["f".to_owned()])[0];
        effect.apply(0.01, &path, &[2.0], &mut curve);
        for (y, u) in curve.iter().zip(&control) {
            assert!((y - 2.0 * u / 1.01).abs() < 3e-4, "{u}");
        }
    }

    #[test]
    fn sizes_of_the_control_are_never_negative() {
        let effect = &MeasurementEffect::all(&[Kind::Lag], &[])[0];
        assert!(effect.size(-5.0) >= 0.0);
        assert!((effect.size(0.0) - 0.1 * 0.674_489_750_196_08).abs() < 1e-9);
    }
}

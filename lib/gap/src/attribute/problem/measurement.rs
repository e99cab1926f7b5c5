//! Errors of the rig as candidates: they transform a predicted curve, and need no runs.

use crate::attribute::problem::test::Test;
use gl_inference::path::Path;
use gl_inference::prior::{normal_cdf, normal_quantile};
use gl_inference::rig::Kind;

/// Standard deviation of the prior of a size, as a share of the range.
const PRIOR_SD: f64 = 0.1;

/// One effect of the measurement. Its size is given as a share of a range: the observable's, or the control's.
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

    /// What a size of 1 is in the units of its kind.
    pub fn unit(&self, path: &Path, ranges: &[f64]) -> f64 {
        let (range, way) = (ranges[self.observable], path.range());
        match self.kind {
            Kind::Offset | Kind::Drift => range,
            Kind::Gain => 1.0,
            Kind::Compliance => way / range,
            Kind::Lag => way,
        }
    }

    /// Apply it at a size to a curve of its test, shape (observables · steps), with the observables' ranges.
    pub fn apply(&self, size: f64, path: &Path, ranges: &[f64], curve: &mut [f64]) {
        self.kind.apply(size * self.unit(path, ranges), self.observable, path, curve);
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

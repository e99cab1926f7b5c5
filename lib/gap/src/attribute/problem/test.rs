//! The tests of a measurement: which readings are whose, and the control that they share.

use std::ops::Range;

use crate::attribute::problem::discrepancy::Smooth;
use gl_inference::observations::Observations;
use gl_inference::path::Path;
use gl_inference::stack::Stack;

/// One test: observables that share a control. All readings stand behind each other, test by test, observable by
/// observable and step by step.
#[derive(Clone, Debug)]
pub struct Test {
    /// Its name; empty where there is no other.
    pub name: String,
    /// Name of its control.
    pub control_name: String,
    /// Unit of its control, where it is known.
    pub control_unit: Option<String>,
    /// Its control.
    pub path: Path,
    /// Places of its observables among those of all tests.
    pub observables: Range<usize>,
    /// Places of its readings among those of all tests.
    pub readings: Range<usize>,
    /// Smooth patterns of a discrepancy of one of its observables.
    pub smooth: Smooth,
    /// What an effect of another form would be multiplied by.
    pub(super) form: Smooth,
}

impl Test {
    /// A test of so many observables, behind those of the tests before it.
    ///
    /// * `control` — its name and its values, shape (steps,).
    pub fn new(
        name: &str,
        (control_name, control): (&str, &[f64]),
        observables: usize,
        before: Option<&Self>,
    ) -> Self {
        let path = Path::new(control);
        let places = path.places();
        let first = before.map_or((0, 0), |before| (before.observables.end, before.readings.end));
        Self {
            name: name.to_owned(),
            control_name: control_name.to_owned(),
            control_unit: None,
            observables: first.0..first.0 + observables,
            readings: first.1..first.1 + observables * control.len(),
            smooth: Smooth::new(&places),
            form: Smooth::of_form(&places),
            path,
        }
    }

    /// The one test of a measurement.
    pub fn of(observations: &Observations) -> Vec<Self> {
        let control = (observations.control_name.as_str(), observations.control.as_slice());
        vec![Self::new("", control, observations.names.len(), None)]
    }

    /// The tests of a stack.
    pub fn of_stack(stack: &Stack) -> Vec<Self> {
        let mut tests: Vec<Self> = Vec::with_capacity(stack.tests.len());
        for test in &stack.tests {
            let Observations { control_name, control, names, .. } = &test.observations;
            let control = (control_name.as_str(), &control[test.steps.clone()]);
            tests.push(Self::new(&test.name, control, names.len(), tests.last()));
        }
        tests
    }

    /// Number of its steps.
    pub fn steps(&self) -> usize {
        self.path.control().len()
    }

    /// The readings of an observable, which is one of its own.
    pub fn own(&self, observable: usize) -> Range<usize> {
        let first = self.readings.start + (observable - self.observables.start) * self.steps();
        first..first + self.steps()
    }
}

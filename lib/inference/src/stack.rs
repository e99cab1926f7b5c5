//! Several tests of the same samples as one measurement.
//!
//! A test has a measurement, a control and observables of its own. In a stack its observables are called
//! `test.observable`, each at the steps of its test, and stand behind those of the tests before it. What is correlated
//! along the control is so within an observable, and never from one test to another.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail, ensure};

use crate::ensemble::Ensemble;
use crate::misfit::Incomplete;
use crate::observations::{ByName, Observations, Steps};

/// What a test is: `NAME:OBS:CONTROL:OBSERVABLES[:NOISE[:STEPS]]`.
#[derive(Clone, Debug, PartialEq)]
pub struct TestTables {
    /// Its name.
    pub name: String,
    /// Table of the measurement.
    pub observations: PathBuf,
    /// Column of the control.
    pub control: String,
    /// Columns of the observables.
    pub observables: Vec<String>,
    /// Standard deviation of the noise; where it is empty, the `_sd` columns have it.
    pub noise: ByName,
    /// Steps that are compared.
    pub steps: Steps,
}

/// Whether a test may be called so: observables are named `test.observable`, files `test/…`.
pub fn is_test_name(name: &str) -> bool {
    let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    !name.is_empty() && name.len() <= 60 && !name.starts_with('-') && name.chars().all(is_letter)
}

/// What an observable is called beside those of other tests: `test.observable` where its test has a name.
pub fn named(test: &str, observable: &str) -> String {
    if test.is_empty() { observable.to_owned() } else { format!("{test}.{observable}") }
}

impl FromStr for TestTables {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let parts: Vec<&str> = text.splitn(6, ':').collect();
        let [name, observations, control, observables, rest @ ..] = parts.as_slice() else {
            bail!("{text:?} is not NAME:OBS:CONTROL:OBSERVABLES[:NOISE[:STEPS]]");
        };
        ensure!(
            is_test_name(name),
            "{name:?} is no name of a test; give up to 60 letters, digits, _ and -, such as tx100"
        );
        for (what, part) in [("measurement", observations), ("control", control)] {
            ensure!(!part.is_empty(), "the test {name} has no {what}; give NAME:OBS:CONTROL:OBSERVABLES");
        }
        let observables: Vec<String> = observables.split(',').map(|name| name.trim().to_owned()).collect();
        ensure!(
            observables.iter().all(|name| !name.is_empty()),
            "the test {name} has an observable without a name; give them as q,e_v"
        );
        let noise = match rest.first() {
            Some(noise) if !noise.is_empty() => noise.parse().with_context(|| format!("noise of {name}"))?,
            _ => ByName::default(),
        };
        let steps = match rest.get(1) {
            Some(steps) if !steps.is_empty() => steps.parse().with_context(|| format!("steps of {name}"))?,
            _ => Steps::ALL,
        };
        Ok(Self {
            name: (*name).to_owned(),
            observations: observations.into(),
            control: (*control).to_owned(),
            observables,
            noise,
            steps,
        })
    }
}

/// A table of a test, `NAME=FILE`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OfTest {
    /// Name of the test.
    pub test: String,
    /// The table.
    pub path: PathBuf,
}

impl FromStr for OfTest {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (test, path) =
            text.split_once('=').filter(|(test, _)| is_test_name(test)).with_context(|| {
                format!("{text:?} is not TEST=FILE; with --test each table says of which test it is")
            })?;
        Ok(Self { test: test.to_owned(), path: path.into() })
    }
}

/// One test of a stack.
#[derive(Clone, Debug)]
pub struct Test {
    /// Its name.
    pub name: String,
    /// Its own measurement, whole.
    pub observations: Observations,
    /// Steps that are compared.
    pub steps: Range<usize>,
    /// Standard deviation of its noise at all steps, shape (observables, steps), where it is known.
    pub noise: Option<Vec<Vec<f64>>>,
    /// Places of its observables in the stack.
    pub observables: Range<usize>,
}

/// Several tests as one measurement.
#[derive(Clone, Debug)]
pub struct Stack {
    /// The tests.
    pub tests: Vec<Test>,
    /// All observables as `test.observable`, each at the compared steps of its test. The control is the number of
    /// the step, up to that of the longest test.
    pub observations: Observations,
    /// Standard deviation of the noise, shape (observables, compared steps of its test), where it is known.
    pub noise: Option<Vec<Vec<f64>>>,
}

impl Stack {
    /// Read the measurements.
    ///
    /// # Errors
    /// If a measurement cannot be read, two tests have one name, or the noise of some is known and of others not.
    pub fn read(tables: &[TestTables]) -> Result<Self> {
        let mut tests: Vec<Test> = Vec::with_capacity(tables.len());
        for of in tables {
            ensure!(tests.iter().all(|test| test.name != of.name), "--test {}: given twice", of.name);
            let observations = Observations::read(&of.observations, &of.control, &of.observables)?;
            let noise = observations.noise(&of.noise).with_context(|| format!("test {}", of.name))?;
            let steps = of.steps.within(observations.steps()).with_context(|| format!("test {}", of.name))?;
            let first = tests.last().map_or(0, |test| test.observables.end);
            let observables = first..first + observations.names.len();
            tests.push(Test { name: of.name.clone(), observations, steps, noise, observables });
        }
        Self::new(tests)
    }

    fn new(tests: Vec<Test>) -> Result<Self> {
        ensure!(!tests.is_empty(), "no test given");
        let is_known = |test: &&Test| test.noise.is_some();
        if let (Some(known), Some(not)) = (tests.iter().find(is_known), tests.iter().find(|t| !is_known(t))) {
            bail!(
                "the noise of the test {} is known and that of {} is not; give it for each test, as \
                 NAME:OBS:CONTROL:OBSERVABLES:NOISE or by _sd columns, or for none",
                known.name,
                not.name
            );
        }
        let longest = tests.iter().map(|test| test.steps.len()).max().unwrap_or(0);
        let sources: Vec<&str> = tests.iter().map(|test| test.observations.source.as_str()).collect();
        let parts: Vec<Observations> =
            tests.iter().map(|test| test.observations.part(test.steps.clone())).collect();
        let names = tests
            .iter()
            .flat_map(|test| test.observations.names.iter().map(move |name| named(&test.name, name)));
        let observations = Observations {
            source: sources.join(" and "),
            control_name: "step".to_owned(),
            control: (0..longest).map(|step| step as f64).collect(),
            names: names.collect(),
            values: parts.iter().flat_map(|part| part.values.clone()).collect(),
            sd: parts.iter().flat_map(|part| part.sd.clone()).collect(),
            far_off: Vec::new(),
        };
        let noise: Option<Vec<Vec<Vec<f64>>>> = tests
            .iter()
            .map(|test| {
                let cut = |noise: &Vec<f64>| noise[test.steps.clone()].to_vec();
                Some(test.noise.as_ref()?.iter().map(cut).collect())
            })
            .collect();
        Ok(Self { tests, observations, noise: noise.map(|noise| noise.concat()) })
    }

    /// The ensembles of each test, those of a test behind each other, shape (tests,).
    ///
    /// # Errors
    /// If a table cannot be read, names no test, or a test has none.
    pub fn read_ensembles(&self, tables: &[OfTest]) -> Result<Vec<Ensemble>> {
        let names = || self.tests.iter().map(|test| test.name.as_str()).collect::<Vec<_>>().join(", ");
        for table in tables {
            ensure!(
                self.tests.iter().any(|test| test.name == table.test),
                "{}={}: no such test; they are {}",
                table.test,
                table.path.display(),
                names()
            );
        }
        let of = |test: &Test| {
            let own = tables.iter().filter(|table| table.test == test.name);
            let read = own.map(|table| {
                Ensemble::read(&table.path, &test.observations.control_name, &test.observations.names)
            });
            let read = read.collect::<Result<Vec<_>>>()?;
            ensure!(!read.is_empty(), "the test {} has no ensemble; give {}=FILE", test.name, test.name);
            let ensemble = Ensemble::concatenate(read)?;
            ensemble.check_steps(&test.observations)?;
            Ok(ensemble)
        };
        self.tests.iter().map(of).collect()
    }

    /// The ensembles, shape (tests,), with the samples that are in all of them at the compared steps, in one order;
    /// and those that some test lacks.
    pub fn common(&self, ensembles: &[Ensemble]) -> (Vec<Ensemble>, Vec<Incomplete>) {
        let places: Vec<HashMap<&str, usize>> = ensembles.iter().map(Ensemble::index).collect();
        let mut incomplete: Vec<Incomplete> = self
            .tests
            .iter()
            .map(|test| Incomplete { test: test.name.clone(), samples: Vec::new() })
            .collect();
        let mut runs: Vec<Vec<usize>> = vec![Vec::new(); ensembles.len()];
        let mut seen = HashSet::new();
        let names = ensembles.iter().flat_map(|ensemble| &ensemble.samples);
        for name in names.filter(|name| seen.insert(name.as_str())) {
            let found: Vec<Option<usize>> =
                places.iter().map(|places| places.get(name.as_str()).copied()).collect();
            for (_, of) in found.iter().zip(&mut incomplete).filter(|(run, _)| run.is_none()) {
                of.samples.push(name.clone());
            }
            if found.iter().all(Option::is_some) {
                runs.iter_mut().zip(found).for_each(|(runs, run)| runs.extend(run));
            }
        }
        incomplete.retain(|of| !of.samples.is_empty());
        let chosen = self.tests.iter().zip(ensembles).zip(&runs);
        let chosen =
            chosen.map(|((test, ensemble), runs)| ensemble.with_runs(runs, test.steps.clone())).collect();
        (chosen, incomplete)
    }

    /// The runs of samples that are in the ensembles of all tests, shape (tests,), as one ensemble; and those that
    /// some test lacks.
    ///
    /// # Errors
    /// If some ensembles are of an emulator and others of a simulator.
    pub fn ensemble(&self, ensembles: &[Ensemble]) -> Result<(Ensemble, Vec<Incomplete>)> {
        let (common, incomplete) = self.common(ensembles);
        let is_emulated = |ensemble: &Ensemble| !ensemble.is_empty() && ensemble.curve_sd(0, 0).is_some();
        let with_sd = common.iter().any(is_emulated);
        if let Some(plain) = common.iter().find(|ensemble| with_sd && !is_emulated(ensemble)) {
            bail!("{}: no _sd columns, but another test has them", plain.source);
        }
        let mut stacked = Ensemble::new(&self.observations, with_sd);
        stacked.source =
            ensembles.iter().map(|ensemble| ensemble.source.as_str()).collect::<Vec<_>>().join(" and ");
        for run in 0..common.first().map_or(0, Ensemble::len) {
            let curves: Vec<Vec<f64>> = common.iter().flat_map(|ensemble| ensemble.curves(run)).collect();
            let sd = common.iter().flat_map(|ensemble| {
                (0..ensemble.observables.len()).filter_map(move |j| ensemble.curve_sd(run, j))
            });
            let sd: Vec<Vec<f64>> = sd.map(<[f64]>::to_vec).collect();
            stacked.push(&common[0].samples[run], &curves, with_sd.then_some(&sd));
        }
        Ok((stacked, incomplete))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observations(table: &str, control: &str, observables: &[&str]) -> Observations {
        let table = gl_table::Table::parse("obs", table.as_bytes().to_vec()).unwrap();
        let names: Vec<String> = observables.iter().map(|name| (*name).to_owned()).collect();
        Observations::from_table(&table, control, &names).unwrap()
    }

    fn stack() -> Stack {
        let tx = observations("e q v\n0 1 5\n1 2 6\n2 3 7\n", "e", &["q", "v"]);
        let angle = observations("t a\n0 30\n", "t", &["a"]);
        let test = |name: &str, observations: Observations, observables: Range<usize>| Test {
            name: name.to_owned(),
            steps: 0..observations.steps(),
            noise: observations.noise(&ByName::default()).unwrap(),
            observations,
            observables,
        };
        Stack::new(vec![test("tx", tx, 0..2), test("repose", angle, 2..3)]).unwrap()
    }

    #[test]
    fn observables_of_a_stack_are_named_by_test_and_keep_their_own_steps() {
        let stack = stack();
        assert_eq!(stack.observations.names, ["tx.q", "tx.v", "repose.a"]);
        assert_eq!(stack.observations.values, [vec![1.0, 2.0, 3.0], vec![5.0, 6.0, 7.0], vec![30.0]]);
        assert_eq!(stack.observations.steps(), 3);
    }

    #[test]
    fn a_sample_that_a_test_lacks_is_left_out_with_that_test_named() {
        let stack = stack();
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let tx = b"sample step e q v\na 0 0 1 5\na 1 1 2 6\na 2 2 3 7\nb 0 0 1 1\nb 1 1 1 1\nb 2 2 1 1\n";
        let tx = Ensemble::parse("tx.txt", tx, "e", &names(&["q", "v"])).unwrap();
        let repose = b"sample step t a\nc 0 0 31\na 0 0 29\n";
        let repose = Ensemble::parse("repose.txt", repose, "t", &names(&["a"])).unwrap();
        let (runs, incomplete) = stack.ensemble(&[tx, repose]).unwrap();
        assert_eq!(runs.samples, ["a"]);
        assert_eq!(runs.curves(0), [vec![1.0, 2.0, 3.0], vec![5.0, 6.0, 7.0], vec![29.0]]);
        let lacks =
            |test: &str, sample: &str| Incomplete { test: test.to_owned(), samples: names(&[sample]) };
        assert_eq!(incomplete, [lacks("tx", "c"), lacks("repose", "b")]);
        runs.check_steps(&stack.observations).unwrap();
        assert_eq!(runs.part(&[0], 0..2).curves(0), [vec![1.0, 2.0], vec![5.0, 6.0], vec![29.0]]);
    }

    #[test]
    fn a_test_is_told_in_one_word() {
        let test: TestTables = "tx100:tx100.txt:e_a:q,e_v:q=2e3,e_v=3e-4:0:40".parse().unwrap();
        assert_eq!((test.name.as_str(), test.control.as_str()), ("tx100", "e_a"));
        assert_eq!((test.noise.get("e_v"), test.steps), (Some(3e-4), Steps { from: 0, to: 40 }));
        let test: TestTables = "o:o.txt:e:s".parse().unwrap();
        assert!(test.noise.is_empty() && test.steps == Steps::ALL);
        for wrong in
            ["tx100:tx100.txt:e_a", "t x:o.txt:e:s", ":o.txt:e:s", "o::e:s", "o:o.txt:e:,", "o:o:e:s:x"]
        {
            assert!(wrong.parse::<TestTables>().is_err(), "{wrong}");
        }
    }
}

//! The worlds that cases are drawn from, and what is called known about them beforehand.

use anyhow::{Context, Result, ensure};
use gl_gap::attribute::problem::test::Test;
use gl_inference::design::{self, Effects};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::prior::{Effect, Parameter, Prior, Scale};
use gl_inference::samples::{Samples, sample_names};
use gl_numeric::sequence::Method;
use gl_world::{self as world, Input, Triaxial, World};
use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::condition::Condition;
use super::specimen::{factor, scattered};

/// An embedded world with a prior.
pub struct Bench {
    /// Its name here.
    pub name: &'static str,
    /// The simulator.
    pub world: Box<dyn World>,
    /// Every parameter, with every effect.
    pub prior: Prior,
    /// Effects that belong to the rig, and are no effects of the simulation where those of the
    /// measurement are candidates.
    pub of_the_rig: &'static [&'static str],
    /// Names of the tests, each of as many observables; one without a name where there is one.
    tests: &'static [&'static str],
    /// Whether effects of the measurement are candidates in some cases.
    pub has_rig: bool,
    /// How many of the observables are measured.
    observables: usize,
    /// Steps of the world's path that are.
    steps: Vec<usize>,
}

/// Candidates that change nothing are called so, and a number.
const IDLE: &str = "idle";

/// Names of the benches.
pub const NAMES: [&str; 4] = ["contact", "triaxial", "triaxial-one", "triaxial-three"];

/// name, lower, upper, scale, effect (absent at 0)
type Row = (&'static str, f64, f64, Scale, Option<&'static str>);

const CONTACT: [Row; 8] = [
    ("E_m", 9.1, 9.5, Scale::Linear, None),
    ("nu", 0.1, 0.4, Scale::Linear, None),
    ("mu", 0.1, 0.5, Scale::Linear, None),
    ("w", 1.0, 30.0, Scale::Linear, Some("adhesion")),
    ("tau", 5e-4, 5e-3, Scale::Linear, Some("damping")),
    ("plastic", 0.02, 0.3, Scale::Linear, Some("plasticity")),
    ("compliance", 1e-7, 2e-6, Scale::Linear, Some("compliance")),
    ("offset", -0.1, 0.1, Scale::Linear, Some("offset")),
];

const TRIAXIAL: [Row; 9] = [
    ("G0", 60.0, 250.0, Scale::Log, None),
    ("phi_c", 28.0, 35.0, Scale::Linear, None),
    ("d0", 0.5, 1.4, Scale::Linear, None),
    ("h", 0.4, 1.2, Scale::Linear, None),
    ("membrane", 0.2, 5.0, Scale::Linear, Some("membrane")),
    ("bedding", 5e-4, 1e-2, Scale::Linear, Some("bedding")),
    ("c", 1.0, 30.0, Scale::Linear, Some("cohesion")),
    ("de", -0.1, 0.1, Scale::Linear, Some("density")),
    ("piston", 1.0, 30.0, Scale::Linear, Some("piston")),
];

impl Bench {
    /// A bench by name.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn named(name: &str) -> Result<Self> {
        type Known = (&'static str, Box<dyn World>, &'static [Row], &'static [&'static str]);
        let world = |name: &str| world::named(name).context("no such world");
        let (name, world, rows, of_the_rig): Known = match name {
            "contact" => ("contact", world("contact-cycles")?, &CONTACT, &["compliance", "offset"]),
            "triaxial" => ("triaxial", world("triaxial")?, &TRIAXIAL, &["piston"]),
            "triaxial-one" => ("triaxial-one", world("triaxial")?, &TRIAXIAL, &[]),
            "triaxial-three" => ("triaxial-three", Box::new(CellPressures::new()), &TRIAXIAL, &[]),
            _ => anyhow::bail!("no world {name}; they are {}", NAMES.join(", ")),
        };
        let parameter = |&(name, lower, upper, scale, effect): &Row| Parameter {
            name: name.to_owned(),
            lower,
            upper,
            scale,
            normal: None,
            effect: effect.map(str::to_owned),
            off: effect.map(|_| 0.0),
            unit: None,
        };
        let prior = Prior::new(rows.iter().map(parameter).collect());
        let (observables, steps) = (world.observables().len(), (0..world.path().len()).collect());
        let tests: &[&str] = if name == "triaxial-three" { &CELLS } else { &[""] };
        Ok(Self {
            name,
            world,
            prior,
            tests,
            has_rig: !of_the_rig.is_empty(),
            of_the_rig,
            observables,
            steps,
        })
    }

    /// A bench by name, for cases of a condition.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn under(name: &str, condition: Condition) -> Result<Self> {
        let mut bench = Self::named(name)?;
        match condition {
            Condition::Idle => {
                let mut parameters = bench.prior.parameters().to_vec();
                parameters.extend((1..=5).map(|number| Parameter {
                    name: format!("{IDLE}{number}"),
                    lower: 1.0,
                    upper: 2.0,
                    scale: Scale::Linear,
                    normal: None,
                    effect: Some(format!("{IDLE}{number}")),
                    off: Some(0.0),
                    unit: None,
                }));
                bench.prior = Prior::new(parameters);
            }
            Condition::OneObservable => {
                ensure!(bench.tests.len() == 1, "one observable of {name} would be that of one test");
                bench.observables = 1;
            }
            Condition::TenSteps => bench.steps = thinned(&bench.world.path(), 10),
            _ => {}
        }
        Ok(bench)
    }

    /// Effects that change something.
    pub fn effects(&self) -> Vec<Effect> {
        let mut effects = self.prior.effects();
        effects.retain(|effect| !effect.name.starts_with(IDLE));
        effects
    }

    /// Names of the observables that are measured.
    pub fn observables(&self) -> Vec<String> {
        self.world.observables()[..self.observables].iter().map(|&name| name.to_owned()).collect()
    }

    /// The control at the steps that are measured.
    pub fn path(&self) -> Vec<f64> {
        let path = self.world.path();
        self.steps.iter().map(|&step| path[step]).collect()
    }

    /// The tests, whose observables stand behind each other.
    pub fn tests(&self) -> Vec<Test> {
        let (path, each) = (self.path(), self.observables / self.tests.len());
        let mut tests: Vec<Test> = Vec::new();
        for name in self.tests {
            tests.push(Test::new(name, (self.world.control(), &path), each, tests.last()));
        }
        tests
    }

    /// The curves of other specimens, one in each test, shape (observables, steps).
    pub fn scattered(
        &self,
        curves: &[Vec<f64>],
        factor: &DMatrix<f64>,
        random: &mut ChaCha8Rng,
    ) -> Vec<Vec<f64>> {
        let tests = curves.chunks_exact(self.observables / self.tests.len());
        tests.flat_map(|curves| scattered(curves, factor, random)).collect()
    }

    /// The prior without some effects.
    pub fn prior_without(&self, effects: &[&str]) -> Prior {
        let is_known =
            |parameter: &&Parameter| !parameter.effect.as_deref().is_some_and(|own| effects.contains(&own));
        Prior::new(self.prior.parameters().iter().filter(is_known).cloned().collect())
    }

    /// Values of all parameters from those of a prior that lacks some effects: these are off.
    pub fn with_rest_off(&self, prior: &Prior, values: &[f64]) -> Vec<f64> {
        let known = |name: &str| prior.parameters().iter().position(|other| other.name == name);
        let value = |parameter: &Parameter| {
            known(&parameter.name).map_or(parameter.off.unwrap_or(0.0), |place| values[place])
        };
        self.prior.parameters().iter().map(value).collect()
    }

    /// The curves at values of all parameters of the prior, shape (observables, steps).
    ///
    /// # Errors
    /// If the world refuses them.
    pub fn simulate(&self, values: &[f64]) -> Result<Vec<Vec<f64>>> {
        let mut inputs: Vec<f64> = self.world.inputs().iter().map(|input| input.default).collect();
        for (parameter, &value) in self.prior.parameters().iter().zip(values) {
            if parameter.name.starts_with(IDLE) {
                continue;
            }
            let place = self.world.inputs().iter().position(|input| input.name == parameter.name);
            inputs[place.context("a parameter that the world does not know")?] = value;
        }
        let curves = world::simulate(self.world.as_ref(), &inputs)?.values;
        let kept = |curve: &Vec<f64>| self.steps.iter().map(|&step| curve[step]).collect();
        Ok(curves[..self.observables].iter().map(kept).collect())
    }

    /// A measurement that holds these values.
    pub fn observations(&self, source: &str, values: Vec<Vec<f64>>) -> Observations {
        Observations {
            source: source.to_owned(),
            control_name: self.world.control().to_owned(),
            control: self.path(),
            names: self.observables(),
            far_off: Vec::new(),
            sd: vec![None; values.len()],
            values,
        }
    }

    /// The switch design without some effects, as many runs an input, and its ensemble. With `scatter`
    /// every run is of another specimen.
    ///
    /// # Errors
    /// If every run fails.
    pub fn design(
        &self,
        without: &[&str],
        scatter: bool,
        runs_an_input: usize,
        seed: u64,
    ) -> Result<(Samples, Ensemble)> {
        let prior = self.prior_without(without);
        let count = runs_an_input * prior.parameters().len();
        let values = design::draw(&prior, &Effects::Pairs, Method::Halton, count, seed, true)?;
        let design = self.run(&prior, values, scatter, 0, seed)?;
        ensure!(!design.1.is_empty(), "an empty design, or one of which every run fails");
        Ok(design)
    }

    /// Run samples of a prior, which may lack some effects: an iteration of a design. With `scatter` every
    /// run is of another specimen. What the world refuses, beyond its bounds, has no run.
    ///
    /// # Errors
    /// If the iteration is none.
    pub fn run(
        &self,
        prior: &Prior,
        values: Vec<Vec<f64>>,
        scatter: bool,
        iteration: usize,
        seed: u64,
    ) -> Result<(Samples, Ensemble)> {
        let factor = factor(&self.path());
        let curves = values
            .par_iter()
            .enumerate()
            .map(|(run, values)| {
                let curves = self.simulate(&self.with_rest_off(prior, values)).ok()?;
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                random.set_stream(run as u64);
                Some(if scatter { self.scattered(&curves, &factor, &mut random) } else { curves })
            })
            .collect::<Vec<Option<_>>>();
        let names = sample_names(self.name, iteration, values.len())?;
        let empty = self.observations("design", vec![vec![0.0; self.steps.len()]; self.observables]);
        let mut ensemble = Ensemble::new(&empty, false);
        for (name, curves) in names.iter().zip(&curves) {
            if let Some(curves) = curves {
                ensemble.push(name, curves, None);
            }
        }
        Ok((Samples { source: "samples".to_owned(), names, parameters: prior.names(), values }, ensemble))
    }
}

/// Names of the tests at three cell pressures, in kPa.
const CELLS: [&str; 3] = ["tx50", "tx100", "tx200"];

/// Triaxial tests of one sand at three cell pressures.
struct CellPressures([Triaxial; 3]);

impl CellPressures {
    fn new() -> Self {
        Self([50.0, 100.0, 200.0].map(|cell| Triaxial { cell, ..Triaxial::default() }))
    }
}

impl World for CellPressures {
    fn inputs(&self) -> &'static [Input] {
        self.0[0].inputs()
    }

    fn control(&self) -> &'static str {
        self.0[0].control()
    }

    fn observables(&self) -> &'static [&'static str] {
        &["tx50.q", "tx50.e_v", "tx100.q", "tx100.e_v", "tx200.q", "tx200.e_v"]
    }

    fn path(&self) -> Vec<f64> {
        self.0[0].path()
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }

    fn observe(&self, inputs: &[f64]) -> Result<Vec<Vec<f64>>> {
        let curves = self.0.iter().map(|test| test.observe(inputs)).collect::<Result<Vec<_>>>()?;
        Ok(curves.concat())
    }
}

/// Steps of a path, evenly apart between its turning points, which are among them: about `count`.
fn thinned(path: &[f64], count: usize) -> Vec<usize> {
    let last = path.len() - 1;
    let turns = |step: &usize| {
        let step = *step;
        step == 0 || step == last || (path[step + 1] - path[step]) * (path[step] - path[step - 1]) <= 0.0
    };
    let ends: Vec<usize> = (0..=last).filter(turns).collect();
    let mut steps: Vec<usize> = Vec::new();
    for pair in ends.windows(2) {
        let length = pair[1] - pair[0];
        let parts = ((count - 1) * length).div_ceil(last).max(1);
        steps.extend((0..parts).map(|part| pair[0] + part * length / parts));
    }
    steps.push(last);
    steps.dedup();
    steps
}

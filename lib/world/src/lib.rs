//! Embedded simulators: small worlds of known physics, for a first calibration without any other
//! program, and for checks of the diagnosis against an answer that is known.
//!
//! A world is one file: its parameters, what it imposes, what it observes, and the curve at given
//! parameters. Parameters that belong to an effect are absent at their default.

mod batch;
mod contact;
mod triaxial;

use anyhow::{Result, ensure};
use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

pub use batch::{Report, run_samples, write_curve, write_inputs};
pub use contact::{Contact, Step};
pub use triaxial::Triaxial;

use gl_inference::observations::ByName;
use gl_inference::prior::normal_quantile;

/// A parameter that a world understands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Input {
    /// Name of the column that holds it.
    pub name: &'static str,
    /// Its value where a table does not give it; for an effect's parameter the effect is then absent.
    pub default: f64,
    /// Smallest and largest value that mean something.
    pub range: (f64, f64),
    /// Unit; `-` for a pure number.
    pub unit: &'static str,
    /// The effect that it belongs to; absent for the base model.
    pub effect: Option<&'static str>,
    /// What it is.
    pub meaning: &'static str,
}

const fn input(
    name: &'static str,
    default: f64,
    range: (f64, f64),
    unit: &'static str,
    effect: Option<&'static str>,
    meaning: &'static str,
) -> Input {
    Input { name, default, range, unit, effect, meaning }
}

/// What a run gives: observables at the steps of the control.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// Control values, shape (steps,).
    pub control: Vec<f64>,
    /// Simulated values, shape (observables, steps).
    pub values: Vec<Vec<f64>>,
}

/// A simulator of known physics.
pub trait World: Sync {
    /// Its parameters, in the order that [`simulate`] takes them.
    fn inputs(&self) -> &'static [Input];

    /// Name of the control column.
    fn control(&self) -> &'static str;

    /// Names of the observables.
    fn observables(&self) -> &'static [&'static str];

    /// Control values that it imposes, shape (steps,).
    fn path(&self) -> Vec<f64>;

    /// What else a run depends on, by name: sizes and rates, which no sample varies.
    fn settings(&self) -> Vec<(&'static str, f64)>;

    /// The observables along the path at parameters in the order of [`World::inputs`], shape
    /// (observables, steps). They lie in their ranges: [`simulate`] has checked them.
    ///
    /// # Errors
    /// If the parameters together make no sense.
    fn observe(&self, inputs: &[f64]) -> Result<Vec<Vec<f64>>>;
}

/// A world by name, in its default settings, if there is one: one of [`NAMES`].
pub fn named(name: &str) -> Option<Box<dyn World>> {
    match name {
        "contact" => Some(Box::new(Contact::default())),
        "contact-cycles" => {
            let path = Step::cycles(Contact::OVERLAP, Contact::STEPS, Contact::SPEED, Contact::FAST);
            Some(Box::new(Contact { path, ..Contact::default() }))
        }
        "triaxial" => Some(Box::new(Triaxial::default())),
        _ => None,
    }
}

/// Names of the worlds; see [`named`].
pub const NAMES: [&str; 3] = ["contact", "contact-cycles", "triaxial"];

/// Run a world at parameters in the order of [`World::inputs`].
///
/// # Errors
/// If a parameter is missing or outside its range, or the result is not finite.
pub fn simulate(world: &dyn World, inputs: &[f64]) -> Result<Curves> {
    ensure!(
        inputs.len() == world.inputs().len(),
        "{} parameters where the world has {}",
        inputs.len(),
        world.inputs().len()
    );
    for (input, value) in world.inputs().iter().zip(inputs) {
        let (low, high) = input.range;
        ensure!(
            (low..=high).contains(value),
            "{} = {value}, but it makes sense from {low} to {high} only",
            input.name
        );
    }
    let curves = Curves { control: world.path(), values: world.observe(inputs)? };
    let finite = curves.values.iter().flatten().all(|value| value.is_finite());
    ensure!(finite, "the result is not finite");
    Ok(curves)
}

/// The parameters of a world, in the order of [`World::inputs`]: those given by name, and the
/// defaults of the others.
///
/// # Errors
/// If the world does not know a name.
pub fn inputs(world: &dyn World, given: &ByName) -> Result<Vec<f64>> {
    let names: Vec<String> = given.names().map(str::to_owned).collect();
    let places = places(world, &names)?;
    let mut inputs: Vec<f64> = world.inputs().iter().map(|input| input.default).collect();
    for (place, (_, value)) in places.into_iter().zip(given.iter()) {
        inputs[place] = value;
    }
    Ok(inputs)
}

/// Position of each named parameter in [`World::inputs`].
fn places(world: &dyn World, names: &[String]) -> Result<Vec<usize>> {
    let known: Vec<&str> = world.inputs().iter().map(|input| input.name).collect();
    let place = |name: &String| known.iter().position(|other| other == name);
    let unknown: Vec<&str> = names.iter().filter(|name| place(name).is_none()).map(String::as_str).collect();
    ensure!(
        unknown.is_empty(),
        "unknown parameter {}; the parameters are {}",
        unknown.join(", "),
        known.join(", ")
    );
    Ok(names.iter().filter_map(place).collect())
}

fn check_positive(name: &str, value: f64) -> Result<()> {
    ensure!(value > 0.0 && value.is_finite(), "{name} {value}: must be positive and finite");
    Ok(())
}

/// Add normal noise to every value.
///
/// * `sd` — standard deviation of each reading, in the shape of `values`; a share of the value
///   makes the noise multiplicative.
pub fn add_noise(values: &mut [Vec<f64>], sd: &[Vec<f64>], seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for (value, sd) in values.iter_mut().flatten().zip(sd.iter().flatten()) {
        // The middle of one of 2⁵³ equal parts: neither 0 nor 1, where the quantile is infinite.
        let u = ((rng.random::<u64>() >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
        *value += sd * normal_quantile(u);
    }
}

//! The loop on one problem, and what came of it.

use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_emulator::posterior::{Inference, Options, Question, infer};
use gl_inference::design::{Effects, batch_runs, draw, first_runs};
use gl_inference::samples::{Samples, sample_names};
use gl_inference::stop::{Criterion, Previous, Tolerances, criteria};
use gl_numeric::sequence::Method;
use gl_numeric::statistics::{Quantiles, mean, sd};
use gl_table::TableWriter;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::problem::Problem;
use super::reference;

/// How one replicate came out.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Runs when it stopped, or when it was stopped.
    pub runs: usize,
    /// Whether it stopped by itself.
    pub is_settled: bool,
    /// Whether it gave up on an emulator.
    pub is_unfit: bool,
    /// By parameter: whether the 90 % interval holds the truth.
    pub holds: Vec<bool>,
    /// The same of the true posterior's interval: what is short there is chance.
    pub holds_exact: Vec<bool>,
    /// Its standard deviation over the true posterior's.
    pub ratio: Vec<f64>,
    /// Its mean less the true one, in true standard deviations.
    pub shift: Vec<f64>,
    /// Mass of the lesser mode by the first parameter, here and by the true posterior.
    pub lesser: (f64, f64),
    /// Whether the noise was said to be correlated.
    pub is_correlated: bool,
    /// Whether it was counted larger than stated.
    pub is_inflated: bool,
    /// What was last asked, and the answers.
    pub last: String,
}

/// Runs at the most.
pub fn most_runs(parameters: usize) -> usize {
    (60 * parameters).clamp(150, 300)
}

/// One replicate.
///
/// # Errors
/// If a step fails.
pub fn replicate(problem: &Problem, seed: u64, is_verbose: bool) -> Result<Outcome> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let prior = problem.prior()?;
    let truth: Vec<f64> = (0..problem.parameters).map(|_| generator.random()).collect();
    let observations = problem.measure(&truth, &mut generator);
    let exact = reference::posterior(problem, &observations, seed)?;
    let told = problem.told();

    let mut samples = Samples { source: "samples".into(), parameters: prior.names(), ..Samples::default() };
    let mut ensemble = problem.ensemble(&observations);
    let d = problem.parameters;
    let mut next = draw(&prior, &Effects::None, Method::Sobol, first_runs(d), seed, true)?;
    let (mut before, mut newest) = (Previous::First, Vec::new());
    for iteration in 0.. {
        let names = sample_names("run", iteration, next.len())?;
        for (name, values) in names.iter().zip(next) {
            ensemble.push(name, &problem.run(&values, &mut generator), None);
            samples.values.push(values);
        }
        samples.names.extend(names.iter().cloned());
        if iteration > 0 {
            newest = names;
        }
        let question = Question {
            prior: &prior,
            samples: &samples,
            ensemble: &ensemble,
            observations: &observations,
            noise: told.as_deref(),
            scale: None,
            steps: 0..problem.steps,
            newest: &newest,
        };
        let inference = infer(
            &question,
            Options { scatter: problem.scatter_told(), seed: seed + iteration as u64, ..Options::default() },
        )?;
        let summary = inference.summary(&samples)?;
        let asked = criteria(&summary, &Tolerances::default(), None, &before)?;
        let is_settled = asked.iter().any(|criterion| criterion.is_met && !criterion.is_part);
        if is_verbose {
            eprintln!("{} {seed} {} runs: {}", problem.name, samples.len(), said(&inference, &asked, &exact));
        }
        if is_settled || inference.is_unfit() || samples.len() >= most_runs(d) {
            let last = said(&inference, &asked, &exact);
            return Ok(outcome(&inference, &exact, &truth, samples.len(), is_settled, last));
        }
        before = Previous::Iteration(Box::new(summary));
        next = inference.next_runs(batch_runs(d), seed + 1000 + iteration as u64)?;
    }
    unreachable!("the loop ends by its number of runs")
}

/// Write a replicate's measurement and its true posterior: `PATH-obs.txt` and `PATH-exact.txt`.
///
/// # Errors
/// If the posterior cannot be sampled, or a file not written.
pub fn export(problem: &Problem, seed: u64, path: &Path) -> Result<()> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let truth: Vec<f64> = (0..problem.parameters).map(|_| generator.random()).collect();
    let observations = problem.measure(&truth, &mut generator);
    let exact = reference::posterior(problem, &observations, seed)?;
    let file = |what: &str| PathBuf::from(format!("{}-{what}.txt", path.display()));
    let mut columns = vec!["u"];
    columns.extend(observations.names.iter().map(String::as_str));
    let mut table = TableWriter::create(Some(&file("obs")), &columns)?;
    for (step, u) in observations.control.iter().enumerate() {
        table.number(*u);
        observations.values.iter().for_each(|values| {
            table.number(values[step]);
        });
        table.end_row()?;
    }
    table.finish()?;
    let mut table = TableWriter::create(Some(&file("exact")), &["parameter", "truth", "mean", "sd"])?;
    for (j, truth) in truth.iter().enumerate() {
        let (mean, sd) = moments(&exact, j);
        table.text(&format!("p{j}")).numbers(&[*truth, mean, sd]).end_row()?;
    }
    table.finish()
}

/// How far the true posterior is from itself by another seed: the largest shift of a mean in standard
/// deviations, the smallest and the largest ratio of standard deviations.
///
/// # Errors
/// If a posterior cannot be sampled.
pub fn repeated(problem: &Problem, seed: u64) -> Result<(f64, f64, f64)> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let truth: Vec<f64> = (0..problem.parameters).map(|_| generator.random()).collect();
    let observations = problem.measure(&truth, &mut generator);
    let one = reference::posterior(problem, &observations, seed)?;
    let other = reference::posterior(problem, &observations, seed + 1)?;
    let (mut shift, mut least, mut most) = (0.0_f64, f64::INFINITY, 0.0_f64);
    for j in 0..problem.parameters {
        let ((a, s), (b, t)) = (moments(&one, j), moments(&other, j));
        shift = shift.max((a - b).abs() / s);
        (least, most) = (least.min(t / s), most.max(t / s));
    }
    Ok((shift, least, most))
}

/// Mean and standard deviation of a coordinate.
fn moments(points: &[Vec<f64>], j: usize) -> (f64, f64) {
    let column: Vec<f64> = points.iter().map(|x| x[j]).collect();
    let weights = vec![1.0 / column.len() as f64; column.len()];
    (mean(&column, &weights), sd(&column, &weights))
}

fn said(inference: &Inference, asked: &[Criterion], exact: &[Vec<f64>]) -> String {
    let criteria: Vec<String> = asked
        .iter()
        .map(|c| format!("{}={:.2}{}", c.name, c.value, if c.is_met { "" } else { "!" }))
        .collect();
    let s = &inference.surrogate;
    let ratios: Vec<String> =
        compare(inference, exact).iter().map(|(ratio, shift)| format!("{ratio:.2}/{shift:+.2}")).collect();
    format!(
        "{}{} white={:.2} known={:.2},{:.2} rmse={:.3} cal={:.1} kurt={:.1} {:?}{} chi={:?} phi={:?} F={:.2} infl={} err={:.3} | {}",
        criteria.join(" "),
        if inference.is_unfit() { " UNFIT" } else { "" },
        s.scatter.white.iter().sum::<f64>() / s.scatter.white.len() as f64,
        inference.shift_if_known,
        inference.ratio_if_known,
        s.rmse,
        s.calibration,
        s.kurtosis,
        s.recipe.kernel,
        if s.recipe.is_local { " local" } else { "" },
        inference.chi_square.map(|c| (c.p * 1e3).round() / 1e3),
        inference.nuisances.correlation,
        inference.noise.iter().map(|n| n.scatter).sum::<f64>() / inference.noise.len() as f64,
        inference.nuisances.inflation,
        inference.proof.map_or(0.0, |p| p.error),
        ratios.join(" ")
    )
}

/// Ratio of standard deviations and shift of means, by parameter.
fn compare(inference: &Inference, exact: &[Vec<f64>]) -> Vec<(f64, f64)> {
    (0..inference.space.len())
        .map(|j| {
            let ((here, spread), (there, true_spread)) = (moments(&inference.points, j), moments(exact, j));
            (spread / true_spread, (here - there) / true_spread)
        })
        .collect()
}

fn outcome(
    inference: &Inference,
    exact: &[Vec<f64>],
    truth: &[f64],
    runs: usize,
    is_settled: bool,
    last: String,
) -> Outcome {
    let compared = compare(inference, exact);
    let holds = |points: &[Vec<f64>]| -> Vec<bool> {
        let of = |(j, truth): (usize, &f64)| {
            let column: Vec<f64> = points.iter().map(|x| x[j]).collect();
            let quantiles = Quantiles::new(&column, &vec![1.0 / column.len() as f64; column.len()]);
            (quantiles.at(0.05)..=quantiles.at(0.95)).contains(truth)
        };
        truth.iter().enumerate().map(of).collect()
    };
    let share =
        |points: &[Vec<f64>]| points.iter().filter(|x| x[0] > 0.5).count() as f64 / points.len() as f64;
    let (here, there) = (share(&inference.values), share(exact));
    let lesser = if there > 0.5 { (1.0 - here, 1.0 - there) } else { (here, there) };
    Outcome {
        runs,
        is_settled,
        is_unfit: inference.is_unfit(),
        holds: holds(&inference.values),
        holds_exact: holds(exact),
        ratio: compared.iter().map(|c| c.0).collect(),
        shift: compared.iter().map(|c| c.1).collect(),
        lesser,
        is_correlated: inference.nuisances.correlation.iter().any(|is| *is),
        is_inflated: inference.nuisances.inflation,
        last,
    }
}

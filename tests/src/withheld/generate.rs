//! Draw cases by seed: measurements for the diagnosis, and answers for the scorer.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use gl::prior::normal_quantile;
use gl::table::TableWriter;
use rand::seq::index::sample;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::bench::Bench;
use super::fit::fit;

/// Noise as a share of each observable's range: one of these a case.
const NOISES: [f64; 4] = [0.005, 0.01, 0.02, 0.04];

/// A measurement and what is behind it.
struct Case {
    noisy: Vec<Vec<f64>>,
    noise: Vec<f64>,
    /// Effects that are in, in the order of the prior.
    effects: Vec<String>,
    /// The one of them that is no candidate.
    withheld: Option<String>,
    /// What the base parameters cannot absorb, in noise.
    visibility: f64,
    /// The least that the base and all other effects but one cannot absorb, in noise.
    least: f64,
    /// What recalibrating the world with its true effects closes.
    shrink: f64,
    values: Vec<f64>,
}

/// Write `count` cases of a world into `DIR/cases`, and the answers to `DIR/sealed/answers.tsv`.
///
/// # Errors
/// If a file cannot be written.
pub fn generate(bench: &Bench, count: usize, seed: u64, dir: &Path) -> Result<()> {
    let (cases, sealed) = (dir.join("cases"), dir.join("sealed"));
    for folder in [&cases, &sealed] {
        fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    let drawn: Vec<Case> =
        (0..count).into_par_iter().map(|i| draw(bench, seed, i as u64)).collect::<Result<_>>()?;
    let columns = ["case", "effects", "withheld", "visibility", "least", "shrink", "noise", "values"];
    let mut answers = TableWriter::create(Some(&sealed.join("answers.tsv")), &columns)?;
    // What is no candidate is missing from the user's table of parameters, and that is all one sees.
    let mut list = TableWriter::create(Some(&cases.join("cases.tsv")), &["case", "without"])?;
    for (i, case) in drawn.iter().enumerate() {
        let name = format!("case{i:04}");
        let values: Vec<String> = case.values.iter().map(f64::to_string).collect();
        let effects = if case.effects.is_empty() { "none".to_owned() } else { case.effects.join("+") };
        answers.text(&name).text(&effects).text(case.withheld.as_deref().unwrap_or("-"));
        answers.numbers(&[case.visibility, case.least, case.shrink, case.noise[0]]);
        answers.text(&values.join(",")).end_row()?;
        list.text(&name).text(case.withheld.as_deref().unwrap_or("-")).end_row()?;
        let mut columns = vec![bench.world.control().to_owned()];
        columns.extend(bench.world.observables().iter().map(|name| (*name).to_owned()));
        columns.extend(bench.world.observables().iter().map(|name| format!("{name}_sd")));
        let mut obs = TableWriter::create(Some(&cases.join(format!("{name}_obs.txt"))), &columns)?;
        for (t, control) in bench.world.path().iter().enumerate() {
            obs.number(*control);
            for curve in &case.noisy {
                obs.number(curve[t]);
            }
            obs.numbers(&case.noise).end_row()?;
        }
        obs.finish()?;
    }
    list.finish()?;
    answers.finish()
}

fn draw(bench: &Bench, seed: u64, stream: u64) -> Result<Case> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream + 1);
    let parameters = bench.prior.parameters();
    let effects = bench.prior.effects();
    // Ten kinds in turn: 2 none, 4 one, 2 two, 2 one that is no candidate.
    let (count, is_withheld) = match stream % 10 {
        0 | 5 => (0, false),
        2 | 7 => (2, false),
        4 | 9 => (1, true),
        _ => (1, false),
    };
    let mut chosen = sample(&mut random, effects.len(), count).into_vec();
    chosen.sort_unstable();
    let mut values: Vec<f64> = parameters.iter().map(|p| p.off.unwrap_or(p.lower)).collect();
    let on = chosen.iter().flat_map(|&e| effects[e].parameters.clone());
    for j in bench.prior.base().into_iter().chain(on) {
        values[j] = parameters[j].quantile(random.random());
    }
    let truth = bench.simulate(&values)?;
    let share = NOISES[random.random_range(0..NOISES.len())];
    let noise: Vec<f64> = truth.iter().map(|curve| share * gl::observations::range(curve)).collect();
    let mut noisy = truth.clone();
    for (curve, sd) in noisy.iter_mut().zip(&noise) {
        for y in curve {
            *y += sd * normal_quantile(random.random_range(1e-12..1.0));
        }
    }
    let without = |left_out: &[usize]| {
        let mut start = values.clone();
        let mut free = bench.prior.base();
        for &e in &chosen {
            for &j in &effects[e].parameters {
                if left_out.contains(&e) {
                    start[j] = parameters[j].off.unwrap_or(0.0);
                } else {
                    free.push(j);
                }
            }
        }
        (start, free)
    };
    let visibility = |left_out: &[usize]| -> Result<f64> {
        let (start, free) = without(left_out);
        Ok(fit(bench, &start, &free, &truth, &noise)?.rms)
    };
    let (start, free) = without(&chosen);
    let before = fit(bench, &start, &free, &noisy, &noise)?;
    let after = fit(bench, &values, &without(&[]).1, &noisy, &noise)?;
    let gap = |curves: &[Vec<f64>]| {
        let mut sum = 0.0;
        for (curve, seen) in curves.iter().zip(&noisy) {
            let range = gl::observations::range(seen);
            sum += curve.iter().zip(seen).map(|(y, o)| ((o - y) / range).powi(2)).sum::<f64>();
        }
        sum / (noisy.len() * noisy[0].len()) as f64
    };
    let floor =
        noisy.iter().zip(&noise).map(|(seen, sd)| (sd / gl::observations::range(seen)).powi(2)).sum::<f64>()
            / noisy.len() as f64;
    let above = |curves: &[Vec<f64>]| (gap(curves) - floor).max(0.0);
    let shrink =
        if above(&before.curves) > 0.0 { 1.0 - above(&after.curves) / above(&before.curves) } else { 0.0 };
    let seen = visibility(&chosen)?;
    let least = chosen.iter().map(|&e| visibility(&[e])).collect::<Result<Vec<_>>>()?;
    Ok(Case {
        noisy,
        noise,
        effects: chosen.iter().map(|&e| effects[e].name.clone()).collect(),
        withheld: is_withheld.then(|| effects[chosen[0]].name.clone()),
        visibility: seen,
        least: least.into_iter().fold(f64::INFINITY, f64::min).min(1e9),
        shrink,
        values,
    })
}

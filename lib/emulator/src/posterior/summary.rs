//! What a posterior through an emulator says: in numbers, in conclusions, and by the weights of real runs.

use anyhow::Result;
use gl_inference::fit::{alternation, said};
use gl_inference::prior::Parameter;
use gl_inference::samples::Samples;
use gl_inference::stop::leaning_verdicts;
use gl_inference::summary::{ParameterSummary, Summary, leaning};
use gl_inference::weights::Weights;
use gl_numeric::statistics::{Quantiles, effective_size, mean, sd};
use gl_table::verdict::Verdicts;
use rayon::prelude::*;

use super::noise::ChiSquare;
use super::{Inference, Options};

/// ln likelihoods that are this uncertain change the posterior.
const IGNORANT: f64 = 1.0;

impl Inference {
    /// The draws as a weights table: equal weights, named `draw0`, `draw1`, ….
    pub fn weights(&self) -> Weights {
        let n = self.points.len();
        let width = n.saturating_sub(1).to_string().len();
        Weights {
            source: "draws".to_owned(),
            samples: (0..n).map(|i| format!("draw{i:0width$}")).collect(),
            parameters: self.space.prior().names(),
            values: self.values.clone(),
            misfit: Some(self.misfit.clone()),
            error: Some(self.error.clone()),
            weight: vec![1.0 / n as f64; n],
        }
    }

    /// The real runs with the share of the posterior that each stands for: that of the draws which lie
    /// nearer to it than to any other run, in standard deviations of the posterior; less where the run fits
    /// worse than these draws do.
    ///
    /// # Errors
    /// If a sample lacks a parameter.
    pub fn weights_of_runs(&self, samples: &Samples) -> Result<Weights> {
        let d = self.space.len();
        let even = vec![1.0 / self.points.len() as f64; self.points.len()];
        let spread: Vec<f64> = (0..d)
            .map(|j| sd(&self.points.iter().map(|x| x[j]).collect::<Vec<_>>(), &even).max(1e-12))
            .collect();
        let nearest = |x: &Vec<f64>| {
            let distance = |place: &Vec<f64>| -> f64 {
                place.iter().zip(x).zip(&spread).map(|((a, b), sd)| ((a - b) / sd).powi(2)).sum()
            };
            let mut best = (f64::INFINITY, 0);
            for (run, place) in self.places.iter().enumerate() {
                let distance = distance(place);
                if distance < best.0 {
                    best = (distance, run);
                }
            }
            best.1
        };
        let owners: Vec<usize> = self.points.par_iter().map(nearest).collect();
        let (mut count, mut fitted) = (vec![0.0; self.runs.len()], vec![0.0; self.runs.len()]);
        for (&run, misfit) in owners.iter().zip(&self.misfit) {
            count[run] += 1.0;
            fitted[run] += misfit;
        }
        let readings = self.measured().values.len() as f64;
        let heat = self.variance() * readings / self.independent_readings.min(readings);
        let mut weight: Vec<f64> = (0..self.runs.len())
            .map(|run| {
                if count[run] == 0.0 {
                    return 0.0;
                }
                // The draws' misfits hold what the emulator does not know; no run may gain by that.
                let excess =
                    (self.runs[run].misfit / heat - fitted[run] / count[run] - readings.sqrt()).max(0.0);
                count[run] * (-0.5 * excess).exp()
            })
            .collect();
        let whole: f64 = weight.iter().sum();
        if whole > 0.0 {
            weight.iter_mut().for_each(|weight| *weight /= whole);
        } else {
            weight[0] = 1.0;
        }
        let values = samples.columns(&self.space.prior().names())?;
        let index = samples.index();
        Ok(Weights {
            source: "runs".to_owned(),
            samples: self.runs.iter().map(|run| run.name.clone()).collect(),
            parameters: self.space.prior().names(),
            values: self.runs.iter().map(|run| values[index[run.name.as_str()]].clone()).collect(),
            misfit: Some(self.runs.iter().map(|run| run.misfit).collect()),
            error: Some(self.runs.iter().map(|run| run.error).collect()),
            weight,
        })
    }

    /// Mean variance of the noise over that of its base.
    fn variance(&self) -> f64 {
        self.noise.iter().map(|noise| noise.variance).sum::<f64>() / self.noise.len() as f64
    }

    /// The quantities of a filter's summary, and what the emulator does not know.
    ///
    /// # Errors
    /// See [`Inference::weights_of_runs`].
    pub fn summary(&self, samples: &Samples) -> Result<Summary> {
        let n = self.points.len();
        let even = vec![1.0 / n as f64; n];
        let of_runs = self.weights_of_runs(samples)?;
        let ess_runs = effective_size(&of_runs.weight);
        let known = self.measured().is_known.then_some(self.measured().values.len() as f64);
        let mut summary = Summary {
            runs: Some(self.runs.len() as f64),
            failed: Some((samples.len() - self.runs.len()) as f64),
            // What the likelihood is tempered by as far as the emulator is in doubt.
            sigma: Some(self.variance() * (1.0 + self.ignorance * self.ignorance)),
            sigma_noise: Some(self.variance()),
            ess: Some(1.0),
            ess_runs: Some(ess_runs),
            ensemble_error: Some(mean(&self.error, &even)),
            best_sample: Some(self.runs[0].name.clone()),
            best_error: Some(self.runs[0].error),
            best_misfit: Some(self.runs[0].misfit),
            best_misfit_over_noise: known.map(|readings| self.runs[0].misfit / readings),
            ln_evidence: Some(self.ln_evidence),
            ..self.trust()
        };
        for (parameter, best) in self.parameters().into_iter().zip(&of_runs.values[0]) {
            summary.parameters.push(ParameterSummary { best: Some(*best), ..parameter });
        }
        Ok(summary)
    }

    /// The same quantities by the real runs alone, with the weights of [`Inference::weights_of_runs`].
    ///
    /// # Errors
    /// See [`Inference::weights_of_runs`].
    pub fn summary_of_runs(&self, samples: &Samples) -> Result<Summary> {
        let weights = self.weights_of_runs(samples)?;
        let ess_runs = effective_size(&weights.weight);
        let errors: Vec<f64> = self.runs.iter().map(|run| run.error).collect();
        let of = |(j, name): (usize, String)| {
            let column: Vec<f64> = weights.values.iter().map(|row| row[j]).collect();
            let quantiles = Quantiles::new(&column, &weights.weight);
            let (centre, spread) = (mean(&column, &weights.weight), sd(&column, &weights.weight));
            let parameter = &self.space.prior().parameters()[j];
            let is_varied = self.space.varied().contains(&j);
            ParameterSummary {
                name,
                mean: Some(centre),
                sd: Some(spread),
                q05: Some(quantiles.at(0.05)),
                q95: Some(quantiles.at(0.95)),
                best: Some(column[0]),
                shrinkage: is_varied.then(|| 1.0 - (spread / parameter.sd()).powi(2)),
                ..ParameterSummary::default()
            }
        };
        Ok(Summary {
            runs: Some(self.runs.len() as f64),
            failed: Some((samples.len() - self.runs.len()) as f64),
            sigma_noise: Some(self.variance()),
            ess: Some(ess_runs / self.runs.len() as f64),
            ess_runs: Some(ess_runs),
            ensemble_error: Some(mean(&errors, &weights.weight)),
            best_sample: Some(self.runs[0].name.clone()),
            best_error: Some(self.runs[0].error),
            best_misfit: Some(self.runs[0].misfit),
            parameters: self.space.prior().names().into_iter().enumerate().map(of).collect(),
            ..Summary::default()
        })
    }

    /// What the posterior rests on, and how far it can be trusted.
    fn trust(&self) -> Summary {
        let n = self.noise.len() as f64;
        let correlations = (0..self.observables.len()).map(|j| self.correlation_of(j));
        Summary {
            draws: Some(self.points.len() as f64),
            ignorance: Some(self.ignorance),
            known_sd: Some(self.ratio_if_known),
            rmse: Some(self.surrogate.rmse),
            calibration: Some(self.surrogate.calibration),
            scatter: Some(self.noise.iter().map(|noise| noise.scatter).sum::<f64>() / n),
            scatter_error: Some(self.scatter_error),
            inflation: Some(if self.nuisances.inflation { self.variance().sqrt() } else { 1.0 }),
            correlation: Some(correlations.fold(0.0, f64::max)),
            independent_readings: Some(self.independent_readings),
            alternation: self.left.alternation,
            chi_square: self.chi_square.map(|test| test.value),
            chi_square_degrees: self.chi_square.map(|test| test.degrees),
            chi_square_p: self.chi_square.map(|test| test.p),
            proof_runs: self.proof.map(|proof| proof.runs as f64),
            proof_z: self.proof.map(|proof| proof.z),
            proof_p: self.proof.map(|proof| proof.p),
            ..Summary::default()
        }
    }

    /// Mean correlation of an observable's noise from step to step.
    fn correlation_of(&self, observable: usize) -> f64 {
        self.noise.iter().map(|noise| noise.correlation[observable]).sum::<f64>() / self.noise.len() as f64
    }

    /// What a user should know before trusting the numbers.
    pub fn verdicts(&self, options: Options) -> Verdicts {
        let mut verdicts = Verdicts::default();
        if self.are_alike {
            let text = "all runs have the same curves, whatever their parameters: does the model use them?";
            verdicts.add("runs-alike", self.runs.len(), text);
        }
        self.say_of_correlation(options, &mut verdicts);
        self.say_of_noise(&mut verdicts);
        self.say_of_scatter(options, &mut verdicts);
        self.say_of_emulator(&mut verdicts);
        leaning_verdicts(&self.parameters(), &mut verdicts);
        verdicts
    }

    fn say_of_correlation(&self, options: Options, verdicts: &mut Verdicts) {
        let counted = match options {
            Options { white: true, .. } => "it is taken for white",
            Options { noise_as_stated: true, .. } => "it is taken as stated",
            _ => "this is counted with",
        };
        for (name, correlation) in self.correlations() {
            // Where it is not counted with, none is found.
            let size = if correlation != 0.0 { format!(" ({correlation:.2})") } else { String::new() };
            verdicts.add(
                "noise-correlated",
                name,
                format!(
                    "the residuals of {name} are correlated from step to step{size}; {counted}. Noise that is not \
                     white looks so, and so does a model that misses the measurement"
                ),
            );
        }
    }

    fn say_of_noise(&self, verdicts: &mut Verdicts) {
        if let Some(correlation) = self.left.alternation {
            verdicts.add(
                "noise-alternates",
                format!("{correlation:.3}"),
                format!("what the best fit leaves {}", alternation(correlation)),
            );
        }
        if let Some(ChiSquare { value, degrees, p, .. }) = self.chi_square.filter(|test| test.is_worse()) {
            let factor = self.variance().sqrt();
            let what = if self.nuisances.inflation {
                format!("it is counted {factor:.2} times as large")
            } else {
                "it is taken as stated".to_owned()
            };
            verdicts.add(
                "noise-too-small",
                format!("{factor:.3}"),
                format!(
                    "the best fit is worse than the noise allows (χ² {value:.0} on {degrees:.0} degrees of freedom, \
                     probability {}); {what}",
                    said(p)
                ),
            );
        }
        // A model that misses, followed by noise that is correlated, fits better than white noise would.
        let is_white = !self.correlated.contains(&true);
        if let Some(ChiSquare { value, degrees, p_of_less, .. }) =
            self.chi_square.filter(|test| test.is_better() && is_white)
        {
            verdicts.add(
                "noise-too-large",
                format!("{:.3}", (value / degrees).sqrt()),
                format!(
                    "the best fit is better than the noise explains (χ² {value:.0} on {degrees:.0} degrees of freedom, \
                     probability {}); is the noise smaller than stated?",
                    said(p_of_less)
                ),
            );
        }
    }

    fn say_of_scatter(&self, options: Options, verdicts: &mut Verdicts) {
        let is_counted = options.scatter != Some(0.0) && !options.white;
        if let Some(proof) = self.proof.filter(|proof| is_counted && proof.has_less_scatter()) {
            verdicts.add(
                "scatter-too-large",
                format!("{:.3}", proof.scatter),
                format!(
                    "the runs seem to scatter by {:.2} standard deviations of the noise, but the newest lie within {:.2} of where \
                     they were expected: an emulator that is poor far from here looks like a simulator that scatters, and \
                     makes the fit look better than it is. If the simulator is deterministic (the same parameters, the same \
                     curve), say so: scatter = 0",
                    proof.scatter, proof.error
                ),
            );
        }
    }

    fn say_of_emulator(&self, verdicts: &mut Verdicts) {
        if self.is_unfit() {
            verdicts.add(
                "emulator-unfit",
                format!("{:.3}", self.surrogate.rmse),
                format!(
                    "no emulator follows this simulator: each run predicted from the others misses by {:.2} \
                     standard deviations of the noise, now by little, now by much; trust the weights of the runs",
                    self.surrogate.rmse
                ),
            );
        } else if self.ignorance > IGNORANT {
            verdicts.add(
                "emulator-ignorant",
                format!("{:.3}", self.ignorance),
                format!(
                    "what the emulator does not know changes ln likelihood by {:.1}; more runs may well change the \
                     posterior",
                    self.ignorance
                ),
            );
        }
    }

    /// What the draws say of each parameter.
    fn parameters(&self) -> Vec<ParameterSummary> {
        let even = vec![1.0 / self.points.len() as f64; self.points.len()];
        let moments = |values: &[f64]| (mean(values, &even), sd(values, &even));
        let parameters = self.space.prior().parameters();
        let of = |(j, parameter): (usize, &Parameter)| {
            let column: Vec<f64> = self.values.iter().map(|row| row[j]).collect();
            // Where it varies: mean and standard deviation of its coordinate, which is 0 and 1 at the bounds.
            let at = self.space.varied().iter().position(|&varied| varied == j);
            let place = at.map(|at| moments(&self.points.iter().map(|x| x[at]).collect::<Vec<_>>()));
            let (centre, spread) = moments(&column);
            let spread = if place.is_some() { spread } else { 0.0 };
            let cv = if spread == 0.0 { 0.0 } else { spread / centre };
            let quantiles = Quantiles::new(&column, &even);
            ParameterSummary {
                name: parameter.name.clone(),
                mean: Some(centre),
                sd: Some(spread),
                cv: Some(if cv.is_finite() { cv } else { 0.0 }),
                q05: Some(quantiles.at(0.05)),
                q95: Some(quantiles.at(0.95)),
                best: None,
                lean: Some(place.map_or(0, |(centre, width)| leaning(centre, width, (0.0, 1.0))).into()),
                shrinkage: place.map(|_| 1.0 - (spread / parameter.sd()).powi(2)),
                width: place.map(|(_, width)| width),
            }
        };
        parameters.iter().enumerate().map(of).collect()
    }

    /// The observables whose residuals are correlated, with the correlation that is counted with.
    fn correlations(&self) -> Vec<(&String, f64)> {
        let found = self.observables.iter().enumerate().filter(|(j, _)| self.correlated[*j]);
        found.map(|(j, name)| (name, self.correlation_of(j))).collect()
    }
}

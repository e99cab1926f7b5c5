//! The simulation as the runs of a design tell it, seen from one measurement.

use anyhow::Result;
use nalgebra::DMatrix;

use crate::attribute::problem::predictor::{Predicted, Predictor};
use crate::noise::least_scale;
use gl_emulator::gp::{Gp, Place};
use gl_emulator::warp::{self, FAR, FAR_OF_SCATTER, Warp, scatters};
use gl_emulator::{Emulator, Options};
use gl_inference::ensemble::Ensemble;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;

/// Components of an emulator at most: weak effects hide in the later ones, and where packings scatter so does what an
/// effect does to a reading that does not.
const COMPONENTS: usize = 40;

/// An emulator of a design. Where runs reach far beyond the measurement it sees them warped, and its patterns
/// are what they do to readings as large as those of the measurement.
#[derive(Clone, Debug)]
pub struct Simulation {
    emulator: Emulator,
    /// What it sees of each observable.
    warps: Vec<Warp>,
    /// Change of each reading by a change of what the emulator sees of it, shape (readings,).
    slopes: Vec<f64>,
    /// Patterns in the readings' own units, shape (readings, components).
    basis: DMatrix<f64>,
    left_over: Vec<f64>,
}

impl Simulation {
    /// Learn it from runs, well enough for a noise (if that is known), or for what readings scatter by where that is less.
    ///
    /// * `measured`, `noise` — shape (observables, steps).
    ///
    /// # Errors
    /// If there are too few runs, or the tables do not belong together.
    pub fn new(
        prior: &Prior,
        (samples, ensemble): (&Samples, &Ensemble),
        measured: &[Vec<f64>],
        noise: Option<&Vec<Vec<f64>>>,
        seed: u64,
    ) -> Result<Self> {
        let seen = |far: f64| -> Result<Self> {
            let warps = warp::warps(measured, ensemble, far);
            let warped = |(j, noise): (usize, &Vec<f64>)| {
                let scale = least_scale(&measured[j], noise);
                noise.iter().zip(&measured[j]).map(|(sd, y)| scale * sd * warps[j].slope(*y)).collect()
            };
            let noise = noise.map(|noise| noise.iter().enumerate().map(warped).collect());
            let options = Options {
                noise,
                max_components: COMPONENTS,
                may_be_scatter: true,
                seed,
                ..Options::default()
            };
            let emulator = Emulator::fit(prior, samples, &warp::seen(ensemble, &warps), &options)?;
            Ok(Self::of(emulator, warps, measured))
        };
        let simulation = seen(FAR)?;
        let is_another_scatter = simulation.is_warped() && scatters(&simulation.emulator);
        if is_another_scatter { seen(FAR_OF_SCATTER) } else { Ok(simulation) }
    }

    /// The same, seen from another measurement, shape (observables, steps).
    pub fn seen_from(&self, measured: &[Vec<f64>]) -> Self {
        Self::of(self.emulator.clone(), self.warps.clone(), measured)
    }

    fn of(emulator: Emulator, warps: Vec<Warp>, measured: &[Vec<f64>]) -> Self {
        let slope = |(warp, values): (&Warp, &Vec<f64>)| -> Vec<f64> {
            values.iter().map(|y| 1.0 / warp.slope(*y)).collect()
        };
        let slopes: Vec<f64> = warps.iter().zip(measured).flat_map(slope).collect();
        let mut basis = emulator.basis().clone();
        basis.row_iter_mut().zip(&slopes).for_each(|(mut row, slope)| row *= *slope);
        let left_over = emulator.leftover().iter().zip(&slopes).map(|(v, slope)| v * slope * slope).collect();
        Self { emulator, warps, slopes, basis, left_over }
    }

    /// Number of samples that had no run.
    pub fn missing(&self) -> usize {
        self.emulator.missing()
    }

    fn is_warped(&self) -> bool {
        self.warps.iter().any(|warp| warp.is_some())
    }

    /// The readings of what the emulator sees.
    fn back(&self, mut seen: Vec<f64>) -> Vec<f64> {
        for (j, warp) in self.warps.iter().enumerate().filter(|(_, warp)| warp.is_some()) {
            seen[self.emulator.outputs_of(j)].iter_mut().for_each(|y| *y = warp.back(*y));
        }
        seen
    }

    /// What a curve has more than the mean of the runs, as patterns make it up, shape (readings,).
    pub fn away(&self, curve: &[f64]) -> Vec<f64> {
        let seen = self.warps.iter().enumerate().flat_map(|(j, warp)| {
            self.emulator.outputs_of(j).map(|i| warp.there(curve[i]) - self.emulator.centre()[i])
        });
        seen.zip(&self.slopes).map(|(away, slope)| away * slope).collect()
    }
}

impl Predictor for Simulation {
    fn readings(&self) -> usize {
        self.slopes.len()
    }

    fn basis(&self) -> &DMatrix<f64> {
        &self.basis
    }

    fn left_over(&self) -> &[f64] {
        &self.left_over
    }

    fn scatter(&self) -> Vec<f64> {
        self.emulator.nugget()
    }

    fn correlation(&self) -> DMatrix<f64> {
        self.emulator.score_covariance(&vec![1.0; self.basis.ncols()])
    }

    fn predict(&self, point: &[f64]) -> Predicted {
        let (mean, variance) = self.emulator.predict_scores(point);
        Predicted { mean, variance }
    }

    fn predict_all(&self, points: &[Vec<f64>]) -> Vec<Predicted> {
        let all = self.emulator.predict_all_scores(points);
        all.into_iter().map(|(mean, variance)| Predicted { mean, variance }).collect()
    }

    fn difference(&self, point: &[f64], other: &[f64]) -> Predicted {
        let [a, b] = [point, other].map(|point| self.emulator.places(point));
        let variance = |(gp, (a, b)): (&Gp, (&Place, &Place))| {
            (gp.covariance(a, a) + gp.covariance(b, b) - 2.0 * gp.covariance(a, b)).max(0.0)
        };
        let [mean, off] = [point, other].map(|point| self.emulator.mean_scores(point));
        Predicted {
            mean: mean.iter().zip(&off).map(|(a, b)| a - b).collect(),
            variance: self.emulator.processes().iter().zip(a.iter().zip(&b)).map(variance).collect(),
        }
    }

    fn mean(&self, point: &[f64]) -> Vec<f64> {
        self.emulator.mean_scores(point)
    }

    fn curve(&self, components: &[f64]) -> Vec<f64> {
        let mut seen = self.emulator.centre().as_slice().to_vec();
        for (pattern, &component) in self.emulator.basis().column_iter().zip(components) {
            for (y, p) in seen.iter_mut().zip(pattern.iter()) {
                *y += component * p;
            }
        }
        self.back(seen)
    }

    fn gradient(&self, point: &[f64]) -> DMatrix<f64> {
        let (components, gradients) = self.emulator.score_gradients(point);
        let by_point = DMatrix::from_fn(gradients.len(), point.len(), |i, j| gradients[i][j]);
        let mut gradient = self.emulator.basis() * by_point;
        if self.is_warped() {
            let curve = self.curve(&components);
            for (j, warp) in self.warps.iter().enumerate().filter(|(_, warp)| warp.is_some()) {
                for i in self.emulator.outputs_of(j) {
                    gradient.row_mut(i).scale_mut(1.0 / warp.slope(curve[i]));
                }
            }
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use gl_inference::observations::Observations;
    use gl_inference::samples::sample_names;
    use gl_table::Table;

    const STEPS: usize = 50;
    const NOISE: f64 = 0.01;

    /// Runs of packings that are all alike before they are sheared, but for the effect, and scatter jaggedly from then on.
    fn packings(runs: usize) -> (Prior, Samples, Ensemble) {
        let text = "name lower upper effect off\nmu 0.2 0.6 - -\nd 0.05 0.4 piston 0\n";
        let prior = Prior::from_table(&Table::parse("params.txt", text.into()).unwrap()).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let names = sample_names("test", 0, runs).unwrap();
        let control: Vec<f64> = (0..STEPS).map(|t| t as f64 / STEPS as f64).collect();
        let observations = Observations {
            source: "obs.txt".to_owned(),
            control_name: "e_z".to_owned(),
            control: control.clone(),
            names: vec!["s".to_owned()],
            values: vec![vec![0.0; STEPS]],
            far_off: Vec::new(),
            sd: vec![None],
        };
        let mut ensemble = Ensemble::new(&observations, false);
        let mut values = Vec::new();
        for (i, name) in names.iter().enumerate() {
            let row = vec![
                random.random_range(0.2..0.6),
                if i % 2 == 0 { 0.0 } else { random.random_range(0.05..0.4) },
            ];
            let mut curve: Vec<f64> =
                control.iter().map(|e| 1.0 + row[1] + 3.0 * row[0] * e.sqrt()).collect();
            for k in 1..STEPS {
                let height = 0.15 * random.random_range(-1.0..1.0) / (k as f64).sqrt();
                curve.iter_mut().zip(&control).for_each(|(y, e)| *y += height * (1.57 * k as f64 * e).sin());
            }
            ensemble.push(name, &[curve], None);
            values.push(row);
        }
        let samples = Samples { source: "samples.txt".to_owned(), names, parameters: prior.names(), values };
        (prior, samples, ensemble)
    }

    #[test]
    fn an_effect_on_one_reading_is_known_though_all_others_scatter() {
        let (prior, samples, ensemble) = packings(80);
        let measured = vec![vec![1.0; STEPS]];
        let noise = vec![vec![NOISE; STEPS]];
        let emulator =
            Simulation::new(&prior, (&samples, &ensemble), &measured, Some(&noise), 1).unwrap().emulator;
        for d in [0.1, 0.2, 0.3] {
            let first = emulator.predict(&emulator.coordinates(&[0.4, d]));
            let (off, sd) = (first.mean[0] - 1.0 - d, first.variance[0].sqrt());
            assert!(off.abs() < 2.0 * NOISE && sd < 2.0 * NOISE, "{d}: {off} ± {sd}");
        }
    }

    /// Runs of y = 10^a u^1.5 + w u, the stiffness a and its effect w, with a between −1.5 and 0.
    fn stiffnesses(scatter: f64) -> (Prior, Samples, Ensemble) {
        let text = "name lower upper effect off\na -1.5 0 - -\nw 0.01 0.1 glue 0\n";
        let prior = Prior::from_table(&Table::parse("params.txt", text.into()).unwrap()).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let names = sample_names("test", 0, 60).unwrap();
        let observations = Observations {
            source: "obs.txt".to_owned(),
            control_name: "u".to_owned(),
            control: (0..STEPS).map(u).collect(),
            names: vec!["f".to_owned()],
            values: vec![vec![0.0; STEPS]],
            far_off: Vec::new(),
            sd: vec![None],
        };
        let mut ensemble = Ensemble::new(&observations, false);
        let mut values = Vec::new();
        for (i, name) in names.iter().enumerate() {
            let (a, w) = (random.random_range(-1.5..0.0), random.random_range(0.01..0.1));
            values.push(vec![a, if i % 2 == 0 { 0.0 } else { w }]);
            let own = 1.0 + scatter * random.random_range(-1.0..1.0);
            let curve = stiff(a, values[i][1]).into_iter().map(|y| own * y).collect();
            ensemble.push(name, &[curve], None);
        }
        let samples = Samples { source: "samples.txt".to_owned(), names, parameters: prior.names(), values };
        (prior, samples, ensemble)
    }

    fn u(step: usize) -> f64 {
        (step + 1) as f64 / STEPS as f64
    }

    fn stiff(a: f64, w: f64) -> Vec<f64> {
        (0..STEPS).map(|t| 10_f64.powf(a) * u(t).powf(1.5) + w * u(t)).collect()
    }

    fn seen_from(measured: &[f64], scatter: f64) -> (Prior, Simulation) {
        let (prior, samples, ensemble) = stiffnesses(scatter);
        let noise = vec![vec![0.0005; STEPS]];
        let measured = [measured.to_vec()];
        let simulation = Simulation::new(&prior, (&samples, &ensemble), &measured, Some(&noise), 1).unwrap();
        (prior, simulation)
    }

    #[test]
    fn a_noise_that_is_stated_far_too_large_hides_no_effect_that_the_readings_would_show() {
        let (prior, samples, ensemble) = stiffnesses(0.0);
        let jagged = |(t, y): (usize, f64)| y + if t % 2 == 0 { 0.003 } else { -0.003 };
        let measured = [stiff(0.0, 0.05).into_iter().enumerate().map(jagged).collect()];
        let noise = vec![vec![0.1; STEPS]];
        let simulation = Simulation::new(&prior, (&samples, &ensemble), &measured, Some(&noise), 1).unwrap();
        // The stiffness and the effect are a pattern each.
        assert_eq!(simulation.basis().ncols(), 2);
    }

    #[test]
    fn runs_far_beyond_the_measurement_do_not_hide_it() {
        for (a, w) in [(-1.4, 0.0), (-1.3, 0.03), (-1.2, 0.08)] {
            let measured = stiff(a, w);
            let (prior, simulation) = seen_from(&measured, 0.0);
            assert!(simulation.is_warped());
            let point: Vec<f64> =
                prior.parameters().iter().zip([a, w]).map(|(p, value)| p.coordinate(value)).collect();
            let Predicted { mean, variance } = simulation.predict(&point);
            let curve = simulation.curve(&mean);
            let spread: f64 = simulation
                .basis()
                .column_iter()
                .zip(&variance)
                .map(|(column, v)| v * column.norm_squared() / STEPS as f64)
                .sum();
            let off =
                curve.iter().zip(&measured).map(|(y, seen)| (y - seen).powi(2)).sum::<f64>() / STEPS as f64;
            assert!(
                off.sqrt() < 0.0005 && spread.sqrt() < 0.0005,
                "{a} {w}: {} {}",
                off.sqrt(),
                spread.sqrt()
            );
        }
    }

    #[test]
    fn patterns_and_gradients_are_difference_quotients_of_the_curve() {
        let (_, simulation) = seen_from(&stiff(-1.2, 0.05), 0.0);
        let point = [0.2, 0.05];
        let components = simulation.mean(&point);
        let curve = simulation.curve(&components);
        let here = simulation.seen_from(&[curve]);
        let quotient = |above: Vec<f64>, below: Vec<f64>, i: usize| (above[i] - below[i]) / 2e-5;
        for k in 0..components.len() {
            let moved = |by: f64| {
                let mut components = components.clone();
                components[k] += by;
                here.curve(&components)
            };
            for i in [0, STEPS / 2, STEPS - 1] {
                let (basis, numeric) = (here.basis()[(i, k)], quotient(moved(1e-5), moved(-1e-5), i));
                assert!((basis - numeric).abs() < 1e-6, "{k} {i}: {basis} {numeric}");
            }
        }
        let gradient = here.gradient(&point);
        for j in 0..point.len() {
            let moved = |by: f64| {
                let mut point = point;
                point[j] += by;
                here.curve(&here.mean(&point))
            };
            for i in [0, STEPS / 2, STEPS - 1] {
                let (exact, numeric) = (gradient[(i, j)], quotient(moved(1e-5), moved(-1e-5), i));
                assert!((exact - numeric).abs() < 1e-4, "{j} {i}: {exact} {numeric}");
            }
        }
    }

    #[test]
    fn what_scatters_is_seen_as_it_is_unless_runs_are_much_further_off() {
        assert!(!seen_from(&stiff(-1.2, 0.05), 0.2).1.is_warped());
        assert!(!seen_from(&stiff(0.0, 0.05), 0.0).1.is_warped());
    }
}

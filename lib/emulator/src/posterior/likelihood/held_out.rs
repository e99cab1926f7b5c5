//! What a point of the posterior says of each reading, given all the others.

use gl_inference::loo::Given;

use super::{Likelihood, NoiseAt};
use crate::cholesky::dot;

impl Likelihood<'_> {
    /// The distribution of each reading given all others at a point, shape (observables · steps), in the readings' own
    /// units; nothing where the covariance has no factor.
    ///
    /// With Σ the covariance of all readings and r what they have more than the emulator's mean, reading i has the mean
    /// y_i − (Σ⁻¹r)_i / (Σ⁻¹)_ii and the variance 1/(Σ⁻¹)_ii. By Woodbury's identity
    /// Σ⁻¹ = D⁻¹ − P L (I + LᵀGL)⁻¹ Lᵀ Pᵀ, with P = D⁻¹B, G = BᵀP and L Lᵀ the covariance of the scores.
    ///
    /// # Source
    /// Bürkner, Gabry & Vehtari (2021), Comput. Stat. 36:1243.
    pub fn held_out(&self, x: &[f64]) -> Option<Vec<Given>> {
        let measured = self.measured;
        let noise = self.noise_at(x);
        let (mean, variance) = self.emulator.predict_scores(&self.space.coordinates(x));
        let curve = self.emulator.curve(&mean);
        let residual = measured.residual(curve.as_slice());
        let e: Vec<f64> = residual.iter().zip(&measured.noise).map(|(r, sd)| r / sd).collect();
        let k = mean.len();
        let patterns: Vec<Vec<f64>> = (0..k)
            .map(|c| (0..e.len()).map(|o| self.emulator.basis()[(o, c)] / measured.base[o]).collect())
            .collect();
        let (whitened, diagonal) = self.whiten(&e, &noise);
        let columns: Vec<Vec<f64>> = patterns.iter().map(|column| self.whiten(column, &noise).0).collect();
        let variance: Vec<f64> = variance.iter().map(|v| self.calibration * v.max(0.0)).collect();
        let g: Vec<f64> =
            patterns.iter().flat_map(|row| columns.iter().map(|column| dot(row, column))).collect();
        let (factor, cholesky) = self.capacitance(&g, &variance, noise.scatter)?;
        // Lᵀv, and from the left with the inverse of the inner factor.
        let through = |v: &[f64]| {
            let mut q: Vec<f64> = (0..k).map(|i| (i..k).map(|l| factor.row(l)[i] * v[l]).sum()).collect();
            cholesky.solve_lower(&mut q);
            q
        };
        let gap: Vec<f64> = patterns.iter().map(|pattern| dot(pattern, &whitened)).collect();
        let gap = through(&gap);
        let of = |o: usize| {
            let row: Vec<f64> = columns.iter().map(|column| column[o]).collect();
            let q = through(&row);
            let precision = diagonal[o] - dot(&q, &q);
            let pull = whitened[o] - dot(&q, &gap);
            let unit = measured.noise[o];
            let given =
                Given { mean: measured.readings[o] - unit * pull / precision, sd: unit / precision.sqrt() };
            (given.mean.is_finite() && given.sd.is_finite() && given.sd > 0.0).then_some(given)
        };
        (0..e.len()).map(of).collect()
    }

    /// D⁻¹v, and the diagonal of D⁻¹, in units of the base; shape (observables · steps).
    fn whiten(&self, v: &[f64], noise: &NoiseAt) -> (Vec<f64>, Vec<f64>) {
        let (mut product, mut diagonal) = (Vec::with_capacity(v.len()), Vec::with_capacity(v.len()));
        for (j, (block, &phi)) in self.blocks.iter().zip(&noise.correlation).enumerate() {
            let v = &v[self.measured.own(j)];
            let variance = noise.variance + block.white.0 + noise.scatter * block.white.1;
            let factor = 1.0 / (variance * (1.0 - phi * phi));
            for t in 0..v.len() {
                let before = if t > 0 { v[t - 1] } else { 0.0 };
                let after = v.get(t + 1).copied().unwrap_or(0.0);
                let is_inner = t > 0 && t + 1 < v.len();
                let own = if is_inner { 1.0 + phi * phi } else { 1.0 };
                product.push(factor * (own * v[t] - phi * (before + after)));
                diagonal.push(factor * own);
            }
        }
        (product, diagonal)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Measured, Nuisances};
    use super::*;
    use crate::posterior::space::Space;
    use crate::posterior::surrogate::{PLAIN, Ranked};
    use crate::warp::Warp;
    use gl_inference::ensemble::Ensemble;
    use gl_inference::observations::Observations;
    use gl_inference::prior::Prior;
    use gl_inference::samples::Samples;
    use gl_table::Table;
    use nalgebra::{DMatrix, DVector};

    /// Two observables at five steps, runs that scatter, a noise that is correlated.
    #[test]
    fn a_reading_given_the_others_is_that_of_the_whole_covariance() {
        let mut samples = "description a b\n".to_owned();
        let mut runs = "sample step u f g\n".to_owned();
        for i in 0..24 {
            let (a, b) = (f64::from(i) / 23.0, f64::from(7 * i % 24) / 23.0);
            samples += &format!("s{i} {a} {b}\n");
            for t in 0..5 {
                let u = f64::from(t);
                let rough = 0.05 * (f64::from(13 * i + 7 * t) * 1.7).sin();
                let (f, g) = (a * u + b * b + rough, (0.4 * u * b).sin() + 2.0 * a + rough);
                runs += &format!("s{i} {t} {u} {f} {g}\n");
            }
        }
        let obs = "u f g\n0 .2 1\n1 .7 1.1\n2 1.4 1.2\n3 1.5 1.5\n4 2.3 1.8\n";
        let of = |text: &str| Table::parse("t", text.as_bytes().to_vec()).unwrap();
        let names = ["f".to_owned(), "g".to_owned()];
        let observations = Observations::from_table(&of(obs), "u", &names).unwrap();
        let samples = Samples::from_table(&of(&samples)).unwrap();
        let ensemble = Ensemble::parse("runs", runs.as_bytes(), "u", &names).unwrap();
        let prior = Prior::from_table(&of("name lower upper\na 0 1\nb 0 1\n")).unwrap();
        let readings = observations.values.concat();
        let noise = [vec![0.1; 5], vec![0.07; 5]].concat();
        let measured = Measured {
            values: readings.clone(),
            base: noise.clone(),
            readings,
            noise,
            warps: vec![Warp::default(); 2],
            is_known: true,
            starts: vec![0, 5, 10],
            ranges: vec![2.1, 0.8],
        };
        let space = Space::new(&prior, &samples).unwrap();
        let ranked = Ranked::new(&space, &samples, &ensemble, &measured);
        let surrogate = ranked.by(PLAIN, &measured, 3).unwrap();
        let nuisances =
            Nuisances { scatter: None, ln_noise: None, inflation: true, correlation: vec![true, false] };
        let likelihood = Likelihood::new(&surrogate, &space, &measured, nuisances);
        let x = [0.4, 0.6, 0.1, 0.05, 0.5];
        let NoiseAt { scatter, variance, correlation } = likelihood.noise_at(&x);
        assert!(scatter > 0.0 && variance > 1.0 && correlation[0] > 0.3);

        let emulator = &surrogate.emulator;
        let (mean, errors) = emulator.predict_scores(&space.coordinates(&x));
        let errors: Vec<f64> = errors.iter().map(|v| surrogate.calibration * v).collect();
        let scores = emulator.score_covariance(&errors) + scatter * &surrogate.scatter.scores;
        let n = measured.readings.len();
        let whole = emulator.basis() * scores * emulator.basis().transpose()
            + DMatrix::from_fn(n, n, |o, p| {
                let (j, other) = (measured.observable_of(o), measured.observable_of(p));
                let white = surrogate.scatter.truncated[j] + scatter * surrogate.scatter.white[j];
                let apart = o.abs_diff(p) as i32;
                let alike = if j == other { correlation[j].powi(apart) } else { 0.0 };
                measured.noise[o] * measured.noise[p] * (variance + white) * alike
            });
        let curve = emulator.centre() + emulator.basis() * DVector::from_vec(mean);
        let residual = DVector::from_vec(measured.residual(curve.as_slice()));
        let found = likelihood.held_out(&x).unwrap();
        for o in 0..n {
            // Covariances with the others, K, and of the others among themselves, A: K A⁻¹ r and K A⁻¹ Kᵀ.
            let others = whole.clone().remove_row(o).remove_column(o);
            let beside = whole.row(o).transpose().remove_row(o);
            let solved = others.lu().solve(&beside).unwrap();
            let mean = curve[o] + solved.dot(&residual.clone().remove_row(o));
            let sd = (whole[(o, o)] - solved.dot(&beside)).sqrt();
            assert!((found[o].mean - mean).abs() < 1e-8, "{o}: {} for {mean}", found[o].mean);
            assert!((found[o].sd / sd - 1.0).abs() < 1e-8, "{o}: {} for {sd}", found[o].sd);
        }
    }
}

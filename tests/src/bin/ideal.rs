//! The best that anybody could do beside a remainder: the world itself, the true noise and the law that remainders are drawn by.
use anyhow::{Context, Result};
use gl_gap::attribute::evidence::mode::standard_normal;
use gl_gap::attribute::problem::hypothesis::hypotheses;
use gl_gap::attribute::problem::path::Path as Control;
use gl_inference::observations::{Observations, range};
use gl_table::Table;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use pipelines::withheld::bench::Bench;
use pipelines::withheld::specimen::factor;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::path::PathBuf;

struct Like<'a> {
    bench: &'a Bench,
    chol: Cholesky<f64, Dyn>,
    y: Vec<f64>,
    half_det: f64,
}
impl Like<'_> {
    fn values(&self, free: &[usize], z: &[f64]) -> Vec<f64> {
        let mut v = self.bench.prior.with_effects_off();
        for (&j, &z) in free.iter().zip(z) {
            v[j] = self.bench.prior.parameters()[j].quantile(z);
        }
        v
    }
    fn white(&self, free: &[usize], z: &[f64]) -> Option<DVector<f64>> {
        let c = self.bench.simulate(&self.values(free, z)).ok()?.concat();
        let r = DVector::from_iterator(c.len(), self.y.iter().zip(&c).map(|(y, c)| y - c));
        self.chol.l().solve_lower_triangular(&r)
    }
    fn ln(&self, free: &[usize], z: &[f64]) -> f64 {
        self.white(free, z).map_or(f64::NEG_INFINITY, |r| -0.5 * r.norm_squared() - self.half_det)
    }
    fn descend(&self, free: &[usize], start: Vec<f64>) -> Option<(Vec<f64>, DMatrix<f64>, f64)> {
        let d = free.len();
        let mut z = start;
        let mut r = self.white(free, &z)?;
        let mut damping = 1e-2;
        let mut slopes = DMatrix::zeros(r.len(), d);
        for _ in 0..40 {
            for k in 0..d {
                let h = if z[k] > 0.5 { -1e-5 } else { 1e-5 };
                let mut m = z.clone();
                m[k] += h;
                slopes.set_column(k, &((&r - self.white(free, &m)?) / h));
            }
            let sq = slopes.tr_mul(&slopes);
            let sl = slopes.tr_mul(&r);
            let mut moved = false;
            while damping < 1e9 {
                let mut a = sq.clone();
                let mut b = sl.clone();
                for k in 0..d {
                    a[(k, k)] += damping * (sq[(k, k)] + 1e-9);
                    if (b[k] < 0.0 && z[k] <= 0.0) || (b[k] > 0.0 && z[k] >= 1.0) {
                        a.row_mut(k).fill(0.0);
                        a.column_mut(k).fill(0.0);
                        a[(k, k)] = 1.0;
                        b[k] = 0.0;
                    }
                }
                let step = Cholesky::new(a)?.solve(&b);
                let next: Vec<f64> =
                    z.iter().zip(step.iter()).map(|(z, s)| (z + s).clamp(0.0, 1.0)).collect();
                if let Some(n) = self.white(free, &next)
                    && n.norm_squared() < r.norm_squared()
                {
                    let gain = 1.0 - n.norm_squared() / r.norm_squared();
                    z = next;
                    r = n;
                    damping = (damping * 0.2).max(1e-9);
                    moved = gain > 1e-6;
                    break;
                }
                damping *= 5.0;
            }
            if !moved {
                break;
            }
        }
        let precision = slopes.tr_mul(&slopes) + DMatrix::identity(d, d) * 4.0;
        Some((z, precision, -0.5 * r.norm_squared() - self.half_det))
    }
    fn evidence(&self, free: &[usize], random: &mut ChaCha8Rng) -> (f64, f64) {
        let d = free.len();
        let mut modes = Vec::new();
        for k in 0..4 {
            let start: Vec<f64> =
                (0..d).map(|_| if k == 0 { 0.5 } else { random.random_range(0.1..0.9) }).collect();
            if let Some(m) = self.descend(free, start) {
                modes.push(m);
            }
        }
        let best = modes.iter().map(|m| m.2).fold(f64::NEG_INFINITY, f64::max);
        modes.retain(|m| m.2 > best - 6.0);
        const N: usize = 3000;
        let nu = 4.0;
        let fs: Vec<_> = modes.iter().map(|m| Cholesky::new(m.1.clone() / 1.5).unwrap()).collect();
        let ln_t = |m: usize, z: &[f64]| {
            let dz = DVector::from_iterator(d, z.iter().zip(&modes[m].0).map(|(a, b)| a - b));
            let q = (fs[m].l().transpose() * dz).norm_squared();
            let g = statrs::function::gamma::ln_gamma;
            g((nu + d as f64) / 2.0) - g(nu / 2.0) - 0.5 * d as f64 * (nu * std::f64::consts::PI).ln()
                + fs[m].l().diagonal().iter().map(|l| l.ln()).sum::<f64>()
                - 0.5 * (nu + d as f64) * (q / nu).ln_1p()
        };
        let mut ln_w = Vec::with_capacity(N);
        for _ in 0..N {
            let z: Vec<f64> = if random.random::<f64>() < 0.2 || modes.is_empty() {
                (0..d).map(|_| random.random()).collect()
            } else {
                let m = random.random_range(0..modes.len());
                let g = DVector::from_iterator(d, (0..d).map(|_| standard_normal(random)));
                let chi: f64 = (0..4).map(|_| standard_normal(random).powi(2)).sum();
                let s = fs[m].l().transpose().solve_upper_triangular(&g).unwrap() * (nu / chi).sqrt();
                modes[m].0.iter().zip(s.iter()).map(|(a, b)| a + b).collect()
            };
            if z.iter().any(|z| !(0.0..=1.0).contains(z)) {
                ln_w.push(f64::NEG_INFINITY);
                continue;
            }
            let q = if modes.is_empty() {
                1.0
            } else {
                0.2 + 0.8 * (0..modes.len()).map(|m| ln_t(m, &z).exp()).sum::<f64>() / modes.len() as f64
            };
            ln_w.push(self.ln(free, &z) - q.ln());
        }
        let top = ln_w.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let w: Vec<f64> = ln_w.iter().map(|l| (l - top).exp()).collect();
        let s: f64 = w.iter().sum();
        (top + (s / N as f64).ln(), s * s / w.iter().map(|w| w * w).sum::<f64>())
    }
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().collect();
    let bench = Bench::named(&args[1])?;
    let times: f64 = args[2].parse()?;
    for dir in &args[3..] {
        let dir = PathBuf::from(dir);
        let answers = Table::read(&dir.join("sealed/answers.tsv"))?;
        let list = Table::read(&dir.join("cases/cases.tsv"))?;
        let col =
            |t: &Table, r: usize, c: &str| -> String { t.field(r, t.format().column(c).unwrap()).to_owned() };
        let rows: Vec<usize> = (0..answers.len())
            .filter(|&r| col(&answers, r, "withheld") == "-" && col(&answers, r, "family") != "Rig")
            .collect();
        let out: Vec<String> = rows
            .into_par_iter()
            .map(|r| -> Result<String> {
                let name = col(&answers, r, "case");
                let obs = Observations::read(
                    &dir.join(format!("cases/{name}_obs.txt")),
                    bench.world.control(),
                    &bench.observables(),
                )?;
                let sd: Vec<f64> = obs.sd.iter().map(|s| s.as_ref().unwrap()[0]).collect();
                let path = bench.path();
                let places = Control::new(&path).places();
                let n = path.len();
                let no = sd.len();
                let f = factor(&path);
                let ff = &f * f.transpose();
                let scat = col(&list, r, "scatter") == "yes";
                let rg: Vec<f64> = obs.values.iter().map(|v| range(v)).collect();
                let kernel = |d: f64| {
                    let w = std::f64::consts::TAU * d;
                    if w.abs() < 1e-9 { 1.0 } else { ((2.0 * w).sin() - (0.2 * w).sin()) / (1.8 * w) }
                };
                let c = DMatrix::from_fn(n * no, n * no, |a, b| {
                    let (i, s, j, t) = (a / n, a % n, b / n, b % n);
                    let mut v = 0.0;
                    if i == j {
                        v += (times * sd[i]).powi(2) * kernel(places[s] - places[t]);
                        if s == t {
                            v += sd[i] * sd[i];
                        }
                    }
                    if scat {
                        v += rg[i] * rg[j] * ff[(s, t)] * if i == j { 1.0 } else { 0.36 };
                    }
                    v
                });
                let chol = Cholesky::new(c).context("no factor")?;
                let half_det = chol.l().diagonal().iter().map(|l| l.ln()).sum();
                let like = Like { bench: &bench, chol, y: obs.values.concat(), half_det };
                let effects = bench.effects();
                let sets = hypotheses(effects.len(), 2);
                let mut random = ChaCha8Rng::seed_from_u64(5 + r as u64);
                let pairs = sets.iter().filter(|s| s.len() == 2).count() as f64;
                let mut scored: Vec<(f64, String, f64)> = sets
                    .iter()
                    .map(|set| {
                        let mut free = bench.prior.base();
                        free.extend(set.iter().flat_map(|&e| effects[e].parameters.clone()));
                        let (ln, ess) = like.evidence(&free, &mut random);
                        let prior: f64 = match set.len() {
                            0 => 0.1,
                            1 => 0.65 / effects.len() as f64,
                            _ => 0.1 / pairs,
                        };
                        let name = if set.is_empty() {
                            "none".to_owned()
                        } else {
                            set.iter().map(|&e| effects[e].name.clone()).collect::<Vec<_>>().join("+")
                        };
                        (ln + prior.ln(), name, ess)
                    })
                    .collect();
                scored.sort_by(|a, b| b.0.total_cmp(&a.0));
                let total: f64 = scored.iter().map(|s| (s.0 - scored[0].0).exp()).sum();
                let truth = col(&answers, r, "effects");
                let at =
                    scored.iter().find(|s| s.1 == truth).map_or(f64::NEG_INFINITY, |s| s.0 - scored[0].0);
                Ok(format!(
                    "{}\t{name}\t{truth}\t{}\t{}\t{:.3}\t{:.1}\t{:.0}",
                    dir.display(),
                    col(&answers, r, "visibility"),
                    scored[0].1,
                    1.0 / total,
                    at,
                    scored.iter().map(|s| s.2).fold(1e9, f64::min)
                ))
            })
            .collect::<Result<_>>()?;
        for line in out {
            println!("{line}");
        }
    }
    Ok(())
}

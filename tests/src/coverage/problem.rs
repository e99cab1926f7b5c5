//! The problems.

use anyhow::{Context, Result};
use gl_inference::ensemble::Ensemble;
use gl_inference::observations::Observations;
use gl_inference::prior::{Prior, normal_quantile};
use gl_table::Table;
use rand::Rng;
use rand::distr::Open01;
use rand_chacha::ChaCha8Rng;

/// What a run differs by from another of the same parameters, and a measurement from its mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scatter {
    /// Nothing.
    None,
    /// Independent from reading to reading, as large as the noise.
    White,
    /// Smooth along the control, as large as the noise.
    Smooth,
}

/// A simulator in closed form and how it is measured.
#[derive(Clone, Copy)]
pub struct Problem {
    /// Its name.
    pub name: &'static str,
    /// Number of parameters, each even between 0 and 1.
    pub parameters: usize,
    /// Number of observables.
    pub observables: usize,
    /// Steps of the control, which goes from 0 to 1.
    pub steps: usize,
    /// Standard deviation of the noise.
    pub noise: f64,
    /// Whether it is told.
    pub is_told: bool,
    /// Correlation of the noise from step to step, which is not told.
    pub phi: f64,
    /// The simulator's scatter.
    pub scatter: Scatter,
    /// Whether the measurement has it, too.
    pub is_measured: bool,
    /// The mean curve of an observable at parameters and a control value.
    pub curve: fn(&[f64], usize, f64) -> f64,
}

const PLAIN: Problem = Problem {
    name: "two",
    parameters: 2,
    observables: 1,
    steps: 40,
    noise: 0.02,
    is_told: true,
    phi: 0.0,
    scatter: Scatter::None,
    is_measured: false,
    curve: two,
};

/// All problems.
pub const PROBLEMS: [Problem; 14] = [
    PLAIN,
    Problem { name: "unknown-noise", is_told: false, ..PLAIN },
    Problem { name: "ridge", parameters: 4, noise: 0.02, curve: ridge, ..PLAIN },
    Problem { name: "six", parameters: 6, observables: 2, steps: 50, noise: 0.03, curve: six, ..PLAIN },
    Problem { name: "eight", parameters: 8, observables: 4, steps: 100, noise: 0.05, curve: eight, ..PLAIN },
    Problem { name: "two-modes", noise: 0.01, curve: modes, ..PLAIN },
    Problem { name: "white-scatter", scatter: Scatter::White, ..PLAIN },
    Problem { name: "white-scatter-measured", scatter: Scatter::White, is_measured: true, ..PLAIN },
    Problem { name: "smooth-scatter", scatter: Scatter::Smooth, ..PLAIN },
    Problem { name: "smooth-scatter-measured", scatter: Scatter::Smooth, is_measured: true, ..PLAIN },
    Problem { name: "correlated-noise", steps: 80, phi: 0.8, ..PLAIN },
    Problem { name: "jump", curve: jump, ..PLAIN },
    Problem { name: "stairs", curve: stairs, ..PLAIN },
    Problem { name: "wide", parameters: 3, noise: 0.02, curve: wide, ..PLAIN },
];

fn two(p: &[f64], _: usize, u: f64) -> f64 {
    (0.5 + p[0]) * (1.0 - (-(1.0 + 4.0 * p[1]) * u).exp())
}

/// Only the product of the first two and the ratio of the others show.
fn ridge(p: &[f64], _: usize, u: f64) -> f64 {
    let (a, b, c, d) = (0.3 + p[0], 0.3 + p[1], 0.5 + p[2], 0.5 + p[3]);
    a * b * u * (1.0 + 2.0 * u) / (1.0 + 2.0 * (c / d) * u)
}

fn six(p: &[f64], j: usize, u: f64) -> f64 {
    match j {
        0 => (0.5 + p[0]) * (3.0 * (0.3 + p[1]) * u).tanh() + 0.8 * p[2] * u * u + 0.3 * p[5] * p[0] * u,
        _ => (0.4 + p[3]) * (-2.0 * p[4] * u).exp() * (2.0 + 3.0 * p[5] + p[1]).mul_add(u, 0.3).sin(),
    }
}

fn eight(p: &[f64], j: usize, u: f64) -> f64 {
    match j {
        0 => (0.5 + p[0]) * (1.0 - (-(1.0 + 4.0 * p[1]) * u).exp()) + 0.5 * p[2] * u * u,
        1 => (0.5 + p[3]) * u * (-(p[4] + 0.5 * p[1]) * u).exp() - 0.4 * p[0] * p[2] * u,
        2 => (0.5 + p[5]) * (2.0 * u * (0.5 + p[6])).sin() + 0.3 * p[3] * u,
        _ => (0.3 + p[7]) * u.powf(0.5 + p[6]) + 0.4 * p[4] * p[5] * u * u,
    }
}

/// The first parameter and one less it are nearly alike.
fn modes(p: &[f64], _: usize, u: f64) -> f64 {
    let hidden = (p[0] - 0.5).powi(2) * 4.0 + 0.004 * p[0];
    hidden * u + (0.3 + p[1]) * u * u
}

fn jump(p: &[f64], j: usize, u: f64) -> f64 {
    // A branch that opens where both parameters together are large enough.
    let opens = p[0] + 0.6 * p[1] > 0.8;
    two(p, j, u) + if opens { 0.25 * u * u } else { 0.0 }
}

/// A simulator that jumps wherever a parameter goes by.
fn stairs(p: &[f64], j: usize, u: f64) -> f64 {
    let step = |x: f64| (13.0 * x).floor() / 13.0;
    two(&[step(p[0] + 0.03 * p[1]), step(p[1] + 0.05 * p[0])], j, u) + 0.08 * p[0] * u
}

/// Over the whole prior it goes through three decades.
fn wide(p: &[f64], _: usize, u: f64) -> f64 {
    (5.0 * p[0] - 2.0).exp() * u.powf(0.5 + 2.0 * p[1]) + (3.0 * p[2] - 2.0).exp() * (1.0 - u)
}

/// A standard normal number.
pub fn normal(generator: &mut ChaCha8Rng) -> f64 {
    normal_quantile(generator.sample(Open01))
}

/// Waves that smooth scatter is made of, with amplitudes whose squares sum to one.
const WAVES: usize = 5;

impl Problem {
    /// A problem by its name.
    ///
    /// # Errors
    /// If there is none of this name.
    pub fn named(name: &str) -> Result<Self> {
        let names: Vec<&str> = PROBLEMS.iter().map(|problem| problem.name).collect();
        PROBLEMS
            .into_iter()
            .find(|problem| problem.name == name)
            .with_context(|| format!("{name}: no such problem; they are {}", names.join(", ")))
    }

    /// The prior.
    ///
    /// # Errors
    /// Never, if the problem is sound.
    pub fn prior(&self) -> Result<Prior> {
        let rows: String = (0..self.parameters).map(|j| format!("p{j} 0 1\n")).collect();
        Prior::from_table(&Table::parse("params.txt", format!("name lower upper\n{rows}").into_bytes())?)
    }

    /// Control values.
    pub fn control(&self) -> Vec<f64> {
        (0..self.steps).map(|t| (t as f64 + 1.0) / self.steps as f64).collect()
    }

    /// Names of the observables.
    pub fn names(&self) -> Vec<String> {
        (0..self.observables).map(|j| format!("y{j}")).collect()
    }

    /// The mean curves, shape (observables, steps).
    pub fn mean(&self, p: &[f64]) -> Vec<Vec<f64>> {
        let control = self.control();
        (0..self.observables).map(|j| control.iter().map(|&u| (self.curve)(p, j, u)).collect()).collect()
    }

    /// Variance of the scatter, and its correlation, along the control; shape (steps, steps).
    pub fn scatter_covariance(&self, s: usize, t: usize) -> f64 {
        let variance = self.noise * self.noise;
        match self.scatter {
            Scatter::None => 0.0,
            Scatter::White => {
                if s == t {
                    variance
                } else {
                    0.0
                }
            }
            Scatter::Smooth => {
                let control = self.control();
                variance / WAVES as f64
                    * (0..WAVES).map(|k| wave(k, control[s]) * wave(k, control[t])).sum::<f64>()
            }
        }
    }

    fn add_scatter(&self, curves: &mut [Vec<f64>], generator: &mut ChaCha8Rng) {
        let control = self.control();
        for curve in curves {
            match self.scatter {
                Scatter::None => {}
                Scatter::White => curve.iter_mut().for_each(|y| *y += self.noise * normal(generator)),
                Scatter::Smooth => {
                    let sizes: Vec<f64> =
                        (0..WAVES).map(|_| self.noise / (WAVES as f64).sqrt() * normal(generator)).collect();
                    for (y, &u) in curve.iter_mut().zip(&control) {
                        *y += sizes.iter().enumerate().map(|(k, size)| size * wave(k, u)).sum::<f64>();
                    }
                }
            }
        }
    }

    /// A run, shape (observables, steps).
    pub fn run(&self, p: &[f64], generator: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let mut curves = self.mean(p);
        self.add_scatter(&mut curves, generator);
        curves
    }

    /// What is measured at a truth.
    pub fn measure(&self, truth: &[f64], generator: &mut ChaCha8Rng) -> Observations {
        let mut values = self.mean(truth);
        if self.is_measured {
            self.add_scatter(&mut values, generator);
        }
        for curve in &mut values {
            let mut state = normal(generator);
            for y in curve {
                *y += self.noise * state;
                state = self.phi * state + (1.0 - self.phi * self.phi).sqrt() * normal(generator);
            }
        }
        Observations {
            source: "obs".to_owned(),
            control_name: "u".to_owned(),
            control: self.control(),
            names: self.names(),
            values,
            far_off: Vec::new(),
            sd: vec![None; self.observables],
        }
    }

    /// The noise as it is told.
    pub fn told(&self) -> Option<Vec<Vec<f64>>> {
        self.is_told.then(|| vec![vec![self.noise; self.steps]; self.observables])
    }

    /// The share of the scatter in the measurement as it is told: that there is none, where there is none.
    pub fn scatter_told(&self) -> Option<f64> {
        (self.scatter != Scatter::None && !self.is_measured).then_some(0.0)
    }

    /// An ensemble without runs.
    pub fn ensemble(&self, observations: &Observations) -> Ensemble {
        Ensemble::new(observations, false)
    }
}

/// A wave along the control of mean square one, over a range that no parameter follows exactly.
fn wave(k: usize, u: f64) -> f64 {
    std::f64::consts::SQRT_2 * ((k as f64 + 0.5) * std::f64::consts::PI * u + 0.4 * k as f64).sin()
}

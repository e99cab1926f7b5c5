//! Which samples to run: draws from the prior, with effects on or off.

use anyhow::{Result, ensure};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use crate::prior::{Effect, Prior};
use gl_numeric::sequence::{self, Method};

/// Which effects a design has in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Effects {
    /// None: every effect is off in every run.
    None,
    /// Each is on or off, in every combination: what attribution wants.
    Switch,
    /// These are on in every run, the others off.
    On(Vec<String>),
}

/// Number of samples that `auto` means for `dimensions` parameters: 10 d ln d, at least 10.
///
/// # Source
/// Hartmann et al. (2022), Front. Artif. Intell. 5:836443.
pub fn auto_count(dimensions: usize) -> usize {
    let d = dimensions as f64;
    ((10.0 * d * d.ln()).ceil() as usize).max(10)
}

/// Runs of the first design of a calibration through an emulator, for so many parameters.
pub fn first_runs(parameters: usize) -> usize {
    (5 * parameters).max(8)
}

/// Runs of a batch after it, for so many parameters.
pub fn batch_runs(parameters: usize) -> usize {
    match parameters {
        0..=2 => 4,
        3..=4 => 6,
        5..=6 => 8,
        _ => 12,
    }
}

/// Positions of the parameters that vary in a design.
///
/// # Errors
/// If an effect is named that there is not, or nothing varies.
pub fn varied(prior: &Prior, effects: &Effects) -> Result<Vec<usize>> {
    let on = match effects {
        Effects::None => Vec::new(),
        Effects::Switch => prior.effects(),
        Effects::On(names) => prior.select_effects(names)?,
    };
    ensure!(
        *effects != Effects::Switch || !on.is_empty(),
        "no parameter belongs to an effect; name one in the column effect, with its value off"
    );
    let mut varied = prior.base();
    varied.extend(on.iter().flat_map(|effect| &effect.parameters));
    varied.sort_unstable();
    ensure!(!varied.is_empty(), "every parameter belongs to an effect that is off; nothing varies");
    Ok(varied)
}

/// Draw `n` samples from the prior, shape (n, parameters); effects that are off stand at `off`.
///
/// # Errors
/// If an effect is named that there is not, nothing varies, or `n` is too small for a switch design.
pub fn draw(
    prior: &Prior,
    effects: &Effects,
    method: Method,
    n: usize,
    seed: u64,
    scrambled: bool,
) -> Result<Vec<Vec<f64>>> {
    let varied = varied(prior, effects)?;
    let points = sequence::points(method, n, varied.len(), scrambled.then_some(seed))?;
    let mut samples: Vec<Vec<f64>> = points
        .iter()
        .map(|point| {
            let mut sample = prior.with_effects_off();
            for (&j, &u) in varied.iter().zip(point) {
                sample[j] = prior.parameters()[j].quantile(u);
            }
            sample
        })
        .collect();
    if *effects == Effects::Switch {
        let effects = prior.effects();
        let switches = switches(n, effects.len(), seed)?;
        for (sample, on) in samples.iter_mut().zip(switches) {
            for (effect, _) in effects.iter().zip(on).filter(|(_, on)| !on) {
                switch_off(prior, effect, sample);
            }
        }
    }
    Ok(samples)
}

fn switch_off(prior: &Prior, effect: &Effect, sample: &mut [f64]) {
    for &j in &effect.parameters {
        sample[j] = prior.parameters()[j].off.unwrap_or(sample[j]);
    }
}

/// Fewest samples in which so many effects can be switched on and off.
pub fn least_switched(effects: usize) -> usize {
    (12 * effects).div_ceil(5) + 2
}

/// Which effects are on in each of `n` runs, shape (n, effects): each in half of the runs, none in at
/// least one run in six, and each alone in a few.
///
/// # Errors
/// If `n` is too small to hold these.
pub fn switches(n: usize, effects: usize, seed: u64) -> Result<Vec<Vec<bool>>> {
    let none = n.div_ceil(6);
    let alone = (n / (6 * effects)).clamp(2, 8);
    let fixed = none + alone * effects;
    ensure!(
        fixed <= n,
        "{n} samples are too few to switch {effects} effects on and off; draw at least {}",
        least_switched(effects)
    );
    let mixed = n - fixed;
    // The runs with none and with one effect lack some of the half that each effect is to be on in.
    let on = (n / 2).saturating_sub(alone).min(mixed);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut rows = vec![vec![false; effects]; n];
    for (effect, run) in
        (0..effects).flat_map(|effect| (0..alone).map(move |k| (effect, none + effect * alone + k)))
    {
        rows[run][effect] = true;
    }
    for effect in 0..effects {
        let mut share: Vec<bool> = (0..mixed).map(|i| i < on).collect();
        share.shuffle(&mut rng);
        for (row, on) in rows[fixed..].iter_mut().zip(share) {
            row[effect] = on;
        }
    }
    rows.shuffle(&mut rng);
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auto_is_ten_d_ln_d_and_at_least_ten() {
        assert_eq!([1, 2, 4, 7].map(auto_count), [10, 14, 56, 137]);
    }

    #[test]
    fn switch_designs_are_balanced_and_hold_every_single_effect() {
        for (n, effects) in [(240, 5), (60, 3), (20, 2), (100, 1), (37, 4)] {
            let rows = switches(n, effects, 7).unwrap();
            assert_eq!(rows.len(), n);
            assert!(rows.iter().filter(|row| !row.contains(&true)).count() * 6 >= n);
            for effect in 0..effects {
                let on = rows.iter().filter(|row| row[effect]).count();
                let alone = rows
                    .iter()
                    .filter(|row| row[effect] && row.iter().filter(|on| **on).count() == 1)
                    .count();
                assert!(alone >= 2, "{n} {effects}");
                assert!(on.abs_diff(n / 2) <= n / 6, "{n} {effects}: {on} on");
            }
        }
        assert!(switches(4, 3, 0).unwrap_err().to_string().contains("at least"));
    }
}

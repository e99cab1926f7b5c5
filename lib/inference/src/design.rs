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
    /// Each is on or off, in every combination.
    Switch,
    /// None, one or two of them are on: what attribution wants, whose hypotheses hold no more.
    Pairs,
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
        Effects::Switch | Effects::Pairs => prior.effects(),
        Effects::On(names) => prior.select_effects(names)?,
    };
    ensure!(
        !matches!(effects, Effects::Switch | Effects::Pairs) || !on.is_empty(),
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
/// If an effect is named that there is not, nothing varies, or `n` is too small to switch effects on and off.
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
    let all = prior.effects();
    let switched = match effects {
        Effects::Switch => switches(n, all.len(), seed)?,
        Effects::Pairs => pairs(n, all.len(), seed)?,
        Effects::None | Effects::On(_) => Vec::new(),
    };
    for (sample, on) in samples.iter_mut().zip(switched) {
        for (effect, _) in all.iter().zip(on).filter(|(_, on)| !on) {
            switch_off(prior, effect, sample);
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
    ensure_switched(n, effects)?;
    let none = n.div_ceil(6);
    let alone = (n / (6 * effects)).clamp(2, 8);
    let fixed = none + alone * effects;
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

/// Which effects are on in each of `n` runs, shape (n, effects): none in one run in six, a single one in half of the runs, two in the
/// others; of many effects each combination of two as often as any.
///
/// With each in half of the runs (see [`switches`]) a design of seven effects has three to six of them in most of its runs, of which
/// no hypothesis asks; where effects do not add up, such runs say little of one of them alone.
///
/// # Errors
/// If `n` is too small to hold these.
pub fn pairs(n: usize, effects: usize, seed: u64) -> Result<Vec<Vec<bool>>> {
    ensure_switched(n, effects)?;
    let none = n.div_ceil(6);
    let two = if effects > 1 { (n / 3).min(n - none - 2 * effects) } else { 0 };
    let one = n - none - two;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut couples: Vec<Vec<usize>> =
        (0..effects).flat_map(|a| (a + 1..effects).map(move |b| vec![a, b])).collect();
    couples.shuffle(&mut random);
    let nothing = std::iter::repeat_n(Vec::new(), none);
    let single = (0..effects).map(|effect| vec![effect]).cycle().take(one);
    let mut sets: Vec<Vec<usize>> =
        nothing.chain(single).chain(couples.into_iter().cycle().take(two)).collect();
    sets.shuffle(&mut random);
    Ok(sets.iter().map(|on| (0..effects).map(|effect| on.contains(&effect)).collect()).collect())
}

/// That so many samples are enough to switch effects on and off.
fn ensure_switched(n: usize, effects: usize) -> Result<()> {
    let least = least_switched(effects);
    ensure!(
        n >= least,
        "{n} samples are too few to switch {effects} effects on and off; draw at least {least}"
    );
    Ok(())
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
        assert!(pairs(4, 3, 0).unwrap_err().to_string().contains("at least"));
        assert!(switches(4, 3, 0).unwrap_err().to_string().contains("at least"));
    }

    #[test]
    fn pairs_hold_no_more_than_two_effects_and_each_of_them_as_often_as_the_others() {
        for (n, effects) in [(240, 5), (110, 7), (60, 3), (20, 2), (12, 1), (least_switched(4), 4)] {
            let rows = pairs(n, effects, 7).unwrap();
            let of =
                |count: usize| rows.iter().filter(move |row| row.iter().filter(|on| **on).count() == count);
            assert_eq!(of(0).count() + of(1).count() + of(2).count(), n);
            assert_eq!(of(0).count(), n.div_ceil(6));
            let alone: Vec<usize> =
                (0..effects).map(|effect| of(1).filter(|row| row[effect]).count()).collect();
            let (least, most) = (alone.iter().min().unwrap(), alone.iter().max().unwrap());
            assert!(*least >= 2 && most - least <= 1, "{n} {effects}: {alone:?}");
            assert!(effects == 1 || of(2).count() > 0, "{n} {effects}");
        }
    }
}

//! What may be otherwise than a diagnosis assumes: the noise that was stated, the form of an effect, the
//! prior, what else the measurement has in it.

use anyhow::{Context, Result, bail};
use gl_gap::attribute::evidence::mode::standard_normal;
use gl_inference::path;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// One thing that is otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// Nothing is.
    AsStated,
    /// The stated noise is so many times the true one.
    Noise(f64),
    /// No noise is stated.
    Unstated,
    /// The noise of a reading has this correlation with that of the one before, and is stated as white.
    Correlated(f64),
    /// The noise is Student's t with three degrees of freedom, of the stated standard deviation.
    HeavyTails,
    /// Two readings of each observable are off by eight standard deviations.
    Outliers,
    /// A smooth curve that nothing explains, so many times the noise in root mean square.
    Remainder(f64),
    /// The effect has another functional form than the candidate of its name.
    OtherForm,
    /// A base parameter lies outside its prior.
    Outside,
    /// The effect is stronger than its upper bound by six tenths.
    Beyond,
    /// Five further candidates change nothing.
    Idle,
    /// The first observable alone is measured.
    OneObservable,
    /// Ten steps.
    TenSteps,
}

impl Condition {
    /// All of them, by name.
    pub const NAMES: [&str; 19] = [
        "as-stated",
        "noise-0.5",
        "noise-0.85",
        "noise-2",
        "noise-5",
        "unstated",
        "correlated-0.5",
        "correlated-0.9",
        "heavy-tails",
        "outliers",
        "remainder-1",
        "remainder-2",
        "remainder-4",
        "other-form",
        "outside",
        "beyond",
        "idle",
        "one-observable",
        "ten-steps",
    ];

    /// What is otherwise, in words.
    pub fn told(self) -> String {
        match self {
            Self::AsStated => "as stated".to_owned(),
            Self::Noise(times) => format!("a noise stated {times} times the true one"),
            Self::Unstated => "no noise stated".to_owned(),
            Self::Correlated(phi) => format!("noise correlated by {phi}, stated as white"),
            Self::HeavyTails => "noise of Student's t, 3 degrees of freedom".to_owned(),
            Self::Outliers => "two readings an observable off by 8 sd".to_owned(),
            Self::Remainder(times) => format!("a smooth remainder of {times} times the noise"),
            Self::OtherForm => "an effect of another form".to_owned(),
            Self::Outside => "a base parameter outside its prior".to_owned(),
            Self::Beyond => "an effect 1.6 times its upper bound".to_owned(),
            Self::Idle => "five more candidates that cannot show".to_owned(),
            Self::OneObservable => "one observable alone".to_owned(),
            Self::TenSteps => "ten readings an observable".to_owned(),
        }
    }

    /// A condition by name; a number follows the last hyphen where there is one.
    ///
    /// # Errors
    /// If there is none of that name.
    pub fn named(name: &str) -> Result<Self> {
        let number = |prefix: &str| -> Option<Result<f64>> {
            let number = name.strip_prefix(prefix)?;
            Some(number.parse().with_context(|| format!("{name}: {number:?} is not a number")))
        };
        Ok(match name {
            "as-stated" => Self::AsStated,
            "unstated" => Self::Unstated,
            "heavy-tails" => Self::HeavyTails,
            "outliers" => Self::Outliers,
            "other-form" => Self::OtherForm,
            "outside" => Self::Outside,
            "beyond" => Self::Beyond,
            "idle" => Self::Idle,
            "one-observable" => Self::OneObservable,
            "ten-steps" => Self::TenSteps,
            _ => {
                if let Some(times) = number("noise-") {
                    Self::Noise(times?)
                } else if let Some(phi) = number("correlated-") {
                    Self::Correlated(phi?)
                } else if let Some(times) = number("remainder-") {
                    Self::Remainder(times?)
                } else {
                    bail!("no condition {name}; they are {}", Self::NAMES.join(", "))
                }
            }
        })
    }

    /// The noise of one observable of this standard deviation, shape (steps,).
    pub fn noise(self, sd: f64, steps: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
        let white: Vec<f64> = (0..steps).map(|_| standard_normal(random)).collect();
        let unit = match self {
            Self::Correlated(phi) => white
                .iter()
                .scan(None, |before: &mut Option<f64>, w| {
                    let now = before.map_or(*w, |before| phi * before + (1.0 - phi * phi).sqrt() * w);
                    *before = Some(now);
                    Some(now)
                })
                .collect(),
            Self::HeavyTails => white
                .iter()
                .map(|w| {
                    let square: f64 = (0..3).map(|_| standard_normal(random).powi(2)).sum();
                    // Of variance 3 otherwise.
                    w / square.sqrt()
                })
                .collect(),
            Self::Outliers => {
                let mut unit = white;
                for at in rand::seq::index::sample(random, steps, 2) {
                    unit[at] += if random.random() { 8.0 } else { -8.0 };
                }
                unit
            }
            _ => white,
        };
        unit.iter().map(|unit| sd * unit).collect()
    }

    /// Steps at which a noise of this standard deviation, shape (steps,), is far off, of which no gap is made.
    pub fn outliers(self, sd: f64, noise: &[f64]) -> Vec<usize> {
        let is_far = |&step: &usize| self == Self::Outliers && noise[step].abs() > 4.5 * sd;
        (0..noise.len()).filter(is_far).collect()
    }

    /// What is added to one observable of this noise along a path, shape (steps,).
    pub fn remainder(self, control: &[f64], sd: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
        let Self::Remainder(times) = self else { return vec![0.0; control.len()] };
        let places = path::Path::new(control).places();
        let waves: Vec<(f64, f64, f64)> = (0..3)
            .map(|_| {
                let turns = random.random_range(0.2..2.0);
                (standard_normal(random), turns, random.random_range(0.0..std::f64::consts::TAU))
            })
            .collect();
        let at = |place: &f64| -> f64 {
            waves.iter().map(|(a, n, phase)| a * (std::f64::consts::TAU * n * place + phase).sin()).sum()
        };
        let curve: Vec<f64> = places.iter().map(at).collect();
        let rms = (curve.iter().map(|y| y * y).sum::<f64>() / curve.len() as f64).sqrt();
        curve.iter().map(|y| times * sd * y / rms).collect()
    }

    /// What an effect adds to one observable, in another form, shape (steps,).
    pub fn another_form(self, added: &[f64], control: &[f64], random: &mut ChaCha8Rng) -> Vec<f64> {
        if self != Self::OtherForm {
            return added.to_vec();
        }
        let (is_power, phase) = (random.random::<bool>(), random.random_range(0.0..std::f64::consts::TAU));
        let highest = added.iter().fold(0.0, |high: f64, y| high.max(y.abs())).max(f64::MIN_POSITIVE);
        let places = path::Path::new(control).places();
        let form = |(y, place): (&f64, &f64)| {
            if is_power {
                y * (y.abs() / highest).powf(0.4) * 1.2
            } else {
                y * (1.0 + 0.33 * (std::f64::consts::TAU * place + phase).sin())
            }
        };
        added.iter().zip(&places).map(form).collect()
    }
}

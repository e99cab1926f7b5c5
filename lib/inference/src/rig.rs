//! Errors of the rig: what a measurement has, and no run.
//!
//! They are added to a run, which then is what the rig would have recorded of it; the measurement stays as it is.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use anyhow::{Context, Error, Result, bail, ensure};

use crate::ensemble::Ensemble;
use crate::observations::Observations;
use crate::path::Path;

/// How a measurement may be at fault, in the order in which a rig does it: the control is moved first, readings are
/// changed after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// The rig gives way under load: since its last turn the specimen has moved by the way of the control less a part
    /// proportional to what the first observable, which is taken for the load, has changed by. In units of the control per unit
    /// of load.
    Compliance,
    /// The observables are recorded late: they belong to an earlier control value. In units of the control.
    Lag,
    /// An observable multiplied by 1 + gain.
    Gain,
    /// An error of an observable that grows evenly along the way travelled; as it is at the end, in units of the observable.
    Drift,
    /// A constant added to an observable, in its units.
    Offset,
}

impl FromStr for Kind {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        Self::ALL.into_iter().find(|kind| kind.word() == text).with_context(|| {
            format!(
                "{text:?} is no effect of the measurement; they are {}",
                Self::ALL.map(Self::word).join(", ")
            )
        })
    }
}

impl Kind {
    /// All of them, the plainest first.
    pub const ALL: [Self; 5] = [Self::Offset, Self::Gain, Self::Drift, Self::Compliance, Self::Lag];

    /// What it is called.
    pub fn word(self) -> &'static str {
        match self {
            Self::Offset => "offset",
            Self::Gain => "gain",
            Self::Drift => "drift",
            Self::Compliance => "compliance",
            Self::Lag => "lag",
        }
    }

    /// Whether it moves the control, not an observable.
    pub fn is_of_control(self) -> bool {
        matches!(self, Self::Compliance | Self::Lag)
    }

    /// Add it to a curve.
    ///
    /// * `size` — in the units of this kind.
    /// * `observable` — the one that it acts on; for a compliance the load; of no meaning for a lag.
    /// * `curve` — shape (observables · steps).
    pub fn apply(self, size: f64, observable: usize, path: &Path, curve: &mut [f64]) {
        let steps = path.control().len();
        let own = observable * steps..(observable + 1) * steps;
        match self {
            Self::Offset => curve[own].iter_mut().for_each(|y| *y += size),
            Self::Gain => curve[own].iter_mut().for_each(|y| *y *= 1.0 + size),
            Self::Drift => {
                for (y, travelled) in curve[own].iter_mut().zip(path.travelled()) {
                    *y += size * travelled;
                }
            }
            Self::Compliance => give_way(size, observable, path, curve),
            Self::Lag => {
                for observable in curve.chunks_exact_mut(steps) {
                    let seen = path.delayed(observable, size);
                    observable.copy_from_slice(&seen);
                }
            }
        }
    }
}

/// What is recorded where the rig gives way by `compliance` per unit of load, from the curves of a stiff one, shape (observables ·
/// steps).
///
/// Its load is that which the specimen bears where it is. A specimen that is turned earlier unloads from less: it takes the
/// branch of the stiff rig from where that bears as much as it does. So one whose load is the same on either branch goes back as
/// it came, and one that yields unloads from its turn, with its own stiffness and the rig's. What an observable differs by there
/// it keeps along the branch.
fn give_way(compliance: f64, load: usize, path: &Path, curve: &mut [f64]) {
    let control = path.steady();
    let steps = control.len();
    let stiff = curve.to_vec();
    let mut place = control.first().copied().unwrap_or(0.0);
    for branch in path.branches() {
        let on = |observable: usize, at: f64| {
            path.on(&branch, &stiff[observable * steps..(observable + 1) * steps], at)
        };
        let turn = branch.start;
        let turned: Vec<f64> = curve.iter().skip(turn).step_by(steps).copied().collect();
        let begin = where_it_bears(turned[load], |at| on(load, at), (control[turn], place, turn));
        let apart: Vec<f64> = turned.iter().enumerate().map(|(j, y)| y - on(j, begin)).collect();
        place = begin;
        for step in turn + 1..branch.end {
            let way = begin + control[step] - control[turn];
            // With what happens while the control stands still.
            let still = |j: usize| stiff[j * steps + step] - on(j, control[step]);
            let beside: Vec<f64> = apart.iter().enumerate().map(|(j, apart)| apart + still(j)).collect();
            let left = |at: f64| at - way + compliance * (on(load, at) + beside[load] - turned[load]);
            place = root(left, place + control[step] - control[step - 1], path.range());
            for (j, beside) in beside.iter().enumerate() {
                curve[j * steps + step] = on(j, place) + beside;
            }
        }
    }
}

/// Where a branch bears this load, between where the control has turned and where the specimen has; at that end which bears
/// nearly as much, where it bears it nowhere.
fn where_it_bears(load: f64, on: impl Fn(f64) -> f64, (control, specimen, turn): (f64, f64, usize)) -> f64 {
    /// Halvings of the way between the two.
    const HALVINGS: usize = 50;
    // The specimen is behind the control, and so ahead of it on the way back.
    let [mut near, mut far] = [control, if turn == 0 { control } else { specimen }];
    let over = |at: f64| on(at) - load;
    let (at_near, at_far) = (over(near), over(far));
    if at_near * at_far > 0.0 {
        return if at_near.abs() <= at_far.abs() { near } else { far };
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (near + far);
        if over(middle) * at_near > 0.0 { near = middle } else { far = middle }
    }
    0.5 * (near + far)
}

/// Where a function that rises with slopes of about 1 or more is zero, by Newton's method from nearby; within the range of it
/// where it falls, as under a load that the control takes away faster than the rig can follow.
fn root(of: impl Fn(f64) -> f64, from: f64, range: f64) -> f64 {
    /// Differences that slopes are taken by, and how near is near enough, as shares of the range.
    const STEP: f64 = 1e-5;
    const NEAR: f64 = 1e-10;
    /// A specimen that softens faster than this lets no control go on.
    const LEAST_SLOPE: f64 = 0.2;
    let mut at = from;
    for _ in 0..30 {
        let (value, ahead) = (of(at), of(at + STEP * range));
        let away = value / ((ahead - value) / (STEP * range)).max(LEAST_SLOPE);
        if !away.is_finite() {
            break;
        }
        at = (at - away).clamp(from - range, from + range);
        if away.abs() <= NEAR * range {
            break;
        }
    }
    at
}

/// Which error it is: its kind, and what it acts on; empty for an error of the control.
type Which = (Kind, String);

/// The errors of the rig of one test, each with its size in the units of its kind, as in `offset(q)=0.3,lag=0.02`.
///
/// ```
/// let rig: gl_inference::rig::Rig = "offset(q)=0.3,lag=0.02".parse().unwrap();
/// assert_eq!(rig.to_string(), "lag=0.02,offset(q)=0.3");
/// assert!("offset=0.3".parse::<gl_inference::rig::Rig>().is_err());
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig(BTreeMap<Which, f64>);

impl FromStr for Rig {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let mut rig = Self::default();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (name, size) = part
                .rsplit_once('=')
                .with_context(|| format!("{part:?} is not ERROR=SIZE, such as offset(q)=0.3 or lag=0.02"))?;
            let size = size.trim().parse().with_context(|| format!("{part:?}: {size:?} is no number"))?;
            rig.add(name.trim(), size)?;
        }
        Ok(rig)
    }
}

impl fmt::Display for Rig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, (name, size)) in self.errors().enumerate() {
            let comma = if place > 0 { "," } else { "" };
            write!(f, "{comma}{name}={size}")?;
        }
        Ok(())
    }
}

impl Rig {
    /// Add an error by its name, `offset(q)` or `lag`; one that is there already becomes so much larger.
    ///
    /// # Errors
    /// If there is no such kind of error, the size is not finite, or it is not said, or said in vain, what it acts on.
    pub fn add(&mut self, name: &str, size: f64) -> Result<()> {
        let (kind, of) = match name.strip_suffix(')').and_then(|name| name.split_once('(')) {
            Some((kind, of)) => (kind.parse::<Kind>()?, of.trim()),
            None => (name.parse::<Kind>()?, ""),
        };
        ensure!(size.is_finite(), "{name}={size}: give a number");
        let word = kind.word();
        if kind.is_of_control() {
            ensure!(of.is_empty(), "{name}: a {word} is of all observables; give {word}=SIZE");
        } else {
            ensure!(!of.is_empty(), "{name}: of which observable? Give {word}(OBSERVABLE)=SIZE");
        }
        *self.0.entry((kind, of.to_owned())).or_default() += size;
        Ok(())
    }

    /// Add an error of a case to the rig of one of its tests, by the name that it has in the case; says whether it is of that
    /// test.
    ///
    /// # Errors
    /// As of [`Rig::add`].
    pub fn add_if_of(&mut self, test: &str, name: &str, size: f64) -> Result<bool> {
        match own_name(name, test) {
            Some(own) => self.add(&own, size).map(|()| true),
            None => Ok(false),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The observables that errors are of.
    pub fn observables(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(|(_, of)| of.as_str()).filter(|of| !of.is_empty())
    }

    /// Names and sizes, in the order in which a rig does them.
    pub fn errors(&self) -> impl Iterator<Item = (String, f64)> {
        self.0.iter().map(|((kind, of), size)| {
            let word = kind.word();
            (if of.is_empty() { word.to_owned() } else { format!("{word}({of})") }, *size)
        })
    }

    /// The errors at the steps of a measurement.
    ///
    /// # Errors
    /// If one is of an observable that there is not.
    pub fn at(&self, observations: &Observations) -> Result<RigAt> {
        let names = &observations.names;
        let place = |((kind, of), size): (&Which, &f64)| {
            let place = if of.is_empty() { Some(0) } else { names.iter().position(|name| name == of) };
            match place {
                Some(place) => Ok((*kind, place, *size)),
                None => bail!("{}({of}): no observable {of}; they are {}", kind.word(), names.join(", ")),
            }
        };
        let errors = self.0.iter().map(place).collect::<Result<_>>()?;
        Ok(RigAt { errors, path: Path::new(&observations.control) })
    }
}

/// The name of an error in its own test: that of `offset(tx100.q)` is `offset(q)` in the test tx100, that of `lag(tx100)` is
/// `lag`; none in another test. Where tests have no names it is the same.
fn own_name(error: &str, test: &str) -> Option<String> {
    if test.is_empty() {
        return Some(error.to_owned());
    }
    let (kind, of) = error.strip_suffix(')')?.split_once('(')?;
    match of.split_once('.') {
        Some((named, of)) => (named == test).then(|| format!("{kind}({of})")),
        None => (of == test).then(|| kind.to_owned()),
    }
}

/// [`Rig`] at the steps of a measurement.
#[derive(Clone, Debug)]
pub struct RigAt {
    errors: Vec<(Kind, usize, f64)>,
    path: Path,
}

impl RigAt {
    /// Curves as the rig would have recorded them, shape (observables, steps).
    pub fn recorded(&self, curves: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        if self.errors.is_empty() {
            return curves;
        }
        let mut all = curves.concat();
        for &(kind, observable, size) in &self.errors {
            kind.apply(size, observable, &self.path, &mut all);
        }
        all.chunks(self.path.control().len().max(1)).map(<[f64]>::to_vec).collect()
    }

    /// The runs as the rig would have recorded them.
    pub fn recorded_runs(&self, observations: &Observations, runs: &Ensemble) -> Ensemble {
        let mut recorded = Ensemble::new(observations, false);
        for (run, name) in runs.samples.iter().enumerate() {
            recorded.push(name, &self.recorded(runs.curves(run)), None);
        }
        recorded
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_rig_gives_way_within_its_range_under_a_load_that_falls_faster_than_it_follows() {
        let path = Path::new(&(0..20).map(f64::from).collect::<Vec<_>>());
        for compliance in [0.01, 0.3, 2.0, 50.0] {
            let mut curve: Vec<f64> = (0..20).map(|t| 100.0 * (-0.5 * f64::from(t)).exp()).collect();
            Kind::Compliance.apply(compliance, 0, &path, &mut curve);
            assert!(curve.iter().all(|y| y.abs() <= 150.0), "{compliance}: {curve:?}");
        }
    }

    #[test]
    fn a_control_that_jitters_or_stands_still_turns_nothing() {
        // Out to 1 and back, with a load that relaxes where the control stands still at 0.5.
        let control = |t: i32| 0.01 * f64::from((100 - (t - 100).abs()).min(if t < 70 { 50 } else { 100 }));
        let ways: Vec<f64> = (0..=150).map(control).collect();
        let shaken: Vec<f64> =
            ways.iter().enumerate().map(|(t, x)| x + if t % 3 == 1 { -2e-4 } else { 2e-4 }).collect();
        let load: Vec<f64> =
            (0..=150).map(|t| 10.0 * control(t).sqrt() - 0.02 * f64::from((t - 50).clamp(0, 20))).collect();
        let recorded = |kind: Kind, size: f64, control: &[f64]| {
            let mut curve = load.clone();
            kind.apply(size, 0, &Path::new(control), &mut curve);
            curve
        };
        for kind in [Kind::Compliance, Kind::Lag] {
            for control in [&ways, &shaken] {
                let same = recorded(kind, 0.0, control);
                assert!(same.iter().zip(&load).all(|(a, b)| (a - b).abs() < 1e-6), "{kind:?}: {same:?}");
            }
            let (still, shaken) = (recorded(kind, 0.02, &ways), recorded(kind, 0.02, &shaken));
            let apart = still.iter().zip(&shaken).map(|(a, b)| (a - b).abs()).skip(5).fold(0.0, f64::max);
            assert!(apart < 0.05, "{kind:?}: {apart}");
        }
    }

    /// A measurement at the steps 0, 1 and 2 of the control.
    fn measured(observables: &[&str]) -> Observations {
        Observations {
            source: "obs".to_owned(),
            control_name: "x".to_owned(),
            control: vec![0.0, 1.0, 2.0],
            names: observables.iter().map(|&name| name.to_owned()).collect(),
            values: vec![vec![0.0; 3]; observables.len()],
            far_off: Vec::new(),
            sd: vec![None; observables.len()],
        }
    }

    fn recorded(rig: &str, curves: [&[f64]; 2]) -> Vec<Vec<f64>> {
        let rig: Rig = rig.parse().unwrap();
        rig.at(&measured(&["f", "g"])).unwrap().recorded(curves.map(<[f64]>::to_vec).to_vec())
    }

    #[test]
    fn each_error_does_to_a_run_what_it_does_to_a_measurement() {
        let curves: [&[f64]; 2] = [&[0.0, 2.0, 4.0], &[1.0, 1.0, 3.0]];
        for (rig, f, g) in [
            ("", [0.0, 2.0, 4.0], [1.0, 1.0, 3.0]),
            ("offset(g)=0.5", [0.0, 2.0, 4.0], [1.5, 1.5, 3.5]),
            ("gain(f)=0.1", [0.0, 2.2, 4.4], [1.0, 1.0, 3.0]),
            ("drift(f)=1", [0.0, 2.5, 5.0], [1.0, 1.0, 3.0]),
            // Recorded one step late; before the test began there is what it began with.
            ("lag=1", [0.0, 0.0, 2.0], [1.0, 1.0, 1.0]),
            // Two springs in series; at the load 4/3 the specimen has come to 2/3, between two steps.
            ("compliance=0.25", [0.0, 4.0 / 3.0, 8.0 / 3.0], [1.0, 23.0 / 27.0, 41.0 / 27.0]),
            // What a gain multiplies has no offset yet.
            ("offset(f)=1,gain(f)=0.1", [1.0, 3.2, 5.4], [1.0, 1.0, 3.0]),
        ] {
            let recorded = recorded(rig, curves);
            for (got, expected) in recorded.concat().iter().zip([f, g].concat()) {
                assert!((got - expected).abs() < 1e-12, "{rig}: {recorded:?}");
            }
        }
    }

    /// The load of a specimen that goes along these ways, at each step.
    fn loaded(ways: &[f64], bears: &mut dyn FnMut(f64) -> f64) -> Vec<f64> {
        ways.iter().map(|&x| bears(x)).collect()
    }

    /// An elastic, perfectly plastic bar of stiffness 100 that yields at 10.
    fn bar() -> impl FnMut(f64) -> f64 {
        let mut plastic = 0.0;
        move |x| {
            let load: f64 = 100.0 * (x - plastic);
            plastic += (load.abs() - 10.0).max(0.0).copysign(load) / 100.0;
            load.clamp(-10.0, 10.0)
        }
    }

    /// Out to 1 and back to 0.5, in steps of a hundredth.
    fn out_and_back() -> Vec<f64> {
        (0..=150).map(|t| 0.01 * f64::from(if t <= 100 { t } else { 200 - t })).collect()
    }

    /// What a rig records of a load and of twice the way, from what a stiff one records, and the specimen's ways in it.
    fn recorded_by(compliance: f64, load: &[f64], ways: &[f64]) -> Vec<f64> {
        let mut curve = load.to_vec();
        curve.extend(ways.iter().map(|x| 2.0 * x));
        Kind::Compliance.apply(compliance, 0, &Path::new(ways), &mut curve);
        curve
    }

    #[test]
    fn a_bar_that_has_yielded_unloads_from_its_turn_with_its_stiffness_and_the_rigs() {
        let (ways, compliance) = (out_and_back(), 0.02);
        let recorded = recorded_by(compliance, &loaded(&ways, &mut bar()), &ways);
        // Bar and rig together are a bar of stiffness 100 / (1 + 0.02 · 100), which yields at 10, too.
        let mut plastic = 0.0;
        for (t, u) in ways.iter().enumerate() {
            let trial: f64 = 100.0 / 3.0 * (u - plastic);
            plastic += (trial.abs() - 10.0).max(0.0).copysign(trial) / (100.0 / 3.0);
            let load = trial.clamp(-10.0, 10.0);
            // The corner is rounded between two steps.
            assert!((recorded[t] - load).abs() < 0.2, "at {u}: {} is not {load}", recorded[t]);
            let of_the_specimen = 2.0 * (u - compliance * load);
            assert!((recorded[ways.len() + t] - of_the_specimen).abs() < 0.02, "at {u}");
        }
    }

    #[test]
    fn a_spring_of_any_form_goes_back_as_it_came() {
        let (ways, compliance) = (out_and_back(), 0.03);
        let spring = |x: f64| 20.0 * x.max(0.0).powf(1.5);
        let recorded = recorded_by(compliance, &loaded(&ways, &mut |x| spring(x)), &ways);
        for (t, u) in ways.iter().enumerate() {
            // u = x + c · load(x)
            let mut x = *u;
            for _ in 0..60 {
                x -= (x + compliance * spring(x) - u) / (1.0 + compliance * 30.0 * x.max(0.0).sqrt());
            }
            // The run has come back to 0.5 and no further: beyond that a straight line stands for it.
            let is_known = t <= 100 || x >= 0.5;
            assert!(
                !is_known || (recorded[t] - spring(x)).abs() < 2e-3,
                "step {t}: {} is not {}",
                recorded[t],
                spring(x)
            );
            assert!(!is_known || (recorded[ways.len() + t] - 2.0 * x).abs() < 1e-3, "step {t}");
        }
    }

    #[test]
    fn what_is_no_error_of_the_rig_is_refused_with_what_would_be_right() {
        let said = |text: &str| format!("{:#}", text.parse::<Rig>().unwrap_err());
        assert!(said("offset").contains("is not ERROR=SIZE, such as offset(q)=0.3"));
        assert!(said("tilt(q)=1").contains("they are offset, gain, drift, compliance, lag"));
        assert_eq!(said("lag(q)=1"), "lag(q): a lag is of all observables; give lag=SIZE");
        assert_eq!(said("gain=1"), "gain: of which observable? Give gain(OBSERVABLE)=SIZE");
        assert!(said("gain(q)=x").contains("\"x\" is no number"));
        assert!(said("gain(q)=inf").contains("give a number"));
        let error = "offset(q)=1".parse::<Rig>().unwrap().at(&measured(&["f"])).unwrap_err();
        assert_eq!(error.to_string(), "offset(q): no observable q; they are f");
    }

    #[test]
    fn an_error_of_a_test_is_called_as_in_a_case_of_that_test_alone() {
        for (error, test, own) in [
            ("offset(tx100.q)", "tx100", Some("offset(q)")),
            ("offset(tx100.q)", "tx10", None),
            ("lag(tx100)", "tx100", Some("lag")),
            ("lag(tx100)", "tx10", None),
            ("lag", "tx10", None),
            ("offset(q)", "", Some("offset(q)")),
        ] {
            assert_eq!(own_name(error, test).as_deref(), own, "{error} in {test}");
        }
    }

    #[test]
    fn an_error_that_is_there_twice_is_as_large_as_both() {
        assert_eq!("offset(q)=1,offset(q)=0.5".parse::<Rig>().unwrap().to_string(), "offset(q)=1.5");
    }
}

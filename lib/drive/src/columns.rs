use std::path::{Path, PathBuf};

use anyhow::Result;
use gl_case::{Case, Posterior, Test};
use gl_inference::design::{batch_runs, first_runs};
use gl_inference::observations::ByName;
use gl_inference::prior::Prior;
use gl_inference::samples::Samples;

use crate::calibrate::emulated::of_test_or_none;
use crate::step::Call;

/// What is compared with what, as all tools take it: `-b OBS -c CONTROL -v OBSERVABLES`, and the noise.
pub(crate) fn measurement(call: Call, test: &Test) -> Call {
    call.flag("-b", &test.obs)
        .flag("-c", &test.control.measured)
        .flag("-v", test.observable_names().join(","))
        .option("--noise", given(&test.noise))
}

/// All tests of a case as `gl-posterior` takes them: `-b -c -v` of a single one, else `--test` for each; with how runs are
/// weighed against them.
pub(crate) fn all_tests(call: Call, case: &Case) -> Call {
    if !case.has_tests() {
        return comparison(call, &case.tests[0]);
    }
    let call = measured(call, case, Which::Compared);
    let weights: ByName = case
        .tests
        .iter()
        .flat_map(|test| test.weights.iter().map(|(name, weight)| (test.named(name), weight)))
        .collect();
    call.option("--scale", case.tests[0].scale.as_ref()).option("--weights", given(&weights))
}

/// Which steps of a measurement are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    /// All of them.
    All,
    /// Those that calibration sees.
    Compared,
}

/// The measurement of a case: `-b -c -v` and the noise of a single one, else `--test` for each.
pub(crate) fn measured(call: Call, case: &Case, which: Which) -> Call {
    let steps = |test: &Test| test.steps.clone().filter(|_| which == Which::Compared);
    if !case.has_tests() {
        return measurement(call, &case.tests[0]).option("--steps", steps(&case.tests[0]));
    }
    case.tests.iter().fold(call, |call, test| {
        let noise = &test.noise;
        let columns = test.observable_names().join(",");
        let mut word = std::ffi::OsString::from(format!("{}:", test.name));
        word.push(&test.obs);
        word.push(format!(":{}:{columns}:{noise}", test.control.measured));
        if let Some(steps) = steps(test) {
            word.push(format!(":{steps}"));
        }
        call.flag("--test", word)
    })
}

/// The units of a case, as tools take them.
pub(crate) fn units(case: &Case) -> Option<String> {
    list(&case.units.iter().map(|(name, unit)| format!("{name}={unit}")).collect::<Vec<_>>())
}

/// The ensemble of each test in a folder, as tools take them.
pub(crate) fn ensembles(case: &Case, folder: &Path) -> Vec<std::ffi::OsString> {
    let of = |test: &Test| of_test(test, &folder.join(of_test_or_none("ensemble", test, "")));
    case.tests.iter().map(of).collect()
}

/// The folder of a test in another; the same where the case is one test.
pub(crate) fn within(folder: &Path, test: &Test) -> PathBuf {
    if test.name.is_empty() { folder.to_owned() } else { folder.join(&test.name) }
}

/// A table of a test, as tools take it: `NAME=FILE` where tests have names.
pub(crate) fn of_test(test: &Test, file: &Path) -> std::ffi::OsString {
    let mut word = std::ffi::OsString::new();
    if !test.name.is_empty() {
        word.push(format!("{}=", test.name));
    }
    word.push(file);
    word
}

/// The same for `gl-collect`, with what the runs call the columns, and what the rig makes of them.
pub(crate) fn simulated(call: Call, test: &Test) -> Call {
    let observables: Vec<String> = test.observables.iter().map(gl_case::Column::renamed).collect();
    let rig = Some(test.rig.to_string()).filter(|rig| !rig.is_empty());
    let call = call.flag("-b", &test.obs).flag("-c", test.control.renamed());
    call.flag("-v", observables.join(",")).option("--rig", rig)
}

/// How runs are weighed against the measurement.
pub(crate) fn comparison(call: Call, test: &Test) -> Call {
    measurement(call, test)
        .option("--scale", test.scale.as_ref())
        .option("--weights", given(&test.weights))
        .option("--steps", test.steps.as_ref())
}

/// `f=0.005,t=0.001`, if anything is given.
fn given(numbers: &ByName) -> Option<String> {
    (!numbers.is_empty()).then(|| numbers.to_string())
}

/// A list with commas, if anything is in it.
pub(crate) fn list(names: &[String]) -> Option<String> {
    (!names.is_empty()).then(|| names.join(","))
}

/// How many parameters vary in a table of samples.
pub(crate) fn varied_in(samples: &Path) -> Result<(usize, usize)> {
    let samples = Samples::read(samples)?;
    let varies = |j: &usize| samples.values.iter().any(|row| row[*j] != samples.values[0][*j]);
    Ok((samples.len(), (0..samples.parameters.len()).filter(varies).count()))
}

/// How many parameters vary when these effects are in.
pub(crate) fn varied(prior: &Prior, effects: &[String]) -> usize {
    let is_in = |effect: &Option<String>| effect.as_ref().is_none_or(|effect| effects.contains(effect));
    prior.parameters().iter().filter(|parameter| is_in(&parameter.effect)).count()
}

/// Runs of an iteration: as the case says. Else, through an emulator, a few a parameter in the first one and small
/// batches after it; by weights, ten a parameter and ten more.
pub(crate) fn runs_of_iteration(case: &Case, prior: &Prior, number: usize) -> usize {
    let parameters = varied(prior, &case.effects);
    case.num.unwrap_or_else(|| match (case.posterior, number) {
        (Posterior::Emulator, 0) => first_runs(parameters),
        (Posterior::Emulator, _) => batch_runs(parameters),
        _ => weighed_runs(parameters),
    })
}

/// Runs of an iteration by weights, where the case says nothing.
pub(crate) fn weighed_runs(parameters: usize) -> usize {
    10 * (parameters + 1)
}

/// Runs of a design in all: as the case says, else 25 for each parameter, those of effects too.
pub(crate) fn runs_of_design(case: &Case, prior: &Prior) -> usize {
    case.design_num.unwrap_or(25 * prior.parameters().len())
}

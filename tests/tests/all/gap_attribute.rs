//! gl-gap-attribute from its tables to its verdict: what is found, and what is refused.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use gl_inference::design::{self, Effects};
use gl_inference::prior::Prior;
use gl_inference::samples::{Samples, sample_names};
use gl_numeric::sequence::Method;
use gl_table::Table;
use gl_table::verdict::Verdicts;
use tempfile::TempDir;

const PARAMS: &str = "name lower upper effect off\na 1 2 - -\nbend 0.2 2 bending 0\nkink 0.2 2 kinking 0\n";
const STEPS: usize = 25;

fn tool(name: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().and_then(Path::parent).unwrap().join(name)
}

/// a x + bend x² + kink |x − ½|, and a wave that no parameter makes; x from 0 to 1.
fn curve(values: &[f64], wave: f64) -> Vec<f64> {
    let y =
        |x: f64| values[0] * x + values[1] * x * x + values[2] * (x - 0.5).abs() + wave * (12.0 * x).sin();
    (0..STEPS).map(|t| y(t as f64 / (STEPS - 1) as f64)).collect()
}

/// Noise of sd about 0.7, the same on every machine.
fn jitter(t: usize) -> f64 {
    ((t * t) as f64 * 0.7 + 1.0).sin()
}

struct Case {
    dir: TempDir,
}

impl Case {
    /// A design of `n` runs and a measurement of these values, with noise of sd 0.01.
    fn new(n: usize, effects: &Effects, values: &[f64], wave: f64) -> Self {
        let dir = TempDir::new().unwrap();
        let case = Self { dir };
        case.write("params.txt", PARAMS);
        let prior = Prior::read(&case.path("params.txt")).unwrap();
        let drawn = design::draw(&prior, effects, Method::Halton, n, 1, true).unwrap();
        let names = sample_names("run", 0, n).unwrap();
        let samples = Samples { source: String::new(), names, parameters: prior.names(), values: drawn };
        samples.write(Some(&case.path("samples.txt")), None).unwrap();
        let mut runs = "sample step x y\n".to_owned();
        for (name, values) in samples.names.iter().zip(&samples.values) {
            for (t, y) in curve(values, 0.0).iter().enumerate() {
                writeln!(runs, "{name} {t} {} {y}", t as f64 / (STEPS - 1) as f64).unwrap();
            }
        }
        case.write("runs.tsv", &runs);
        let mut obs = "x y\n".to_owned();
        for (t, y) in curve(values, wave).iter().enumerate() {
            writeln!(obs, "{} {}", t as f64 / (STEPS - 1) as f64, y + 0.014 * jitter(t)).unwrap();
        }
        case.write("obs.txt", &obs);
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    fn edit(&self, name: &str, change: impl Fn(&str) -> String) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        self.write(name, &change(&text));
    }

    fn run(&self, more: &[&str]) -> Output {
        let fixed = ["-p", "params.txt", "-s", "samples.txt", "-b", "obs.txt", "-c", "x", "-v", "y"];
        Command::new(tool("gl-gap-attribute"))
            .current_dir(self.dir.path())
            .args(fixed)
            .args(more)
            .arg("runs.tsv")
            .output()
            .unwrap()
    }

    fn rows(&self, more: &[&str]) -> Vec<(String, f64)> {
        let output = self.run(more);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let table = Table::parse("stdout", output.stdout).unwrap();
        let expected = ["hypothesis", "probability", "ln_evidence", "gap", "unexplained", "confounded_with"];
        assert_eq!(table.format().columns()[..6], expected);
        (0..table.len()).map(|row| (table.field(row, 0).to_owned(), table.number(row, 1).unwrap())).collect()
    }

    fn refused(&self, more: &[&str], words: &[&str]) {
        let output = self.run(more);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(output.stdout.is_empty());
        for word in words {
            assert!(message.contains(word), "{word:?} is not in {message:?}");
        }
    }
}

const NOISE: [&str; 2] = ["--noise", "y=0.01"];

#[test]
fn the_effect_that_is_in_comes_first_and_no_effect_where_there_is_none() {
    let bent = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let rows = bent.rows(&NOISE);
    assert_eq!(rows[0].0, "bending", "{rows:?}");
    assert!(rows[0].1 > 0.75, "{rows:?}");
    assert_eq!(rows.len(), 8, "none, two alone, both, each with unexplained, which none is alone: {rows:?}");
    assert!((rows.iter().map(|row| row.1).sum::<f64>() - 1.0).abs() < 1e-9);
    let straight = Case::new(75, &Effects::Switch, &[1.4, 0.0, 0.0], 0.0);
    assert_eq!(straight.rows(&NOISE)[0].0, "none");
}

#[test]
fn who_finds_the_table_finds_all_that_was_to_be_written() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    for option in ["--verdict", "--effects-out", "--predict-shrink", "--curves-out", "--next-out"] {
        case.refused(&[&NOISE[..], &["-o", "table.txt", option, "missing/file.txt"]].concat(), &["missing"]);
        assert!(!case.path("table.txt").exists(), "{option}");
        case.refused(&[&NOISE[..], &["-o", "table.txt", option, "table.txt"]].concat(), &["two outputs"]);
        assert!(!case.path("table.txt").exists(), "{option}");
    }
}

#[test]
fn what_is_no_candidate_is_unexplained() {
    let wavy = Case::new(75, &Effects::Switch, &[1.4, 0.0, 0.0], 0.1);
    let rows = wavy.rows(&NOISE);
    assert_eq!(rows[0].0, "unexplained", "{rows:?}");
    assert!(rows[0].1 > 0.9, "{rows:?}");
}

#[test]
fn an_offset_of_the_sensor_needs_no_run() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.0, 0.0], 0.0);
    case.edit("obs.txt", |text| {
        let lifted = |line: &str| {
            let (x, y) = line.split_once(' ').unwrap();
            format!("{x} {}\n", y.parse::<f64>().map_or(y.to_owned(), |y| (y + 0.1).to_string()))
        };
        text.lines().map(lifted).collect()
    });
    let rows = case.rows(&["--noise", "y=0.01", "--measurement", "offset"]);
    assert_eq!(rows[0].0, "offset(y)", "{rows:?}");
}

#[test]
fn steps_that_are_kept_back_say_nothing() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let steps = format!("0:{}", STEPS - 5);
    let seen = ["--noise", "y=0.01", "--steps", &steps];
    let before = case.rows(&seen);
    assert_eq!(before[0].0, "bending", "{before:?}");
    case.edit("obs.txt", |text| {
        let changed = |(i, line): (usize, &str)| match line.split_once(' ') {
            Some((x, _)) if i > STEPS - 5 => format!("{x} 99\n"),
            _ => format!("{line}\n"),
        };
        text.lines().enumerate().map(changed).collect()
    });
    assert_eq!(before, case.rows(&seen));
    case.refused(&["--steps", "0:9999"], &["--steps 0:9999", "the measurement has"]);
}

#[test]
fn an_unknown_noise_is_estimated_and_the_verdict_no_sharper() {
    let bent = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let (known, unknown) = (bent.rows(&NOISE), bent.rows(&[]));
    assert_eq!(unknown[0].0, "bending", "{unknown:?}");
    // No sharper than the error of the evidences, about 0.1 nat each, allows.
    let odds = |rows: &[(String, f64)]| rows[0].1 / (1.0 - rows[0].1);
    assert!(odds(&unknown) < 1.25 * odds(&known), "{known:?} {unknown:?}");
}

#[test]
fn threads_and_repetition_change_no_byte() {
    let case = Case::new(60, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let run = |threads: &str| {
        let mut command = Command::new(tool("gl-gap-attribute"));
        command.current_dir(case.dir.path()).env("RAYON_NUM_THREADS", threads);
        command.args(["-p", "params.txt", "-s", "samples.txt", "-b", "obs.txt", "-c", "x", "-v", "y"]);
        command.args(NOISE).arg("runs.tsv").output().unwrap().stdout
    };
    let one = run("1");
    assert!(!one.is_empty());
    assert_eq!(one, run("2"));
    assert_eq!(one, run("5"));
}

/// Codes and values of the verdict, and the rows.
type Concluded = (Vec<(String, String)>, Vec<(String, f64)>);

fn concluded(case: &Case, more: &[&str]) -> Concluded {
    let rows = case.rows(&[more, &["--verdict", "verdict.tsv"]].concat());
    let verdicts = Verdicts::read(&case.path("verdict.tsv")).unwrap();
    (verdicts.rows.into_iter().map(|verdict| (verdict.code, verdict.value)).collect(), rows)
}

fn has(concluded: &Concluded, code: &str, value: &str) -> bool {
    concluded.0.iter().any(|(own, about)| own == code && about == value)
}

#[test]
fn something_else_beside_it_takes_nothing_from_the_cause() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.03);
    let more = ["--noise", "y=0.01", "--effects-out", "effects.tsv", "--rest-out", "rest.tsv"];
    let found = concluded(&case, &more);
    assert_eq!(found.1[0].0, "bending+unexplained", "{found:?}");
    assert!(has(&found, "cause-with-rest", "bending"), "{found:?}");
    let effects = Table::read(&case.path("effects.tsv")).unwrap();
    assert!(effects.number(0, 1).unwrap() > 0.9);
    let rest = Table::read(&case.path("rest.tsv")).unwrap();
    assert_eq!(rest.format().columns(), ["observable", "goes_with", "share", "z", "like"]);
    let shares = rest.numbers("share").unwrap();
    assert!(!shares.is_empty() && shares.windows(2).all(|pair| pair[0] >= pair[1]), "{shares:?}");
}

#[test]
fn a_noise_that_was_stated_at_a_third_takes_nothing_from_the_cause() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let found = concluded(&case, &["--noise", "y=0.0033"]);
    assert!(found.1[0].0.starts_with("bending"), "{found:?}");
    assert!(!found.1[0].0.contains("kinking"), "{found:?}");
    assert!(found.0.iter().any(|(code, _)| code == "noise-scale"), "{found:?}");
}

#[test]
fn readings_that_are_far_off_are_named_and_take_nothing_from_the_cause() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("obs.txt", |text| {
        let off = |(t, line): (usize, &str)| {
            let (x, y) = line.split_once(' ').unwrap();
            let by = [(8, 0.1), (19, -0.12)].iter().find(|(at, _)| at + 1 == t).map_or(0.0, |(_, by)| *by);
            format!("{x} {}\n", y.parse::<f64>().map_or(y.to_owned(), |y| (y + by).to_string()))
        };
        text.lines().enumerate().map(off).collect()
    });
    let found = concluded(&case, &NOISE);
    assert_eq!(found.1[0].0, "bending", "{found:?}");
    assert!(has(&found, "outliers", "8,19") && has(&found, "cause", "bending"), "{found:?}");
}

#[test]
fn a_truth_beyond_a_bound_is_said_first_and_no_cause_is_settled() {
    let case = Case::new(75, &Effects::Switch, &[2.3, 0.9, 0.0], 0.0);
    let found = concluded(&case, &NOISE);
    assert_eq!(found.0[0], ("leans".to_owned(), "a".to_owned()), "{found:?}");
    assert!(!found.0.iter().any(|(code, _)| code.starts_with("cause")), "{found:?}");
}

#[test]
fn a_candidate_that_cannot_show_takes_no_share_of_the_prior() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let before = case.rows(&NOISE);
    case.edit("params.txt", |text| format!("{text}idle 1 2 idling 0\n"));
    case.edit("samples.txt", |text| {
        let more = |(row, line): (usize, &str)| match row {
            0 => format!("{line}\tidle\n"),
            row => format!("{line}\t{}\n", if row % 3 == 0 { 1.0 + row as f64 / 80.0 } else { 0.0 }),
        };
        text.lines().enumerate().map(more).collect()
    });
    let found = concluded(&case, &NOISE);
    assert!(has(&found, "invisible", "idling"), "{found:?}");
    assert_eq!(found.1[0].0, before[0].0);
    assert!((found.1[0].1 - before[0].1).abs() < 0.1, "{found:?} {before:?}");
    let idling = found.1.iter().filter(|(name, _)| name.contains("idling"));
    assert!(idling.clone().count() > 0 && idling.into_iter().all(|(_, probability)| *probability == 0.0));
}

#[test]
fn probabilities_of_effects_sum_those_of_hypotheses() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let rows =
        case.rows(&["--noise", "y=0.01", "--effects-out", "effects.tsv", "--predict-shrink", "shrink.tsv"]);
    let effects = Table::read(&case.path("effects.tsv")).unwrap();
    for row in 0..effects.len() {
        let name = effects.field(row, 0);
        let has = rows.iter().filter(|(hypothesis, _)| hypothesis.split('+').any(|part| part == name));
        let sum: f64 = has.map(|(_, probability)| probability).sum();
        assert!((sum - effects.number(row, 1).unwrap()).abs() < 1e-12, "{name}");
    }
    let shrink = Table::read(&case.path("shrink.tsv")).unwrap();
    assert_eq!(shrink.field(0, 0), "bending");
    assert!(shrink.number(0, 2).unwrap() > 0.9);
}

#[test]
fn the_next_runs_lie_where_the_hypotheses_in_question_put_the_parameters() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.rows(&["--noise", "y=0.01", "--next-out", "next.txt", "--next", "40", "--name", "more"]);
    let next = Samples::read(&case.path("next.txt")).unwrap();
    assert_eq!((next.len(), next.names[0].as_str()), (40, "more_Iter1_Sample00"));
    assert_eq!(next.parameters, ["a", "bend", "kink"]);
    // First each effect at full strength; then bending is in all but those of rivals; what is in is near the truth, what is out is off.
    let [strong, kinked, others @ ..] = next.values.as_slice() else { panic!() };
    assert!(
        strong[1] > 1.4 && strong[2] == 0.0 && kinked[1] == 0.0 && kinked[2] > 1.4,
        "{strong:?} {kinked:?}"
    );
    let bent: Vec<&Vec<f64>> = others.iter().filter(|run| run[1] > 0.0 && run[2] == 0.0).collect();
    assert!(bent.len() > 20, "{:?}", next.values);
    assert!(bent.iter().all(|run| (run[0] - 1.4).abs() < 0.1 && (run[1] - 0.9).abs() < 0.15), "{bent:?}");
    assert!(next.values.iter().all(|run| (1.0..=2.0).contains(&run[0])));
    case.rows(&["--noise", "y=0.01", "--next-out", "default.txt"]);
    assert_eq!(Samples::read(&case.path("default.txt")).unwrap().len(), 30);
    case.refused(&["--noise", "y=0.01", "--next-out", "none.txt", "--next", "0"], &["--next 0"]);
}

#[test]
fn an_emulator_that_is_too_uncertain_for_the_noise_asks_for_runs() {
    let said = |runs: usize, noise: &str| {
        let output = Case::new(runs, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0).run(&["--noise", noise]);
        String::from_utf8_lossy(&output.stderr).contains("--next-out")
    };
    assert!(said(12, "y=0.002"));
    assert!(!said(75, "y=0.01"));
}

#[test]
fn the_self_check_finds_what_is_in_the_runs() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let output = case.run(&["--noise", "y=0.01", "--self-check", "10"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let right = message.split("self-check: in ").nth(1).and_then(|rest| rest.split(' ').next());
    let right: usize = right.unwrap().parse().unwrap();
    assert!(right >= 9, "{message}");
}

#[test]
fn an_effect_that_no_run_has_on_is_named_with_the_command_that_makes_the_design() {
    let case = Case::new(40, &Effects::None, &[1.4, 0.9, 0.0], 0.0);
    case.refused(&NOISE, &["bending", "on in no run", "gl-sample", "--effects pairs"]);
}

#[test]
fn runs_of_other_samples_are_refused_by_name() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("samples.txt", |text| text.replace("run_Iter0", "other_Iter0"));
    case.refused(&NOISE, &["runs.tsv", "sample run_Iter0_Sample00 is not in samples.txt"]);
}

#[test]
fn an_effect_without_a_value_off_is_refused() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("params.txt", |text| text.replace("bending 0", "bending -"));
    case.refused(&NOISE, &["params.txt:3: column off", "bending"]);
}

#[test]
fn fewer_runs_than_inputs_are_refused() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    let samples = Samples::read(&case.path("samples.txt")).unwrap();
    // One run of each combination of the two effects.
    let first = |bend: bool, kink: bool| {
        let row = samples.values.iter().position(|v| (v[1] > 0.0, v[2] > 0.0) == (bend, kink));
        samples.names[row.unwrap()].as_str()
    };
    let kept = [first(false, false), first(false, true), first(true, false), first(true, true)];
    case.edit("runs.tsv", |text| {
        let keep =
            |line: &&str| kept.contains(&line.split(' ').next().unwrap()) || line.starts_with("sample");
        text.lines().filter(keep).map(|line| format!("{line}\n")).collect()
    });
    case.refused(&NOISE, &["4 runs"]);
}

#[test]
fn a_constant_observable_is_refused() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("obs.txt", |text| {
        text.lines()
            .map(|line| {
                if line == "x y" {
                    "x y\n".to_owned()
                } else {
                    format!("{} 3\n", line.split(' ').next().unwrap())
                }
            })
            .collect()
    });
    case.refused(&NOISE, &["y is the same at every step"]);
}

#[test]
fn a_noise_of_zero_is_refused() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.refused(&["--noise", "y=0"], &["noise of y is not positive"]);
}

#[test]
fn a_noise_of_zero_in_the_measurement_is_refused() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("obs.txt", |text| {
        text.lines().map(|line| format!("{line} {}\n", if line == "x y" { "y_sd" } else { "0" })).collect()
    });
    case.refused(&[], &["obs.txt: the noise of y is not positive"]);
}

/// The curve itself, as a deterministic simulator would have made it.
fn exact(values: &[f64]) -> Case {
    let case = Case::new(75, &Effects::Switch, values, 0.0);
    let mut obs = "x y\n".to_owned();
    for (t, y) in curve(values, 0.0).iter().enumerate() {
        writeln!(obs, "{} {y}", t as f64 / (STEPS - 1) as f64).unwrap();
    }
    case.write("obs.txt", &obs);
    case
}

#[test]
fn a_measurement_without_noise_of_a_deterministic_simulator_is_explained() {
    let rows = exact(&[1.4, 0.9, 0.0]).rows(&[]);
    assert_eq!(rows[0].0, "bending", "{rows:?}");
    let rows = exact(&[1.4, 0.0, 0.0]).rows(&[]);
    assert_eq!(rows[0].0, "none", "{rows:?}");
}

#[test]
fn an_observable_that_no_run_changes_explains_nothing() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("runs.tsv", |text| {
        let flat = |line: &str| match line.rsplit_once(' ') {
            Some((rest, "y")) => format!("{rest} y\n"),
            Some((rest, _)) => format!("{rest} 1\n"),
            None => String::new(),
        };
        text.lines().map(flat).collect()
    });
    let output = case.run(&NOISE);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("runs.tsv: y is the same in every run"), "{message}");
}

#[test]
fn another_grid_is_refused() {
    let case = Case::new(40, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("obs.txt", |text| text.replace("\n1 ", "\n1.01 "));
    case.refused(&NOISE, &["step 24", "collect the runs again"]);
}

#[test]
fn failed_runs_of_the_design_are_left_out_and_counted() {
    let case = Case::new(75, &Effects::Switch, &[1.4, 0.9, 0.0], 0.0);
    case.edit("runs.tsv", |text| {
        let failed =
            |line: &&str| !line.starts_with("run_Iter0_Sample07") && !line.starts_with("run_Iter0_Sample1");
        text.lines().filter(failed).map(|line| format!("{line}\n")).collect()
    });
    let output = case.run(&NOISE);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{message}");
    assert!(message.contains("11 of 75 samples have no run"), "{message}");
    assert!(message.contains("bending explains it"), "{message}");
}

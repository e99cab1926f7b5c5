//! Several tests of the same samples, through the tools.

#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;

use gl_numeric::statistics::{mean, sd};
use gl_table::verdict::Verdicts;
use pipelines::folder::Folder;
use pipelines::line::{self, samples_of};

/// The line at 20 places, and the same readings as two tests, of the first 14 places and of the last 6; with samples
/// and an ensemble of each.
fn two_tests(runs: usize) -> Folder {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 5);
    folder.run(&format!("gl-sample -p params.txt -n {runs} --method sobol -o samples.txt"));
    let rows: Vec<String> = folder.read("obs.txt").lines().skip(1).map(str::to_owned).collect();
    for (test, control, part) in [("one", "x", 0..14), ("two", "u", 14..20)] {
        let column = if test == "one" { "y" } else { "f" };
        let mut text = format!("{control} {column}\n");
        rows[part].iter().for_each(|row| writeln!(text, "{row}").unwrap());
        folder.write(&format!("{test}.txt"), text);
        let mut ensemble = format!("sample step {control} {column}\n");
        for (name, a, b) in samples_of(&folder, "samples.txt") {
            for (step, x) in folder.column(&format!("{test}.txt"), control).iter().enumerate() {
                writeln!(ensemble, "{name} {step} {x} {}", a * x + b).unwrap();
            }
        }
        folder.write(&format!("{test}-runs.txt"), ensemble);
    }
    line::ensemble(&folder, "samples.txt", "obs.txt", "ensemble.txt");
    folder
}

const TESTS: &str = "--test one:one.txt:x:y:y=0.3 --test two:two.txt:u:f:f=0.3";
const RUNS: &str = "one=one-runs.txt two=two-runs.txt";

fn misfits(folder: &Folder) {
    folder.run("gl-likelihood -b obs.txt -c x -v y --noise y=0.3 ensemble.txt -o misfit.txt");
    folder.run("gl-likelihood -b one.txt -c x -v y --noise y=0.3 one-runs.txt -o one-misfit.txt");
    folder.run("gl-likelihood -b two.txt -c u -v f --noise f=0.3 two-runs.txt -o two-misfit.txt");
}

/// Take the rows of a sample out of a table.
fn without(folder: &Folder, table: &str, sample: &str) {
    let kept: String = folder
        .read(table)
        .lines()
        .filter(|line| !line.starts_with(sample))
        .fold(String::new(), |text, line| text + line + "\n");
    folder.write(table, kept);
}

#[test]
fn misfits_of_two_tests_weigh_as_those_of_one_measurement() {
    let folder = two_tests(30);
    misfits(&folder);
    folder.run("gl-filter -s samples.txt --sigma noise misfit.txt -o whole.txt --summary whole-summary.txt");
    let said = folder.run(
        "gl-filter -s samples.txt --sigma noise one-misfit.txt two-misfit.txt -o weights.txt --summary summary.txt \
         --history history.txt",
    );
    assert!(!said.contains("failed in the test"), "{said}");
    for (whole, sum) in
        folder.column("whole.txt", "weight").iter().zip(folder.column("weights.txt", "weight"))
    {
        assert!((whole - sum).abs() < 1e-9, "{whole} {sum}");
    }
    let noise = |summary: &str| folder.quantity(summary, "best_misfit_over_noise");
    assert!((noise("summary.txt") - noise("whole-summary.txt")).abs() < 1e-9);
    assert_eq!(folder.column("history.txt", "step").len(), 20);
}

#[test]
fn a_sample_that_failed_in_one_test_is_left_out_with_that_test_named_or_counted_by_the_others() {
    let folder = two_tests(12);
    misfits(&folder);
    let names = folder.texts("samples.txt", "description");
    without(&folder, "two-misfit.txt", &names[4]);
    let call = "gl-filter -s samples.txt one-misfit.txt two-misfit.txt -o weights.txt --summary summary.txt";
    let said = folder.run(call);
    assert!(said.contains(&format!("{} failed in the test of two-misfit.txt: left out", names[4])), "{said}");
    assert!(!folder.texts("weights.txt", "sample").contains(&names[4]));
    assert_eq!(folder.quantity("summary.txt", "failed"), 1.0);
    let said = folder.run(&format!("{call} --failed-as-others"));
    assert!(said.contains("counted by the other tests"), "{said}");
    let place = folder.texts("weights.txt", "sample").iter().position(|name| *name == names[4]).unwrap();
    let of_one: f64 = folder
        .texts("one-misfit.txt", "sample")
        .iter()
        .zip(folder.column("one-misfit.txt", "misfit"))
        .filter_map(|(name, misfit)| (*name == names[4]).then_some(misfit))
        .sum();
    let taken = folder.column("weights.txt", "misfit")[place];
    assert!((taken - of_one * 20.0 / 14.0).abs() < 1e-9 * taken, "{taken} {of_one}");
}

#[test]
fn a_noise_that_is_known_in_one_test_alone_is_refused() {
    let folder = two_tests(12);
    misfits(&folder);
    folder.run("gl-likelihood -b two.txt -c u -v f two-runs.txt -o two-misfit.txt");
    let says = ["the noise is known, but not in two-misfit.txt"];
    folder.refuses("gl-filter -s samples.txt one-misfit.txt two-misfit.txt", &says);
    let tests = "--test one:one.txt:x:y:y=0.3 --test two:two.txt:u:f";
    let says = ["the noise of the test one is known and that of two is not"];
    folder.refuses(&format!("gl-posterior -p params.txt -s samples.txt {tests} {RUNS}"), &says);
}

#[test]
fn draws_from_two_tests_are_those_from_one_measurement() {
    let folder = two_tests(14);
    let common = "gl-posterior -p params.txt -s samples.txt -n 2000 --noise-as-stated";
    folder.run(&format!("{common} -b obs.txt -c x -v y --noise y=0.3 ensemble.txt -o whole.txt"));
    folder.run(&format!("{common} {TESTS} {RUNS} -o draws.txt --summary summary.txt"));
    for name in ["a", "b"] {
        let [whole, both] = ["whole.txt", "draws.txt"].map(|draws| folder.column(draws, name));
        let even = vec![1.0 / whole.len() as f64; whole.len()];
        let spread = sd(&whole, &even);
        assert!((mean(&whole, &even) - mean(&both, &even)).abs() < 0.1 * spread, "{name}");
        assert!((sd(&both, &even) / spread - 1.0).abs() < 0.07, "{name}");
    }
    assert!(folder.quantity("summary.txt", "chi_square_degrees") < 20.0);
    // A noise that is estimated, the sizes of the tests apart.
    let tests = "--test one:one.txt:x:y --test two:two.txt:u:f";
    folder.run(&format!(
        "gl-posterior -p params.txt -s samples.txt {tests} --weights one.y=1,two.f=2 {RUNS} -o d.txt"
    ));
}

#[test]
fn runs_that_a_test_lacks_are_said_and_tables_of_no_test_refused() {
    let folder = two_tests(14);
    let names = folder.texts("samples.txt", "description");
    without(&folder, "one-runs.txt", &names[2]);
    let call = format!("gl-posterior -p params.txt -s samples.txt {TESTS}");
    let said = folder.run(&format!("{call} {RUNS} -o draws.txt --run-weights runs.txt"));
    assert!(said.contains(&format!("{} failed in the test one: left out", names[2])), "{said}");
    assert_eq!(folder.texts("runs.txt", "sample").len(), 13);
    for (tables, expected) in [
        ("one-runs.txt two-runs.txt", "is not TEST=FILE"),
        ("one=one-runs.txt three=two-runs.txt", "no such test; they are one, two"),
        ("one=one-runs.txt", "the test two has no ensemble"),
    ] {
        folder.refuses(&format!("{call} {tables}"), &[expected]);
    }
}

#[test]
fn a_gap_in_one_test_is_located_there_and_drawn() {
    let folder = two_tests(40);
    // The first test has a bump that no line has.
    let mut text = "x y\n".to_owned();
    for (x, y) in folder.column("one.txt", "x").into_iter().zip(folder.column("one.txt", "y")) {
        writeln!(text, "{x} {}", y + if (4.0..8.0).contains(&x) { 5.0 } else { 0.0 }).unwrap();
    }
    folder.write("one.txt", text);
    misfits(&folder);
    folder.run("gl-filter -s samples.txt one-misfit.txt two-misfit.txt -o weights.txt");
    let locate = format!("gl-gap-locate -w weights.txt {TESTS} {RUNS} -o locate.txt --verdict verdict.txt");
    folder.run(&locate);
    let verdicts = Verdicts::read(&folder.path("verdict.txt")).unwrap();
    let gap = verdicts.find("gap").unwrap();
    assert_eq!(gap.value, "one.y");
    assert!(gap.text.contains("in one.y"), "{}", gap.text);
    let observables = folder.texts("locate.txt", "observable");
    let significant = folder.texts("locate.txt", "significant");
    for (observable, significant) in observables.iter().zip(&significant) {
        assert!(significant == "no" || observable == "one.y", "{observable}");
    }
    assert!(observables.contains(&"two.f".to_owned()));
    let share: f64 = folder.column("locate.txt", "share").iter().sum();
    assert!((share - 1.0).abs() < 1e-9);
    folder.run(&format!("gl-plot fit -w weights.txt {TESTS} {RUNS} -o fit.svg"));
    let picture = folder.read("fit.svg");
    assert!(picture.contains("one.y against x") && picture.contains("two.f against u"));
}

//! `gl-sensitivity` between the tools before and after it.

use std::fmt::Write as _;

use gl_table::verdict::Verdicts;
use pipelines::folder::Folder;
use pipelines::line::{self, samples_of};

/// Samples of a and b between 0 and 1, and ensembles of their sum and difference.
fn sums() -> Folder {
    let folder = Folder::default();
    folder.write("params.txt", "name lower upper\na 0 1\nb 0 1\n");
    folder.run("gl-sample -p params.txt -n 24 --method sobol -o samples.txt");
    let (mut sum, mut difference) = ("sample step x y\n".to_owned(), "sample step x z\n".to_owned());
    for (name, a, b) in samples_of(&folder, "samples.txt") {
        writeln!(sum, "{name} 0 0 {}", a + b).unwrap();
        writeln!(difference, "{name} 0 0 {}", a - b).unwrap();
    }
    folder.write("sum.txt", sum).write("difference.txt", difference).write("obs.txt", "x y\n0 1\n");
    folder
}

const CALL: &str = "gl-sensitivity -p params.txt -s samples.txt --verdict verdict.txt -o indices.txt";

#[test]
fn a_line_depends_on_its_slope_at_the_end_and_on_its_level_at_the_start() {
    let folder = Folder::default();
    folder.write("params.txt", "name lower upper\na 0 1\nb 0 1\n");
    folder.run("gl-sample -p params.txt -n 24 --method sobol -o samples.txt");
    let mut obs = "x y\n".to_owned();
    (0..20).for_each(|x| writeln!(obs, "{} 0", f64::from(x) / 10.0).unwrap());
    folder.write("obs.txt", obs);
    line::ensemble(&folder, "samples.txt", "obs.txt", "ensemble.txt");
    folder.run(&format!("{CALL} --stretches 4 ensemble.txt"));
    let column = |name: &str| folder.column("indices.txt", name);
    let (from, to, first, total) = (column("from"), column("to"), column("first"), column("total"));
    assert_eq!(first.len(), 8);
    for (row, parameter) in folder.texts("indices.txt", "parameter").iter().enumerate() {
        // a x + b with both even over one range: the variances are as Σ x² to n.
        let x: Vec<f64> =
            (0..20).map(|x| f64::from(x) / 10.0).filter(|x| (from[row]..=to[row]).contains(x)).collect();
        let square = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
        let exact = if parameter == "a" { square } else { 1.0 } / (1.0 + square);
        assert!((first[row] - exact).abs() < 0.01, "{parameter} {}: {} {exact}", from[row], first[row]);
        assert!((total[row] - exact).abs() < 0.01, "{parameter} {}: {} {exact}", from[row], total[row]);
        let sd = ((1.0 + square) / 12.0).sqrt();
        assert!((column("sd")[row] / sd - 1.0).abs() < 0.01);
        assert!(column("ignorance")[row] < 0.01);
    }
}

#[test]
fn a_sum_leaves_the_difference_free_and_a_planned_test_of_it_would_say_most() {
    let folder = sums();
    folder.run(
        "gl-posterior -p params.txt -s samples.txt -b obs.txt -c x -v y --noise y=0.01 sum.txt -n 4000 -o draws.txt",
    );
    folder.run(&format!(
        "{CALL} -w draws.txt --directions-out directions.txt --narrowing-out narrowing.txt \
         --plan again:y=0.01:sum.txt --plan other:z=0.01:difference.txt --plan-out plan.txt sum.txt"
    ));
    let left = folder.column("directions.txt", "left");
    assert!(left[0] > 0.8 && left[1] < 0.01, "{left:?}");
    let (a, b) = (folder.column("directions.txt", "a")[0], folder.column("directions.txt", "b")[0]);
    assert!((a * b + 0.5).abs() < 0.02, "{a} {b}");
    let verdicts = Verdicts::read(&folder.path("verdict.txt")).unwrap();
    assert!(verdicts.find("free").unwrap().text.contains("open still along"));
    assert_eq!(verdicts.find("measure").unwrap().value, "other");
    // Where a + b = 1, each of them may be anything still.
    let narrowing = folder.column("narrowing.txt", "narrowing");
    assert!(narrowing.iter().all(|narrowing| narrowing.abs() < 0.1), "{narrowing:?}");
    let (tests, then) = (folder.texts("plan.txt", "test"), folder.column("plan.txt", "left_then"));
    for (test, then) in tests.iter().zip(then) {
        assert!(if test == "other" { then < 0.01 } else { then > 0.4 }, "{test} {then}");
    }
}

#[test]
fn what_a_planned_test_leaves_of_the_prior_is_that_of_the_closed_form() {
    let folder = sums();
    let noise = 0.2;
    folder.run(&format!("{CALL} --plan sum:y={noise}:sum.txt --plan-out plan.txt sum.txt"));
    let exact = 1.0 - (1.0 / 12.0) / (2.0 / 12.0 + noise * noise);
    for (now, then) in
        folder.column("plan.txt", "left_now").iter().zip(folder.column("plan.txt", "left_then"))
    {
        assert!((now - 1.0).abs() < 0.01 && (then - exact).abs() < 0.01, "{now} {then} {exact}");
    }
    let before = 2.0 / 12.0;
    let nats = 0.5 * (1.0 + before / (noise * noise)).ln();
    assert!((folder.column("plan.txt", "nats")[0] - nats).abs() < 0.02);
}

#[test]
fn observables_of_several_tests_are_named_by_test_and_what_makes_no_sense_is_refused() {
    let folder = sums();
    folder.run(&format!("{CALL} one=sum.txt two=difference.txt"));
    let observables = folder.texts("indices.txt", "observable");
    assert!(observables.contains(&"one.y".to_owned()) && observables.contains(&"two.z".to_owned()));
    for (call, says) in [
        ("one=sum.txt difference.txt", "name all or none"),
        ("--plan sum.txt sum.txt", "is not NAME:NOISE:ENSEMBLE"),
        ("--plan p:y=0:sum.txt sum.txt", "give its standard deviation"),
        ("--plan p:q=1:sum.txt sum.txt", "q"),
        ("-v y one=sum.txt two=difference.txt", "each ensemble has its own columns"),
    ] {
        folder.refuses(&format!("gl-sensitivity -p params.txt -s samples.txt {call} -o new.txt"), &[says]);
    }
}

/// A design of a base parameter a and an effect b, runs of a planned test z = a + b, and draws under two hypotheses, whose
/// predictions of z are normal: means 0.5 and 0.7, standard deviations 0.05 and 0.1.
fn two_hypotheses() -> Folder {
    let folder = Folder::default();
    folder.write("params.txt", "name lower upper effect off\na 0 1 - -\nb 0.1 1 jump 0\n");
    folder.run("gl-sample -p params.txt -n 40 --effects switch -o samples.txt");
    let mut runs = "sample step x z\n".to_owned();
    for (name, a, b) in samples_of(&folder, "samples.txt") {
        writeln!(runs, "{name} 0 0 {}", a + b).unwrap();
    }
    let mut draws = "hypothesis probability a b\n".to_owned();
    let count = 400;
    for i in 0..count {
        let normal = gl_numeric::normal::normal_quantile((f64::from(i) + 0.5) / f64::from(count));
        writeln!(draws, "none 0.3 {} 0", 0.5 + 0.05 * normal).unwrap();
        writeln!(draws, "jump 0.1 0.3 {}", 0.4 + 0.1 * normal).unwrap();
    }
    folder.write("planned.txt", runs).write("draws.txt", draws);
    folder
}

#[test]
fn the_expected_odds_of_two_normal_hypotheses_are_those_of_the_closed_form() {
    let folder = two_hypotheses();
    let noise: f64 = 0.08;
    folder.run(&format!(
        "gl-sensitivity -p params.txt -s samples.txt --hypotheses draws.txt --plan vague:z=5:planned.txt \
         --plan sharp:z={noise}:planned.txt --verdict verdict.txt -o odds.txt"
    ));
    let column = |name: &str| folder.column("odds.txt", name);
    let (now, then) = (column("probability_now"), column("probability_then"));
    let (odds_now, odds_then) = (column("ln_odds_now"), column("ln_odds_then"));
    assert_eq!(folder.texts("odds.txt", "rival"), ["jump", "none", "jump", "none"]);
    let variance = [0.05f64.powi(2) + noise * noise, 0.1f64.powi(2) + noise * noise];
    let (mean, prior) = ([0.5, 0.7], [0.75f64, 0.25]);
    let joint = |h: usize, y: f64| {
        prior[h] * (-(y - mean[h]).powi(2) / (2.0 * variance[h])).exp() / variance[h].sqrt()
    };
    for h in 0..2 {
        let other = 1 - h;
        let (own, rival) = (variance[h], variance[other]);
        let divergence = 0.5 * ((own + 0.04) / rival - 1.0 + (rival / own).ln());
        let exact = (prior[h] / prior[other]).ln();
        // A test that tells nothing leaves all as it is.
        assert!((then[h] - now[h]).abs() < 0.01 && (now[h] - prior[h]).abs() < 1e-12);
        assert!((odds_then[2 + h] - exact - divergence).abs() < 0.02, "{} {divergence}", odds_then[2 + h]);
        assert!((odds_now[2 + h] - exact).abs() < 1e-12);
        // By the trapezoidal rule.
        let (mut sum, mut whole) = (0.0, 0.0);
        for i in -4000..4000 {
            let y = mean[h] + f64::from(i) * 0.002 * own.sqrt();
            whole += joint(h, y);
            sum += joint(h, y).powi(2) / (joint(0, y) + joint(1, y));
        }
        assert!((then[2 + h] - sum / whole).abs() < 0.015, "{} {}", then[2 + h], sum / whole);
    }
    let verdict = Verdicts::read(&folder.path("verdict.txt")).unwrap();
    assert_eq!(verdict.find("tells-apart").unwrap().value, "sharp");
}

#[test]
fn hypotheses_that_make_no_sense_are_refused() {
    let folder = two_hypotheses();
    let draws = folder.read("draws.txt");
    let changed = |from: &str, to: &str| draws.replace(from, to);
    let one: String =
        draws.lines().filter(|line| !line.starts_with("jump")).map(|l| format!("{l}\n")).collect();
    let short: String = draws.lines().take(4).map(|line| format!("{line}\n")).collect();
    let half: String = draws.lines().take(3).map(|line| format!("{line}\n")).collect();
    for (table, says) in [
        (one, "there must be two at least"),
        (half, "one draw of none"),
        (changed("jump 0.1", "jump 0"), "leave out what is ruled out"),
        (short.clone() + "none 0.4 0.5 0\n", "but none has 0.3 above"),
        (changed(" a b\n", " a c\n"), "column b"),
    ] {
        folder.write("bad.txt", table);
        let call =
            "gl-sensitivity -p params.txt -s samples.txt --hypotheses bad.txt --plan p:z=1:planned.txt";
        folder.refuses(&format!("{call} -o new.txt"), &[says]);
    }
    folder.refuses(
        "gl-sensitivity -p params.txt -s samples.txt --hypotheses draws.txt -o new.txt planned.txt",
        &["--plan"],
    );
}

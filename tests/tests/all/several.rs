//! Several tests of the same samples, through the tools.

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
fn a_test_counts_by_its_readings_where_the_noise_is_unknown_too() {
    let folder = Folder::default();
    folder.write("samples.txt", "description\ta\na\t1\nb\t2\nc\t3\n");
    // Three readings a step, and one.
    let table = |runs: &[&str], readings: &str| {
        let rows = |run: &&str| {
            (0..4).map(|step| format!("{run}\t{step}\t0.5\t0.1\t{readings}\n")).collect::<String>()
        };
        format!("sample\tstep\tmisfit\terror\treadings\n{}", runs.iter().map(rows).collect::<String>())
    };
    folder.write("one.txt", table(&["a", "b", "c"], "3"));
    folder.write("two.txt", table(&["a", "b"], "1"));
    folder.run("gl-filter -s samples.txt --sigma 1 --failed-as-others one.txt two.txt -o weights.txt");
    let misfit = folder.column("weights.txt", "misfit");
    assert!((misfit[2] - 2.0 * 16.0 / 12.0).abs() < 1e-12, "{misfit:?}");
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

/// A case of two tests of y = a x + b + shift, each with a shift that is known of it; the second is shorter, and its runs
/// fail where a is large.
fn case_of_two_tests() -> Folder {
    let folder = Folder::default();
    folder.write("case/params.txt", "name lower upper\na 0 1\nb 0 10\n");
    folder.write(
        "case/case.toml",
        "name = \"two\"\ncontrol = \"x\"\nobservables = [\"y\"]\nnoise = { y = 0.3 }\niterations = 2\n\n[model]\n\
         local = \"awk -f {case}/line.awk -v a={a} -v b={b} -v shift={shift} -v most=2 -v n=20 -v name={description}\"\n\n\
         [[test]]\nname = \"one\"\nobs = \"one.txt\"\ngiven = { shift = 1 }\n\n\
         [[test]]\nname = \"two\"\nobs = \"two.txt\"\nobservables = [\"f=y\"]\nnoise = { f = 0.2 }\ngiven = { shift = -2 }\n\
         model = { local = \"awk -f {case}/line.awk -v a={a} -v b={b} -v shift={shift} -v most=0.9 -v n=8 -v name={description}\" }\n",
    );
    folder.write(
        "case/line.awk",
        "BEGIN { if (a > most) exit 1; CONVFMT = \"%.12g\"; file = name \"_sim.txt\"; print \"x\\ty\" > file\n\
         for (x = 0; x < n; x++) print x \"\\t\" a * x + b + shift > file }\n",
    );
    let (mut one, mut two) = ("x y\n".to_owned(), "x f\n".to_owned());
    for x in 0..20 {
        let (y, noise) = (0.5 * f64::from(x) + 4.0, (12.9898 * f64::from(x * x + 3)).sin());
        writeln!(one, "{x} {}", y + 1.0 + 0.4 * noise).unwrap();
        if x < 8 {
            writeln!(two, "{x} {}", y - 2.0 + 0.25 * (5.1 * noise).sin()).unwrap();
        }
    }
    folder.write("case/one.txt", one).write("case/two.txt", two);
    folder
}

#[test]
fn a_case_of_two_tests_runs_each_sample_in_both_and_calibrates_on_both() {
    let folder = case_of_two_tests();
    let said = folder.run("gl-check case");
    assert!(
        said.contains("20 readings of y on x in one") && said.contains("8 readings of f on x in two"),
        "{said}"
    );
    assert!(said.contains("each in 2 tests"), "{said}");
    folder.run("gl-calibrate case --out out");
    for test in ["one", "two"] {
        let given = folder.column(&format!("out/iter0/{test}/samples.txt"), "shift");
        let shift = if test == "one" { 1.0 } else { -2.0 };
        assert!(given.iter().all(|value| *value == shift));
        assert!(folder.path(&format!("out/ensemble-{test}.txt")).is_file());
    }
    // Those with a > 0.9 failed in the second test alone.
    let failed = |test: &str| {
        folder.texts(&format!("out/iter0/{test}/status.txt"), "status").iter().filter(|s| *s != "ok").count()
    };
    let large = folder.column("out/iter0/samples.txt", "a").iter().filter(|a| **a > 0.9).count();
    assert!(large > 0);
    assert_eq!((failed("one"), failed("two")), (0, large));
    assert!(folder.read("out/iter0/emulator.log").contains("failed in the test two: left out"));
    for (name, truth) in [("a", 0.5), ("b", 4.0)] {
        let [mean, sd] =
            ["mean", "sd"].map(|of| folder.quantity("out/posterior.txt", &format!("{of}({name})")));
        assert!((mean - truth).abs() < 4.0 * sd && sd < 0.2, "{name} {mean} {sd}");
    }
    folder.run("gl-report case -o out");
    let page = folder.read("out/report.html");
    assert!(page.contains("2 tests of the same samples") && page.contains("two.f against x"));
    assert!(page.contains("shift = -2"));
}

#[test]
fn a_calibration_of_tests_that_is_called_again_does_nothing_and_one_by_weights_adds_misfits() {
    let folder = case_of_two_tests();
    folder.run("gl-calibrate case --out out");
    let [calls, posterior] = ["out/commands.log", "out/posterior.txt"].map(|file| folder.read(file));
    folder.run("gl-calibrate case --out out");
    let again: Vec<String> =
        folder.read("out/commands.log")[calls.len()..].lines().map(str::to_owned).collect();
    assert!(again.iter().all(|call| call.starts_with("gl-check-stop")), "{again:?}");
    assert_eq!(folder.read("out/posterior.txt"), posterior);
    for setting in ["posterior=weights", "posterior=runs"] {
        folder.run(&format!("gl-calibrate case --out {setting} {setting} num=30"));
        let calls = folder.read(&format!("{setting}/commands.log"));
        assert!(
            calls.contains(&format!("{setting}/iter1/one/misfit.txt {setting}/iter0/two/misfit.txt")),
            "{calls}"
        );
        let [mean, sd] =
            ["mean(a)", "sd(a)"].map(|of| folder.quantity(&format!("{setting}/posterior.txt"), of));
        assert!((mean - 0.5).abs() < 4.0 * sd && sd < 0.2, "{setting} {mean} {sd}");
    }
}

#[test]
fn one_iteration_takes_the_runs_of_each_test_from_a_folder_of_its_name() {
    let folder = case_of_two_tests();
    folder.run("gl-calibrate case --out out --iterations 1");
    for test in ["one", "two"] {
        folder.link(&folder.path(&format!("out/iter0/{test}/runs")), test);
    }
    let output = folder.call("gl-iterate case out/iter0/samples.txt . --out by-hand", "");
    assert!(output.status.code().unwrap() < 2, "{output:?}");
    assert_eq!(
        folder.column("by-hand/iter0/posterior-weights.txt", "a").len(),
        folder.column("out/iter0/posterior-weights.txt", "a").len()
    );
}

#[test]
fn a_case_of_tests_is_refused_where_it_makes_no_sense() {
    let folder = case_of_two_tests();
    let whole = folder.read("case/case.toml");
    folder.refuses("gl-check case noise=y=1", &["noise=y=1: with [[test]] each test has its own"]);
    folder.refuses("gl-check case test=one", &["test belongs to the case"]);
    for (what, with, says) in [
        ("name = \"one\"", "name = \"two\"", "duplicate test two"),
        ("name = \"one\"", "name = \"a b\"", "is no name of a test"),
        ("name = \"one\"", "nmae = \"one\"", "case.toml:11: test.nmae: did you mean name?"),
        ("given = { shift = 1 }", "given = { a = 1 }", "a is a parameter"),
        ("given = { shift = 1 }", "", "{shift} is no column"),
        ("noise = { f = 0.2 }", "noise = { y = 0.2 }", "case.toml:19: noise: no observable y"),
        ("obs = \"one.txt\"", "", "the test one has no table of its measurement"),
        ("obs = \"one.txt\"", "obs = \"none.txt\"", "none.txt"),
    ] {
        folder.write("case/case.toml", whole.replacen(what, with, 1));
        folder.refuses("gl-check case", &[says]);
    }
    let unknown = whole.replacen("noise = { y = 0.3 }\n", "", 1);
    folder.write("case/case.toml", unknown);
    folder.refuses("gl-check case", &["the noise of the test two is known and that of one is not"]);
}

#[test]
fn a_gap_that_closes_in_two_tests_is_measured_in_each_and_in_both() {
    let folder = two_tests(12);
    // Before, the run is flat; after, it is the line but for a rest.
    for (test, control, column) in [("one", "x", "y"), ("two", "u", "f")] {
        let head = format!("sample step {control} {column}\n");
        let (mut before, mut after) = (head.clone(), head);
        for (step, x) in folder.column(&format!("{test}.txt"), control).iter().enumerate() {
            writeln!(before, "a {step} {x} 8").unwrap();
            writeln!(after, "a {step} {x} {}", 0.5 * x + 4.0 + 0.3 * (2.0 * x).sin()).unwrap();
        }
        folder.write(&format!("{test}-before.txt"), before).write(&format!("{test}-after.txt"), after);
    }
    folder.write("weights.txt", "sample weight\na 1\n");
    let call = format!(
        "gl-gap-shrink {TESTS} --before one=one-before.txt,two=two-before.txt,weights.txt \
         --after one=one-after.txt,two=two-after.txt,weights.txt"
    );
    folder.run(&format!("{call} -o shrink.txt --verdict verdict.txt"));
    assert_eq!(folder.texts("shrink.txt", "observable"), ["one.y", "two.f", "all"]);
    let [both, low] = ["gap_before", "shrink_low"].map(|name| folder.column("shrink.txt", name));
    let square = 0.5 * (both[0].powi(2) + both[1].powi(2));
    assert!((both[2].powi(2) - square).abs() < 1e-12);
    assert!(low[2] > 0.8, "{low:?}");
    let one = "gl-gap-shrink -b one.txt -c x -v y --noise y=0.3 --before one-before.txt,weights.txt \
               --after one-after.txt,weights.txt";
    let same = |table: &str| {
        for name in ["gap_before", "gap_after", "floor", "shrink", "shrink_low", "shrink_high"] {
            assert_eq!(folder.column("alone.txt", name)[0], folder.column(table, name)[0], "{name}");
        }
    };
    folder.run(&format!("{one} -o alone.txt"));
    same("shrink.txt");
    // Where calibration has not seen all of one test, and all of the other.
    folder.run(&format!("{one} --calibrated 0:8 -o alone.txt"));
    for seen in ["one=0:8", "one=0:8,two=0:"] {
        folder.run(&format!("{call} --calibrated {seen} -o unseen.txt"));
        assert_eq!(folder.texts("unseen.txt", "observable"), ["one.y", "all"]);
        same("unseen.txt");
    }
    for (seen, says) in [
        ("0:8", "the steps of each test"),
        ("three=0:8", "no test three; they are one, two"),
        ("two=0:", "saw all steps of each test"),
    ] {
        folder.refuses(&format!("{call} --calibrated {seen} -o new.txt"), &[says]);
    }
    folder.refuses(&format!("{one} --calibrated one=0:8 -o new.txt"), &["is for --test; give A:B"]);
}

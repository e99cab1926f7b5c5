//! Prediction, and the tools that say where the gap lies and how far it closes.

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use gl_table::Table;
use gl_table::verdict::Verdicts;
use tempfile::TempDir;

fn run(directory: &Path, name: &str, arguments: &str) -> Output {
    let mut release = std::env::current_exe().unwrap();
    release.pop();
    release.pop();
    let mut command = Command::new(release.join(name));
    command.current_dir(directory).args(arguments.split(' ')).output().unwrap()
}

fn table(output: &Output) -> Table {
    assert!(output.status.success(), "{}", stderr(output));
    Table::parse("stdout", output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// It fails with exit code 2, says all of `words`, and writes nothing.
fn assert_refused(output: &Output, words: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty());
    for word in words {
        assert!(message.contains(word), "{word:?} is not in: {message}");
    }
}

const STEPS: usize = 40;

/// Noise of a spread of about 0.1 that is the same every time.
fn noise(step: usize) -> f64 {
    0.14 * ((step * step) as f64 * 1.7 + step as f64).sin()
}

/// The model q = a, three runs of it around a = 1, with and without a step of 1 from step 20 on, which the
/// measurement has.
fn directory() -> TempDir {
    let directory = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| fs::write(directory.path().join(name), text).unwrap();
    let rise = |step: usize| if step < 20 { 0.0 } else { 1.0 };
    let ensemble = |effect: f64| {
        let rows = [("low", 0.98), ("middle", 1.0), ("high", 1.02)].map(|(sample, a)| {
            (0..STEPS)
                .map(|step| {
                    format!("{sample}\t{step}\t{}\t{}\n", step as f64 / 10.0, a + effect * rise(step))
                })
                .collect::<String>()
        });
        format!("sample\tstep\te\tq\n{}", rows.concat())
    };
    let obs = |step: usize| format!("{}\t{}\n", step as f64 / 10.0, 1.0 + rise(step) + noise(step));
    write("obs.txt", format!("e\tq\n{}", (0..STEPS).map(obs).collect::<String>()));
    write("base.tsv", ensemble(0.0));
    write("half.tsv", ensemble(0.5));
    write("full.tsv", ensemble(1.0));
    write("weights.tsv", "sample\ta\tweight\nlow\t0.98\t1\nmiddle\t1\t2\nhigh\t1.02\t1\n".to_owned());
    directory
}

#[test]
fn a_prediction_is_weighted_by_name_and_not_by_row() {
    let directory = directory();
    fs::write(directory.path().join("turned.tsv"), "sample\tweight\nhigh\t1\nlow\t0\nmiddle\t3\n").unwrap();
    let table = table(&run(directory.path(), "gl-predict", "-w turned.tsv base.tsv"));
    assert_eq!(table.format().columns(), ["step", "e", "q_mean", "q_sd", "q_q05", "q_q50", "q_q95"]);
    assert_eq!(table.len(), STEPS);
    let mean = table.numbers("q_mean").unwrap();
    // 3/4 of 1 and 1/4 of 1.02: mean 1.005, sd √(3/16) · 0.02.
    assert!(mean.iter().all(|mean| (mean - 1.005).abs() < 1e-12));
    let sd = table.numbers("q_sd").unwrap();
    assert!(sd.iter().all(|sd| (sd - 0.1875_f64.sqrt() * 0.02).abs() < 1e-12));
}

#[test]
fn a_prediction_without_weights_counts_every_run_alike() {
    let directory = directory();
    let table = table(&run(directory.path(), "gl-predict", "-c e -v q base.tsv"));
    assert!(table.numbers("q_q50").unwrap().iter().all(|median| (median - 1.0).abs() < 1e-12));
}

#[test]
fn a_run_without_a_weight_and_a_weight_without_a_run_are_named() {
    let directory = directory();
    fs::write(directory.path().join("few.tsv"), "sample\tweight\nlow\t1\nhigh\t1\n").unwrap();
    fs::write(directory.path().join("many.tsv"), "sample\tweight\nlow\t1\nmiddle\t1\nhigh\t1\nlost\t1\n")
        .unwrap();
    let predict = |weights| run(directory.path(), "gl-predict", &format!("-w {weights} base.tsv"));
    assert_refused(&predict("few.tsv"), &["few.tsv: no sample middle, which base.tsv has"]);
    assert_refused(&predict("many.tsv"), &["base.tsv: no sample lost", "many.tsv"]);
    fs::write(directory.path().join("empty.tsv"), "sample\tstep\te\tq\n").unwrap();
    assert_refused(&run(directory.path(), "gl-predict", "empty.tsv"), &["empty.tsv: no runs"]);
}

#[test]
fn a_rise_that_the_model_lacks_is_located() {
    let directory = directory();
    let call = "-b obs.txt -c e -v q -w weights.tsv --noise q=0.1 --units e=mm base.tsv";
    let output = run(directory.path(), "gl-gap-locate", call);
    let table = table(&output);
    let columns = ["observable", "from", "to", "gap", "gap_sd", "z", "share", "significant"];
    assert_eq!(table.format().columns()[..8], columns);
    assert_eq!(table.len(), 2);
    assert_eq!((table.field(0, 7), table.field(1, 7)), ("no", "yes"));
    assert_eq!((table.number(1, 1).unwrap(), table.number(1, 2).unwrap()), (2.0, 3.9));
    assert!((table.number(1, 3).unwrap() - 1.0).abs() < 0.1);
    assert!(table.number(1, 6).unwrap() > 0.95);
    assert!(stderr(&output).contains("The gap lies in q between e 2 and 3.9 mm"), "{}", stderr(&output));
}

#[test]
fn a_model_that_has_the_rise_leaves_no_gap() {
    let directory = directory();
    let output =
        run(directory.path(), "gl-gap-locate", "-b obs.txt -c e -v q -w weights.tsv --noise q=0.1 full.tsv");
    let table = table(&output);
    assert_eq!((table.len(), table.field(0, 7), table.number(0, 6).unwrap()), (1, "no", 0.0));
    assert!(stderr(&output).contains("No gap beyond what noise and posterior spread explain."));
}

#[test]
fn a_gap_is_looked_for_in_the_noise_that_was_found() {
    let directory = directory();
    let code = |more: &str| {
        let call = "-b obs.txt -c e -v q -w weights.tsv --noise q=3 --verdict v.tsv base.tsv";
        let output = run(directory.path(), "gl-gap-locate", &format!("{call}{more}"));
        assert!(output.status.success(), "{}", stderr(&output));
        Verdicts::read(&directory.path().join("v.tsv")).unwrap().rows[0].code.clone()
    };
    fs::write(directory.path().join("noise.tsv"), "observable\tscale\nq\t0.04\n").unwrap();
    assert_eq!((code("").as_str(), code(" --noise-found noise.tsv").as_str()), ("smooth", "gap"));
    fs::write(directory.path().join("noise.tsv"), "observable\tscale\nr\t0.04\n").unwrap();
    let call = "-b obs.txt -c e -v q -w weights.tsv --noise q=3 base.tsv --noise-found noise.tsv";
    let output = run(directory.path(), "gl-gap-locate", call);
    assert!(stderr(&output).contains("noise.tsv: no observable r"), "{}", stderr(&output));
}

#[test]
fn a_gap_that_alternates_is_no_fit_though_no_stretch_stands_out() {
    let directory = directory();
    let alternating = |step: usize, readings: usize| {
        if (step / readings).is_multiple_of(2) { 1.15 } else { 0.85 }
    };
    for readings in [1, 2] {
        let rows: String = (0..STEPS)
            .map(|step| format!("{}\t{}\n", step as f64 / 10.0, alternating(step, readings)))
            .collect();
        let obs = directory.path().join(format!("alternating-{readings}.txt"));
        fs::write(obs, format!("e\tq\n{rows}")).unwrap();
    }
    let code = |obs: &str| {
        let locate = format!("-b {obs} -c e -v q -w weights.tsv --noise q=0.1 --verdict v.tsv base.tsv");
        let output = run(directory.path(), "gl-gap-locate", &locate);
        assert!(output.status.success(), "{}", stderr(&output));
        Verdicts::read(&directory.path().join("v.tsv")).unwrap().rows[0].code.clone()
    };
    assert_eq!(code("alternating-1.txt"), "alternates");
    assert_eq!(code("alternating-2.txt"), "alternates");
    // Smaller than the noise, and all on one side or the other.
    let wavy = |step: usize| 1.0 + 0.05 * (step as f64 / 6.0).sin();
    let rows: String = (0..STEPS).map(|step| format!("{}\t{}\n", step as f64 / 10.0, wavy(step))).collect();
    fs::write(directory.path().join("wavy.txt"), format!("e\tq\n{rows}")).unwrap();
    assert_eq!(code("wavy.txt"), "smooth");
    assert_eq!(code("obs.txt"), "gap");
}

#[test]
fn a_reading_that_is_said_to_be_far_off_is_in_no_gap() {
    let directory = directory();
    let obs = fs::read_to_string(directory.path().join("obs.txt")).unwrap();
    let mut rows: Vec<String> = obs.lines().map(str::to_owned).collect();
    rows[11] = "1\t4".to_owned();
    fs::write(directory.path().join("spoilt.txt"), rows.join("\n") + "\n").unwrap();
    fs::write(directory.path().join("far.tsv"), "observable\tstep\nq\t10\n").unwrap();
    let shrink = |more: &str| {
        let arguments = format!(
            "-b spoilt.txt -c e -v q --noise q=0.1 --before base.tsv,weights.tsv --after full.tsv,weights.tsv{more}"
        );
        table(&run(directory.path(), "gl-gap-shrink", &arguments)).numbers("shrink").unwrap()[0]
    };
    let (with, without) = (shrink(""), shrink(" --outliers far.tsv"));
    assert!(with < 0.9 && without > 0.98, "{with} {without}");
    let located = |more: &str| {
        let arguments = format!("-b spoilt.txt -c e -v q -w weights.tsv --noise q=0.1 full.tsv{more}");
        stderr(&run(directory.path(), "gl-gap-locate", &arguments))
    };
    assert!(located("").contains("at e 1 (100 % of it)"), "{}", located(""));
    assert!(located(" --outliers far.tsv").contains("No gap"), "{}", located(" --outliers far.tsv"));
    for (row, said) in
        [("p\t1", "far.tsv: no observable p"), ("q\t40", "far.tsv: step 40 of q is none of 0:40")]
    {
        fs::write(directory.path().join("far.tsv"), format!("observable\tstep\n{row}\n")).unwrap();
        let call = "-b spoilt.txt -c e -v q -w weights.tsv --noise q=0.1 full.tsv --outliers far.tsv";
        assert_refused(&run(directory.path(), "gl-gap-locate", call), &[said]);
    }
}

#[test]
fn what_is_concluded_of_a_shrink_has_a_code() {
    let directory = directory();
    let code = |after: &str| {
        let arguments = format!(
            "-b obs.txt -c e -v q --noise q=0.1 --before base.tsv,weights.tsv --after {after},weights.tsv --verdict v.tsv"
        );
        let output = run(directory.path(), "gl-gap-shrink", &arguments);
        assert!(output.status.success(), "{}", stderr(&output));
        let verdicts = Verdicts::read(&directory.path().join("v.tsv")).unwrap();
        (verdicts.rows[0].code.clone(), verdicts.rows[0].value.parse::<f64>().unwrap())
    };
    let (closes, share) = code("full.tsv");
    assert!(closes == "closes" && share > 0.97, "{closes} {share}");
    assert_eq!(code("base.tsv").0, "may-not-close");
}

#[test]
fn the_same_seed_locates_and_shrinks_to_the_same_bytes() {
    let directory = directory();
    let locate = "-b obs.txt -c e -v q -w weights.tsv --seed 3 base.tsv";
    let shrink = "-b obs.txt -c e -v q --before base.tsv,weights.tsv --after half.tsv,weights.tsv --seed 3";
    for (name, arguments) in [("gl-gap-locate", locate), ("gl-gap-shrink", shrink)] {
        let first = run(directory.path(), name, arguments);
        assert!(first.status.success() && first.stdout == run(directory.path(), name, arguments).stdout);
    }
}

#[test]
fn half_of_the_effect_closes_three_quarters_of_the_squared_gap() {
    let directory = directory();
    let shrink = |after: &str, more: &str| {
        let arguments = format!(
            "-b obs.txt -c e -v q --noise q=0.1 --before base.tsv,weights.tsv --after {after},weights.tsv{more}"
        );
        let output = run(directory.path(), "gl-gap-shrink", &arguments);
        let table = table(&output);
        assert_eq!((table.field(0, 0), table.field(1, 0), table.len()), ("q", "all", 2));
        let row: Vec<f64> = (1..7).map(|column| table.number(1, column).unwrap()).collect();
        (row, stderr(&output))
    };
    let (half, said) = shrink("half.tsv", "");
    assert!((half[3] - 0.75).abs() < 0.05 && half[4] < 0.75 && half[5] > 0.75, "{half:?}");
    assert!(said.contains("The gap closes by 7"), "{said}");
    let (full, _) = shrink("full.tsv", "");
    assert!(full[3] > 0.97 && full[4] > 0.9 && full[5] == 1.0, "{full:?}");
    let (unseen, _) = shrink("half.tsv", " --steps 25:40");
    assert!((unseen[3] - 0.75).abs() < 0.1 && unseen[0] > half[0], "{unseen:?}");
    let (others, said) = shrink("half.tsv", " --calibrated 0:25");
    assert_eq!(others, unseen);
    assert!(said.contains("On the steps that the calibrations did not see the gap closes by 7"), "{said}");
    let (both_ends, _) = shrink("half.tsv", " --calibrated 10:30");
    assert!((both_ends[3] - 0.75).abs() < 0.1, "{both_ends:?}");
    let (none, said) = shrink("half.tsv", " --steps 0:20");
    assert!(none[4] <= 0.0 && none[5] == 1.0, "{none:?}");
    assert!(said.contains("no gap to close") || said.contains("may not have closed"), "{said}");
}

#[test]
fn how_far_a_gap_closes_needs_no_parameters_in_the_weights() {
    let directory = directory();
    let write = |name: &str, text: String| fs::write(directory.path().join(name), text).unwrap();
    let names = || (0..12).map(|run| format!("r{run}"));
    let ensemble = |effect: f64| {
        let row = |run: &str, step: usize| {
            let rise = if step < 20 { 0.0 } else { effect };
            format!("{run}\t{step}\t{}\t{}\n", step as f64 / 10.0, 1.0 + rise)
        };
        let rows: String = names().flat_map(|run| (0..STEPS).map(move |step| row(&run, step))).collect();
        format!("sample\tstep\te\tq\n{rows}")
    };
    write("before.tsv", ensemble(0.0));
    write("after.tsv", ensemble(1.0));
    write("plain.tsv", names().fold("sample\tweight\n".to_owned(), |all, name| all + &name + "\t1\n"));
    let arguments =
        "-b obs.txt -c e -v q --noise q=0.1 --before before.tsv,plain.tsv --after after.tsv,plain.tsv";
    let shrinks = table(&run(directory.path(), "gl-gap-shrink", arguments));
    assert!(shrinks.number(0, 4).unwrap() > 0.97, "{shrinks:?}");
}

#[test]
fn an_ensemble_of_a_calibration_may_come_from_stdin() {
    let directory = directory();
    let call = |before: &str| {
        pipelines::tool("gl-gap-shrink")
            .args("-b obs.txt -c e -v q --noise q=0.1 --after full.tsv,weights.tsv --before".split(' '))
            .arg(before)
            .current_dir(directory.path())
            .write_stdin(fs::read(directory.path().join("base.tsv")).unwrap())
            .output()
            .unwrap()
    };
    let (piped, read) = (call("-,weights.tsv"), call("base.tsv,weights.tsv"));
    assert!(read.status.success() && piped.stdout == read.stdout, "{}", stderr(&piped));
    assert_refused(&call("-,-"), &["two inputs are to come from stdin"]);
}

#[test]
fn bad_input_is_refused_with_its_place() {
    let directory = directory();
    let write = |name: &str, text: &str| fs::write(directory.path().join(name), text).unwrap();
    let obs = fs::read_to_string(directory.path().join("obs.txt")).unwrap();
    write("short.txt", &obs.lines().take(30).map(|line| format!("{line}\n")).collect::<String>());
    write("shifted.txt", &obs.replace("\n3.9\t", "\n3.95\t"));
    write(
        "constant.txt",
        &(0..STEPS)
            .map(|i| format!("{}\t1\n", i as f64 / 10.0))
            .fold("e\tq\n".to_owned(), |all, row| all + &row),
    );
    write("one.txt", "e\tq\n0\t1\n");
    write("one.tsv", "sample\tstep\te\tq\nlow\t0\t0\t1\n");
    write("alone.tsv", "sample\tweight\nlow\t1\n");
    write("few.tsv", "sample\tweight\nlow\t1\nhigh\t1\n");

    let locate = |obs: &str, weights: &str, ensemble: &str| {
        run(directory.path(), "gl-gap-locate", &format!("-b {obs} -c e -v q -w {weights} {ensemble}"))
    };
    let shrink = |obs: &str, after: &str| {
        let arguments = format!("-b {obs} -c e -v q --before base.tsv,weights.tsv --after {after}");
        run(directory.path(), "gl-gap-shrink", &arguments)
    };
    assert_refused(
        &locate("short.txt", "weights.tsv", "base.tsv"),
        &["base.tsv: 40 steps", "short.txt has 29"],
    );
    assert_refused(&locate("shifted.txt", "weights.tsv", "base.tsv"), &["base.tsv: step 39 is at e 3.9"]);
    assert_refused(&locate("obs.txt", "few.tsv", "base.tsv"), &["few.tsv: no sample middle"]);
    assert_refused(
        &locate("obs.txt", "weights.tsv --noise q=0", "base.tsv"),
        &["noise of q is not positive"],
    );
    assert_refused(&locate("one.txt", "alone.tsv", "one.tsv"), &["one.txt: 1 steps", "--noise"]);
    assert_refused(&shrink("short.txt", "half.tsv,weights.tsv"), &["base.tsv: 40 steps"]);
    assert_refused(&shrink("obs.txt", "half.tsv,few.tsv"), &["few.tsv: no sample middle"]);
    assert_refused(&shrink("constant.txt", "half.tsv,weights.tsv"), &["constant.txt: q is constant"]);
    assert_refused(&shrink("obs.txt", "half.tsv"), &["half.tsv", "ENSEMBLE,WEIGHTS"]);
    assert_refused(&shrink("obs.txt", "half.tsv,weights.tsv --steps 40:50"), &["--steps", "end at 40"]);
    assert_refused(
        &shrink("obs.txt", "half.tsv,weights.tsv --calibrated :"),
        &["--calibrated", "saw them all"],
    );
    assert_refused(
        &shrink("obs.txt", "half.tsv,weights.tsv --scatter=-1"),
        &["--scatter <F>", "not negative"],
    );
    let known = locate("one.txt", "alone.tsv --noise q=0.1", "one.tsv");
    assert_eq!(table(&known).len(), 1);
    let constant = locate("constant.txt", "weights.tsv --noise q=0.1", "base.tsv");
    assert_eq!(table(&constant).field(0, 7), "no");
}

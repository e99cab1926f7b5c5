//! Input that is wrong, and what becomes of it: a message with its place and a remedy, exit code 2, and
//! nothing written; or a failed run with its reason.

use std::process::{Command, Stdio};
use std::time::Duration;

use pipelines::folder::Folder;
use pipelines::{line, path_with_tools, script};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LIKELIHOOD: &str = "gl-likelihood -b obs.txt -c x -v y ensemble.txt -o misfit.txt";
const COLLECT: &str =
    "gl-collect -s samples.txt -b obs.txt -c x -v y runs -o ensemble.txt --status status.txt";

/// A line with `n` samples that have run.
fn line_case(n: usize) -> Folder {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 1);
    folder.run(&format!("gl-sample -p params.txt -n {n} -o samples.txt"));
    line::simulate(&folder, "samples.txt", "runs");
    folder
}

/// A line whose ensemble is collected already.
fn collected(n: usize) -> Folder {
    let folder = line_case(n);
    folder.run(COLLECT);
    folder
}

fn with_obs(obs: &str) -> Folder {
    let folder = collected(6);
    folder.write("obs.txt", obs);
    folder
}

#[test]
fn a_missing_header_is_refused_with_its_line() {
    with_obs("x;y\n0;1\n").refuses(LIKELIHOOD, &["obs.txt:1: fields separated by semicolons", "tabs"]);
    with_obs("0 1\n1 2\n").refuses(LIKELIHOOD, &["obs.txt:1: no header", "must name the columns"]);
    with_obs("").refuses(LIKELIHOOD, &["obs.txt: empty"]);
}

#[test]
fn a_repeated_header_is_refused_by_name() {
    with_obs("x y y\n0 1 2\n").refuses(LIKELIHOOD, &["obs.txt:1: duplicate column y"]);
}

#[test]
fn a_padded_header_is_read() {
    let folder = collected(6);
    folder.run(LIKELIHOOD);
    let plain = folder.read("misfit.txt");
    let rows = folder.read("obs.txt").split_once('\n').unwrap().1.replace(' ', " , ");
    folder.write("obs.txt", format!("\n  #  x ,\t  y  \n{}", rows.replace(" , ", "\t  ")).replace(" ,", ""));
    folder.run(LIKELIHOOD);
    assert_eq!(folder.read("misfit.txt"), plain);
    folder.write("obs.txt", format!("  # x  ,   y  \n{rows}"));
    folder.run(LIKELIHOOD);
    assert_eq!(folder.read("misfit.txt"), plain);
}

#[test]
fn a_missing_column_is_refused_with_those_that_are_there() {
    with_obs("x z\n0 1\n").refuses(LIKELIHOOD, &["obs.txt:1: no column y; the columns are x, z"]);
}

#[test]
fn nan_and_words_in_the_measurement_are_refused_with_file_line_and_column() {
    with_obs("x y\n0 1\n\n1 NaN\n").refuses(LIKELIHOOD, &["obs.txt:4: column y: NaN"]);
    with_obs("x y\n0 1\ninf 1\n").refuses(LIKELIHOOD, &["obs.txt:3: column x: inf"]);
    with_obs("x y\n0 abc\n").refuses(LIKELIHOOD, &["obs.txt:2: column y: \"abc\" is not a number"]);
    with_obs("x y\n0 1 2\n").refuses(LIKELIHOOD, &["obs.txt:2: 3 fields where the header names 2"]);
}

#[test]
fn a_scale_of_zero_is_refused_with_one_that_serves() {
    let zeros = |peak: f64| {
        format!("x y\n{}", (0..20).map(|x| format!("{x} {}\n", -peak * f64::from(x))).collect::<String>())
    };
    let folder = with_obs(&zeros(1.0));
    folder.refuses(LIKELIHOOD, &["obs.txt: column y", "zero", "--scale range"]);
    folder.refuses(&format!("{LIKELIHOOD} --scale value"), &["step 0", "--scale max"]);
    folder.run(&format!("{LIKELIHOOD} --scale range"));
    with_obs(&zeros(0.0)).refuses(&format!("{LIKELIHOOD} --scale range"), &["column y", "zero"]);
}

#[test]
fn noise_and_weights_without_sense_are_refused() {
    let folder = collected(6);
    for (option, says) in [
        ("--noise y=0", "not positive"),
        ("--noise y=1e-200", "beyond what a number can say"),
        ("--noise z=1", "z"),
        ("--weights y=-1", "positive"),
        ("--weights q=1", "q"),
        ("--steps 30:40", "step"),
        ("--steps 5:5", "A:B"),
    ] {
        folder.refuses(&format!("{LIKELIHOOD} {option}"), &[says]);
    }
}

#[test]
fn standard_deviations_of_an_emulator_are_given_for_all_observables_and_none_is_negative() {
    let folder = Folder::default();
    folder.write("obs.txt", "x y z\n0 1 5\n1 2 7\n");
    let line = "gl-likelihood -b obs.txt -c x -v y,z ensemble.txt -o misfit.txt";
    folder.write("ensemble.txt", "sample step x y z y_sd\na 0 0 1 5 1\na 1 1 2 7 1\n");
    folder.refuses(line, &["ensemble.txt:1: y has a column y_sd, but z has none", "zeros"]);
    folder.write("ensemble.txt", "sample step x y z y_sd z_sd\na 0 0 1 5 1 0\na 1 1 2 7 1 -2\n");
    folder.refuses(line, &["ensemble.txt:3: column z_sd: -2, but a standard deviation is not negative"]);
}

#[test]
fn tolerances_and_counts_without_sense_are_refused() {
    let folder = weighed();
    for line in [
        "gl-sample -p params.txt -n 3 --threads 0",
        "gl-collect -s samples.txt -b obs.txt -c x -v y runs --rtol nan",
        "gl-collect -s samples.txt -b obs.txt -c x -v y runs --max-failed=-1",
        "gl-collect -s samples.txt -b obs.txt -c x -v y runs --end-tolerance inf",
        "gl-filter -s samples.txt misfit.txt --ess-runs nan",
        "gl-gmm-resample -p params.txt -n 3 weights.txt --deviation nan",
        "gl-check-stop --sigma-tol nan summary.txt",
    ] {
        folder.refuses(line, &["invalid value"]);
    }
}

#[test]
fn samples_outside_the_bounds_draw_no_others() {
    let folder = Folder::default();
    folder.write("params.txt", "name lower upper\na 0 1\n");
    let line = "gl-gmm-resample -p params.txt -n 50 --components 1 weights.txt -o next.txt";
    folder.write("weights.txt", "sample a weight\ns 5 1\nt 6 1\n");
    folder.refuses(line, &["weights.txt: no sample with weight lies within the bounds"]);
    let rows = |far: bool| {
        (0..40).map(|i| format!("s{i} {} 1\n", f64::from(i) / 80.0)).collect::<String>()
            + if far { "t 5 40\n" } else { "" }
    };
    folder.write("weights.txt", format!("sample a weight\n{}", rows(true)));
    folder.run(line);
    let narrowed = folder.column("next.txt", "a");
    folder.write("weights.txt", format!("sample a weight\n{}", rows(false)));
    folder.run(line);
    for (narrowed, alone) in narrowed.iter().zip(folder.column("next.txt", "a")) {
        assert!((narrowed - alone).abs() < 1e-9, "{narrowed} {alone}");
    }
}

/// What a run can be, and the reason that its failure gets.
#[test]
fn each_failed_run_has_its_reason_and_the_others_stay() {
    let folder = line_case(12);
    let names = folder.texts("samples.txt", "description");
    let sim = |i: usize| format!("runs/{}_sim.txt", names[i]);
    let param = |i: usize| format!("runs/{}_param.txt", names[i]);
    let good = folder.read(&sim(0));
    std::fs::remove_file(folder.path(&sim(1))).unwrap();
    folder.write(&sim(2), "");
    // Cut in the middle of the last number, which stays a number.
    folder.write(&sim(3), &folder.read(&sim(3))[..folder.read(&sim(3)).len() - 3]);
    folder.write(&sim(4), folder.read(&sim(4)).replacen("\n3 ", "\n3 nan\n#", 1));
    folder.write(&param(5), "a b\n0.3 0.3\n");
    folder.write(&sim(6), line::run((0..20).map(|x| 19.0 * (0.5 * f64::from(x)).sin()), 0.5, 4.0));
    folder.write(&sim(7), line::run((0..15).map(f64::from), 0.5, 4.0));
    folder.write(&sim(8), "x y\n");
    folder.write(&sim(9), good.replacen("x y", "x z", 1));
    std::fs::remove_file(folder.path(&param(10))).unwrap();
    folder.write(&sim(11), good.replacen("\n3 ", "\n3 a", 1));

    let stderr = folder.run(&format!("{COLLECT} --max-failed 0.95"));
    assert!(stderr.contains("11 of 12 runs failed") && stderr.contains(&names[1]), "{stderr}");
    let reasons = folder.texts("status.txt", "status");
    assert_eq!(
        reasons,
        [
            "ok",
            "missing",
            "empty",
            "truncated",
            "non-finite",
            "parameters",
            "control",
            "truncated",
            "empty",
            "malformed",
            "missing",
            "malformed"
        ]
    );
    let details = folder.texts("status.txt", "detail");
    assert!(details[4].contains(&format!("{}_sim.txt:5: column y: nan", names[4])), "{}", details[4]);
    assert!(details[5].contains("a is 0.3, not"), "{}", details[5]);
    assert!(details[7].contains("reaches 14 where the measurement goes to"), "{}", details[7]);
    assert!(details[9].contains("no column y"), "{}", details[9]);
    assert_eq!(folder.texts("ensemble.txt", "sample"), vec![names[0].clone(); 20]);
}

#[test]
fn too_many_failed_runs_are_an_error_that_says_where_the_reasons_are() {
    let folder = line_case(4);
    for name in &folder.texts("samples.txt", "description")[1..] {
        folder.write(&format!("runs/{name}_sim.txt"), "");
    }
    let line = COLLECT.replace(" --status status.txt", "");
    folder.refuses(&line, &["3 of 4 runs failed, more than --max-failed 0.5", "--status"]);
    folder.refuses(&line.replace("runs", "nowhere"), &["nowhere: cannot be read"]);
    folder.write(&format!("runs/{}_sim.txt", folder.texts("samples.txt", "description")[0]), "");
    folder.refuses(&format!("{line} --max-failed 1"), &["all 4 runs failed", "--status"]);
    folder.run(&format!("{line} --max-failed 1 --allow-empty"));
    assert_eq!(folder.table("ensemble.txt").len(), 0);
}

#[test]
fn a_run_on_another_control_grid_or_from_its_end_is_interpolated() {
    let folder = line_case(3);
    let samples = line::samples_of(&folder, "samples.txt");
    let sim = |i: usize| format!("runs/{}_sim.txt", samples[i].0);
    let (_, a, b) = samples[1];
    folder.write(&sim(1), line::run((0..101).map(|i| 0.19 * f64::from(i)), a, b));
    let (_, a, b) = samples[2];
    folder.write(&sim(2), line::run((0..20).rev().map(f64::from), a, b));
    folder.run(&format!("{COLLECT} --max-failed 0"));
    let y = folder.column("ensemble.txt", "y");
    for (i, (_, a, b)) in samples.iter().enumerate() {
        for x in 0..20 {
            let (here, there) = (y[20 * i + x], a * x as f64 + b);
            assert!((here - there).abs() < 1e-12 * there, "run {i}, x = {x}: {here} is not {there}");
        }
    }
}

#[test]
fn a_posterior_without_three_runs_in_ten_is_the_same() {
    let folder = line_case(1500);
    let posterior = |summary: &str| {
        folder.run(&format!("{COLLECT} --max-failed 0.4"));
        folder.run(&format!("{LIKELIHOOD} --noise y=0.3"));
        folder.run(&format!(
            "gl-filter -s samples.txt -p params.txt --sigma noise --summary {summary} misfit.txt -o weights.txt"
        ));
        ["mean(a)", "sd(a)", "mean(b)", "sd(b)"].map(|quantity| folder.quantity(summary, quantity))
    };
    let whole = posterior("whole.txt");
    let mut names = folder.texts("samples.txt", "description");
    names.shuffle(&mut ChaCha8Rng::seed_from_u64(3));
    for (i, name) in names[..450].iter().enumerate() {
        let sim = folder.path(&format!("runs/{name}_sim.txt"));
        match i % 3 {
            0 => std::fs::remove_file(sim).unwrap(),
            1 => std::fs::write(sim, "").unwrap(),
            _ => std::fs::write(sim, "x y\n0 nan\n").unwrap(),
        }
    }
    let rest = posterior("rest.txt");
    assert_eq!(folder.quantity("rest.txt", "failed"), 450.0);
    // About 30 runs hold the weight.
    for (mean, sd) in [(0, 1), (2, 3)] {
        assert!((rest[mean] - whole[mean]).abs() < 0.5 * whole[sd], "{whole:?} {rest:?}");
        assert!((rest[sd] / whole[sd]).ln().abs() < 0.35, "{whole:?} {rest:?}");
    }
}

#[test]
fn descriptions_that_could_do_harm_are_refused_before_anything_is_written() {
    for hostile in [
        "a/b", "../a", "a..b", ".a", "-rf", "a\"b", "a'b", "a;b", "$(id)", "`id`", "a|b", "a&b", "a*", "a>b",
        "a\\b", "ü",
    ] {
        let folder = collected(3);
        folder.write("samples.txt", format!("description key a b\ngood 0 0.5 4\n{hostile} 1 0.5 4\n"));
        let says = ["samples.txt:3: column description", "cannot name a run"];
        folder.refuses(COLLECT, &says);
        folder.refuses("gl-filter -s samples.txt --sigma 1 misfit.txt -o weights.txt", &says);
        folder.refuses("gl-contact -s samples.txt fresh", &says);
        let before = folder.files();
        let output = script("run-local")
            .arg(folder.path("samples.txt"))
            .args(["touch {description}_sim.txt"])
            .arg(folder.path("fresh"))
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{hostile}: {stderr}");
        assert!(stderr.contains("samples.txt:3: column description"), "{stderr}");
        assert_eq!(before, folder.files(), "{hostile}");
        let output = pipelines::tool("gl-sample")
            .args(["-n", "3", "--name", &format!("x{hostile}"), "-p"])
            .arg(folder.path("params.txt"))
            .output()
            .unwrap();
        let is_fine = matches!(hostile, ".a" | "-rf");
        assert_eq!(output.status.code(), Some(if is_fine { 0 } else { 2 }), "{hostile}");
    }
    // Blanks take a field more, or a quoted name that no table has.
    let folder = collected(3);
    folder.write("samples.txt", "description key a b\na b 1 0.5 4\n");
    folder.refuses(COLLECT, &["samples.txt:2: 5 fields where the header names 4"]);
    folder.write("samples.txt", "description,key,a,b\na b,1,0.5,4\n");
    folder.refuses(COLLECT, &["samples.txt:2: column description: \"a b\""]);
    folder.write("samples.txt", "description key a b\ns 0 .5 4\ns 1 .5 5\n");
    folder.refuses(COLLECT, &["samples.txt:3: column description: s is on line 2 already"]);
}

#[test]
fn priors_without_sense_are_refused() {
    let folder = Folder::default();
    for (params, says) in [
        (
            "name lower upper\nb 0 1\na 2 2\n",
            "params.txt:3: column upper: 2 is not above the lower bound 2 of a",
        ),
        ("name lower upper\na 3 2\n", "params.txt:2: column upper"),
        ("name lower upper\na -1e308 1e308\n", "params.txt:2: column upper: 1e308 lies further from -1e308"),
        (
            "name lower upper shape\na 1 2 log\n",
            "params.txt:1: unknown column shape; a table of parameters has name",
        ),
        (
            "name lower upper scale\na 1 2 logarithmic\n",
            "params.txt:2: column scale: \"logarithmic\" is neither linear nor log",
        ),
        ("name lower upper scale\na 0 2 log\n", "must be positive"),
        ("name lower upper\na 1 2\na 1 2\n", "params.txt:3: column name: duplicate a"),
        ("name lower upper\nkey 1 2\n", "choose another"),
        ("name lower upper mean sd\na 1 2 1 0\n", "params.txt:2: column sd: 0 is not positive"),
        ("name lower upper effect off\na 1 2 creep -\n", "params.txt:2: column off"),
        ("name lower\na 1\n", "params.txt:1: no column upper"),
        ("name lower upper\n", "no parameters"),
        ("name lower upper\na NaN 2\n", "params.txt:2: column lower: NaN"),
    ] {
        folder.write("params.txt", params);
        folder.refuses("gl-sample -p params.txt -n 4 -o samples.txt", &[says]);
    }
    folder.refuses("gl-sample -p nowhere.txt -n 4 -o samples.txt", &["nowhere.txt: cannot be opened"]);
}

#[test]
fn two_inputs_from_stdin_are_refused() {
    let folder = collected(3);
    folder.run(LIKELIHOOD);
    for (line, first) in [
        ("gl-collect -s - -b - -c x -v y runs", "description key a b\ns 0 1 2\n"),
        ("gl-likelihood -b - -c x -v y -", "x y\n0 1\n"),
        ("gl-filter -s - --ess 0.5 -", "description key a b\ns 0 1 2\n"),
        ("gl-gmm-resample -p - -n 3 -", "name lower upper\na 0 1\n"),
        ("gl-predict -w - -", "sample step x y\ns 0 0 1\n"),
    ] {
        folder.refuses_stdin(
            line,
            first,
            &["two inputs are to come from stdin", "give one of them as a file"],
        );
    }
}

/// Every tool that writes a table, on input that it takes.
const WRITERS: [&str; 7] = [
    "gl-sample -p params.txt -n 50000",
    "gl-collect -s samples.txt -b obs.txt -c x -v y runs",
    "gl-likelihood -b obs.txt -c x -v y ensemble.txt",
    "gl-filter -s samples.txt --ess 0.5 misfit.txt",
    "gl-predict ensemble.txt",
    "gl-gmm-resample -p params.txt -n 5000 weights.txt",
    "gl-check-stop --sigma-tol 1e9 summary.txt",
];

fn weighed() -> Folder {
    let folder = collected(200);
    folder.run(LIKELIHOOD);
    folder.run("gl-filter -s samples.txt --ess 0.5 --summary summary.txt misfit.txt -o weights.txt");
    folder
}

fn shell(folder: &Folder, line: &str) -> (Option<i32>, String) {
    let output = Command::new("bash")
        .args(["-c", &format!("set -o pipefail; {line}")])
        .env("PATH", path_with_tools())
        .current_dir(folder.path(""))
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_closed_pipe_is_a_quiet_success() {
    let folder = weighed();
    for line in WRITERS {
        let (code, stderr) = shell(&folder, &format!("{line} 2>stderr | true"));
        assert_eq!(code, Some(0), "{line}: {stderr}");
        let said = folder.read("stderr");
        assert!(!said.contains("roken pipe") && !said.contains("panicked"), "{line}: {said}");
    }
}

#[test]
fn a_full_disk_is_an_error() {
    let folder = weighed();
    for line in WRITERS {
        for full in [format!("{line} -o /dev/full"), format!("{line} >/dev/full")] {
            let (code, stderr) = shell(&folder, &full);
            assert_eq!(code, Some(2), "{full}: {stderr}");
            assert!(stderr.contains("cannot be written: No space left on device"), "{full}: {stderr}");
        }
    }
    let (code, stderr) =
        shell(&folder, "gl-filter -s samples.txt --ess 0.5 --summary /dev/full misfit.txt -o w.txt");
    assert_eq!(code, Some(2), "{stderr}");
    assert!(!folder.path("w.txt").exists());
}

#[test]
fn a_table_that_cannot_be_placed_is_an_error() {
    let folder = weighed();
    folder.refuses(
        "gl-sample -p params.txt -n 4 -o nowhere/samples.txt",
        &["nowhere/samples.txt: cannot be written"],
    );
    folder.refuses("gl-sample -p params.txt -n 4 -o runs", &["runs: is a directory"]);
}

#[test]
fn a_killed_writer_leaves_the_old_table_whole() {
    let folder = Folder::default();
    folder.write("params.txt", line::PARAMS).write("samples.txt", "old\n");
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut was_cut = 0;
    for _ in 0..12 {
        let mut child = Command::new("gl-sample")
            .args("-p params.txt -n 400000 -o samples.txt".split(' '))
            .env("PATH", path_with_tools())
            .current_dir(folder.path(""))
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(rng.random_range(20..500)));
        child.kill().unwrap();
        child.wait().unwrap();
        let text = folder.read("samples.txt");
        if text == "old\n" {
            was_cut += 1;
        } else {
            assert!(text.ends_with('\n') && text.lines().count() == 400_001);
            folder.write("samples.txt", "old\n");
        }
    }
    assert!(was_cut > 0, "no writer was killed before its end");
    folder.run("gl-sample -p params.txt -n 4 -o samples.txt");
    let files: Vec<_> = folder.files().into_keys().map(|file| file.display().to_string()).collect();
    assert_eq!(files, ["params.txt", "samples.txt"]);
}

#[test]
fn tables_without_rows_mean_no_rows() {
    let folder = line_case(2);
    folder.write("samples.txt", "description key a b\n");
    folder.run(COLLECT);
    assert_eq!(folder.read("ensemble.txt"), "sample\tstep\tx\ty\n");
    folder.run(LIKELIHOOD);
    assert!(folder.table("misfit.txt").is_empty());
    folder.refuses(
        "gl-filter -s samples.txt --ess 0.3 misfit.txt -o weights.txt",
        &["misfit.txt: no runs to weigh"],
    );
    folder.write("weights.txt", "sample a b weight\n");
    folder.refuses("gl-gmm-resample -p params.txt -n 4 weights.txt -o next.txt", &["weights.txt: no sample"]);
    folder.refuses("gl-predict -w weights.txt ensemble.txt -o prediction.txt", &[]);
    folder.write("obs.txt", "x y\n");
    folder.refuses(LIKELIHOOD, &["obs.txt: no rows"]);
}

#[test]
fn line_ends_byte_order_marks_and_commas_make_no_difference() {
    let folder = line_case(20);
    let pipeline = || {
        folder.run(COLLECT);
        folder.run(LIKELIHOOD);
        folder.run("gl-filter -s samples.txt -p params.txt --ess 0.5 misfit.txt -o weights.txt");
        folder.run("gl-gmm-resample -p params.txt -n 6 weights.txt -o next.txt");
        ["ensemble.txt", "misfit.txt", "weights.txt", "next.txt"].map(|file| folder.read(file))
    };
    let plain = pipeline();
    for file in ["params.txt", "obs.txt", "samples.txt"] {
        let text = folder.read(file).replace([' ', '\t'], ",").replace('\n', "\r\n");
        folder.write(file, format!("\u{feff}# {text}\r\n# the end\r\n"));
    }
    for name in folder.texts("samples.txt", "description") {
        for file in [format!("runs/{name}_sim.txt"), format!("runs/{name}_param.txt")] {
            let text = folder.read(&file).replace('\n', "\r\n").replace(' ', "\t  ");
            folder.write(&file, format!("\u{feff}{text}"));
        }
    }
    assert_eq!(pipeline(), plain);
    for file in ["ensemble.txt", "misfit.txt", "weights.txt"] {
        let text = folder.read(file).replace('\t', ",").replace('\n', "\r\n");
        folder.write(file, format!("\u{feff}{text}"));
    }
    folder.run("gl-gmm-resample -p params.txt -n 6 weights.txt -o next.txt");
    assert_eq!(folder.read("next.txt"), plain[3]);
    folder.run("gl-filter -s samples.txt -p params.txt --ess 0.5 misfit.txt -o weights.txt");
    assert_eq!(folder.read("weights.txt"), plain[2]);
    folder.run(LIKELIHOOD);
    assert_eq!(folder.read("misfit.txt"), plain[1]);
}

const FILTER: &str = "gl-filter -s samples.txt -p params.txt --summary summary.txt misfit.txt -o weights.txt";

#[test]
fn one_parameter_is_calibrated() {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 1);
    folder.write("params.txt", "name lower upper\na 0.1 1\n");
    folder.run("gl-sample -p params.txt -n 200 -o samples.txt");
    let table = folder.read("samples.txt").replace("\ta\n", "\ta\tb\n");
    let rows: Vec<&str> = table.lines().collect();
    folder.write("both.txt", rows[0].to_owned() + "\n" + &rows[1..].join("\t4\n") + "\t4\n");
    line::ensemble(&folder, "both.txt", "obs.txt", "ensemble.txt");
    folder.run(&format!("{LIKELIHOOD} --noise y=0.3"));
    folder.run(&format!("{FILTER} --sigma noise"));
    let (mean, sd) = (folder.quantity("summary.txt", "mean(a)"), folder.quantity("summary.txt", "sd(a)"));
    // Closed form: sd = noise / √Σx² = 0.3 / √2470.
    assert!((sd / (0.3 / 2470f64.sqrt())).ln().abs() < 0.5, "{sd}");
    assert!((mean - 0.5).abs() < 4.0 * sd, "{mean}");
    for covariance in ["full", "tied", "diag", "spherical"] {
        for sampling in ["slice", "mixture"] {
            folder.run(&format!(
                "gl-gmm-resample -p params.txt -n 30 --covariance {covariance} --sampling {sampling} weights.txt -o next.txt"
            ));
            assert!(folder.column("next.txt", "a").iter().all(|a| (0.1..=1.0).contains(a)));
        }
    }
}

#[test]
fn one_two_or_three_samples_give_a_result_or_a_reason() {
    for n in 1..4 {
        let folder = collected(n);
        folder.run(&format!("{LIKELIHOOD} --noise y=0.3"));
        let stderr = folder.run(&format!("{FILTER} --sigma noise"));
        assert!(stderr.contains("the weight rests on 1.0 runs"), "{stderr}");
        let width = folder.quantity("summary.txt", "q95(a)") - folder.quantity("summary.txt", "q05(a)");
        assert!(n < 2 || width > 0.1, "{n} samples: the interval of a is {width} wide");
        folder.run("gl-gmm-resample -p params.txt -n 10 weights.txt -o next.txt --proposal-out proposal.txt");
        assert_eq!(folder.table("next.txt").len(), 10);
    }
    let folder = collected(2);
    folder.run(LIKELIHOOD);
    folder.refuses(
        &format!("{FILTER} --ess 0.3"),
        &["--ess 0.3 of 2 runs is less than one run; make it larger than 0.5"],
    );
}

#[test]
fn runs_that_are_all_alike_are_said_so() {
    let folder = line_case(9);
    for name in folder.texts("samples.txt", "description") {
        folder.write(&format!("runs/{name}_sim.txt"), line::run((0..20).map(f64::from), 0.5, 4.0));
    }
    folder.run(COLLECT);
    folder.run(LIKELIHOOD);
    folder.refuses(
        &format!("{FILTER} --ess 0.3"),
        &["all 9 runs have the same misfit", "do the parameters change the observables?"],
    );
    folder.run(&format!("{FILTER} --sigma noise"));
    assert!(folder.quantity("summary.txt", "shrinkage(a)") < 0.3);
    folder.run("gl-gmm-resample -p params.txt -n 10 weights.txt -o next.txt");
}

//! The calibration loop: it ends at the truth, and whatever happens to it, it ends with the same bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Instant, SystemTime};

use pipelines::calibration::{
    STIFFNESS, calibrate, copy_case, driver, finish, kill_group, posterior, stiffness, tables,
};
use pipelines::folder::Folder;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[test]
fn the_collision_is_calibrated_to_one_percent() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    let (stdout, stderr) = finish(&mut calibrate(&folder, "embedded", "out"));
    let (mean, sd) = stiffness(&folder, "out");
    assert!((mean / STIFFNESS - 1.0).abs() < 0.01, "{mean} is not {STIFFNESS}");
    assert!(sd / STIFFNESS < 0.01, "{sd}");
    assert!(stdout.starts_with("iteration 0: 10 runs, 0 failed; the emulator leaves "), "{stdout}");
    assert!(stdout.contains("parameter") && stdout.contains("best run collision_Iter"), "{stdout}");
    assert!(stderr.contains("stop, by settled"), "{stderr}");
    let runs = folder.quantity("out/posterior.txt", "runs");
    assert!(runs <= 26.0, "{runs} runs");
    assert_eq!(folder.texts("out/posterior-runs-weights.txt", "sample").len() as f64, runs);
    assert_eq!(folder.texts("out/posterior-weights.txt", "sample").len(), 1000);
}

#[test]
fn the_weights_of_real_runs_alone_are_a_setting() {
    for (key, value) in [("posterior", "\"runs\""), ("emulated", "0"), ("posterior", "\"weights\"")] {
        let folder = Folder::default();
        copy_case(&folder, "collision", &[(key, value), ("num", "30"), ("iterations", "2")]);
        let (stdout, _) = finish(&mut calibrate(&folder, "embedded", "out"));
        assert!(stdout.starts_with("iteration 0: 30 runs, 0 failed; sigma "), "{stdout}");
        assert_eq!(folder.read("out/posterior.txt"), folder.read("out/posterior-runs.txt"));
        let weights = folder.texts("out/posterior-weights.txt", "sample");
        assert_eq!(weights, folder.texts("out/posterior-runs-weights.txt", "sample"));
        assert_eq!(folder.path("out/iter0/emulated-weights.txt").exists(), value == "\"weights\"");
    }
}

#[test]
fn where_no_emulator_can_be_trained_the_runs_have_to_do_and_it_is_said() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &[("num", "3"), ("iterations", "3")]);
    let (stdout, stderr) = finish(&mut calibrate(&folder, "local", "out"));
    assert!(stderr.contains("by the weights of the runs"), "{stdout}{stderr}");
    assert!(folder.read("out/iter0/emulator.log").contains("an emulator needs at least"));
    assert!(folder.read("out/iter0/fallback.txt").contains("no emulator"));
    assert!(stdout.contains("iteration 2: 9 runs, 0 failed; sigma "), "{stdout}");
    assert_eq!(folder.texts("out/posterior-weights.txt", "sample").len(), 9);
    // Called again it finds everything as it was.
    let before = folder.files();
    finish(&mut calibrate(&folder, "local", "out"));
    assert_eq!(before, folder.files());
}

/// An emulator that did for a while may do no more: the batches that it asked for are weighed all the same.
#[test]
fn batches_of_an_emulator_are_weighed_where_the_runs_have_to_do() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[("iterations", "2")]);
    finish(&mut calibrate(&folder, "embedded", "out"));
    // As if the last iteration had found it unfit.
    let verdict = folder.read("out/iter1/posterior-verdict.txt")
        + "emulator-unfit\t1\tno emulator follows this simulator\n";
    folder.write("out/iter1/posterior-verdict.txt", verdict);
    let (stdout, stderr) = finish(calibrate(&folder, "embedded", "out").args(["--until", "3"]));
    assert!(stderr.contains("no emulator follows this simulator; from here on by the weights"), "{stderr}");
    assert!(stdout.contains("iteration 2: 44 runs, 0 failed; sigma "), "{stdout}");
    assert!(folder.path("out/iter1/proposal.txt").exists());
    assert_eq!(folder.texts("out/posterior-weights.txt", "sample").len(), 44);
}

/// Normal load alone does not see nu, which stays as its uniform prior on 0 to 0.5 has it, with a standard
/// deviation of 0.144: the iterations must not narrow what no data have narrowed.
#[test]
fn what_the_data_cannot_tell_stays_uncertain() {
    let (mut held, mut said, mut sds) = (0, 0, Vec::new());
    for seed in 1..6 {
        let folder = Folder::default();
        copy_case(&folder, "collision", &[("seed", &seed.to_string())]);
        let (_, stderr) = finish(&mut calibrate(&folder, "embedded", "out"));
        said += u32::from(stderr.contains("the measurement says little of nu"));
        let summary = posterior(&folder, "out");
        let nu = |quantity: &str| folder.quantity(&summary, &format!("{quantity}(nu)"));
        sds.push(nu("sd"));
        held += u32::from((nu("q05")..=nu("q95")).contains(&0.2));
    }
    let mean = sds.iter().sum::<f64>() / sds.len() as f64;
    assert!((0.125..0.165).contains(&mean), "standard deviations {sds:?}");
    assert!(sds.iter().all(|sd| (0.1..0.2).contains(sd)), "standard deviations {sds:?}");
    assert!(held >= 4, "{held} of 5 intervals hold the truth");
    assert!(said >= 4, "said {said} times of 5");
}

/// Emulated samples between the iterations: 30 runs an iteration, and the ridge is found by the fifth.
#[test]
fn emulated_samples_save_iterations() {
    let iterations = |emulated: &str| {
        let folder = Folder::default();
        copy_case(&folder, "collision", &[("emulated", emulated), ("num", "30"), ("iterations", "10")]);
        finish(&mut calibrate(&folder, "embedded", "out"));
        assert_eq!(folder.path("out/iter0/emulated-weights.txt").exists(), emulated != "0");
        (0..).take_while(|i| folder.path(&format!("out/iter{i}/stop.code")).exists()).count()
    };
    let (with, without) = (iterations("1000"), iterations("0"));
    assert!(with <= 5 && with < without, "{with} with, {without} without");
}

#[test]
fn a_line_by_a_command_a_run_is_calibrated_to_its_closed_form() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &[]);
    finish(&mut calibrate(&folder, "local", "out"));
    // Ordinary least squares of examples/linear/obs.txt with noise 0.2.
    let (x, y) = (folder.column("case/obs.txt", "x"), folder.column("case/obs.txt", "y"));
    let (n, sx, sy) = (x.len() as f64, x.iter().sum::<f64>(), y.iter().sum::<f64>());
    let sxx: f64 = x.iter().map(|x| x * x).sum();
    let sxy: f64 = x.iter().zip(&y).map(|(x, y)| x * y).sum();
    let det = n * sxx - sx * sx;
    let file = posterior(&folder, "out");
    for (name, mean, variance) in
        [("a", (n * sxy - sx * sy) / det, n / det), ("b", (sxx * sy - sx * sxy) / det, sxx / det)]
    {
        let sd = 0.2 * f64::sqrt(variance);
        let found = |quantity: &str| folder.quantity(&file, &format!("{quantity}({name})"));
        assert!((found("mean") - mean).abs() < 0.5 * sd, "{name}: {} is not {mean}", found("mean"));
        assert!((found("sd") / sd).ln().abs() < 0.35, "{name}: {} is not {sd}", found("sd"));
    }
}

#[test]
fn the_number_of_threads_makes_no_difference() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[("iterations", "2")]);
    for threads in ["1", "2"] {
        finish(calibrate(&folder, "embedded", threads).env("RAYON_NUM_THREADS", threads));
    }
    assert_eq!(tables(&folder, "1"), tables(&folder, "2"));
}

/// When each finished run was written.
fn written(folder: &Folder, out: &str) -> Vec<(PathBuf, SystemTime)> {
    let mut times = Vec::new();
    for i in 0.. {
        let Ok(entries) = std::fs::read_dir(folder.path(&format!("{out}/iter{i}/runs"))) else { break };
        for entry in entries.map(Result::unwrap) {
            if entry.file_name().to_string_lossy().ends_with("_sim.txt") {
                times.push((entry.path(), entry.metadata().unwrap().modified().unwrap()));
            }
        }
    }
    times
}

/// The finished runs in packed files, one entry for each time that one was packed.
fn packed(folder: &Folder, out: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (path, bytes) in folder.files() {
        let path = path.display().to_string();
        if !(path.starts_with(&format!("{out}/")) && path.ends_with("_packed.txt")) {
            continue;
        }
        let mut rest = String::from_utf8(bytes).unwrap();
        while let Some((head, after)) = rest.split_once('\n') {
            let [_, _, name, size] = head.split(' ').collect::<Vec<_>>()[..] else {
                panic!("{path}: {head}")
            };
            let Some(after) = after.get(size.parse::<usize>().unwrap() + 1..) else { break };
            names.extend(name.strip_suffix("_sim.txt").map(str::to_owned));
            rest = after.to_owned();
        }
    }
    names
}

/// Kill calibrations at random moments, `kills` times in all. Each is started again until it ends, when its
/// tables are those of one left in peace, whose folder is returned; then the next is begun.
fn survives(case: &str, engine: &str, settings: &[(&str, &str)], kills: usize, seed: u64) -> Folder {
    let folder = Folder::default();
    copy_case(&folder, case, settings);
    let is_packed = settings.contains(&("packed", "true"));
    let start = Instant::now();
    finish(&mut calibrate(&folder, engine, "whole"));
    let longest = start.elapsed().mul_f64(0.4);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut killed, mut among_runs) = (0, 0);
    for out in (0..).map(|i| format!("cut{i}")) {
        let mut before = Vec::new();
        let mut is_over = false;
        while !is_over {
            let mut command = calibrate(&folder, engine, &out);
            let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            if killed < kills {
                sleep(longest.mul_f64(rng.random()));
                kill_group(&mut child);
            }
            let status = child.wait().unwrap();
            is_over = status.signal().is_none();
            assert!(!is_over || status.success(), "{status}");
            killed += usize::from(!is_over);
            among_runs += usize::from(!is_over && runs_are_made(&folder, &out));
            let after = written(&folder, &out);
            for run in &before {
                assert!(after.contains(run), "{} was run again", run.0.display());
            }
            before = after;
        }
        let (whole, cut) = (tables(&folder, "whole"), tables(&folder, &out));
        for (file, bytes) in &whole {
            assert!(cut[file] == *bytes, "{} of {out} differs", file.display());
        }
        let (whole, cut) = (file_names(&folder, "whole"), file_names(&folder, &out));
        let strays: Vec<_> = whole.symmetric_difference(&cut).collect();
        assert!(strays.is_empty(), "not in both: {strays:?}");
        if is_packed {
            let mut runs = packed(&folder, &out);
            runs.sort();
            assert!(runs.is_sorted_by(|one, next| one < next), "run again: {runs:?}");
        }
        if killed >= kills {
            // The embedded simulator's runs are over before one is likely to be hit.
            let is_hit = engine == "embedded" || among_runs > 0;
            assert!(is_hit, "{among_runs} of {kills} kills fell among the runs");
            break;
        }
    }
    folder
}

/// Whether the runs of the last iteration are not collected yet.
fn runs_are_made(folder: &Folder, out: &str) -> bool {
    let iterations =
        (0..).map(|i| format!("{out}/iter{i}")).take_while(|iteration| folder.path(iteration).exists());
    iterations.last().is_some_and(|iteration| !folder.path(&format!("{iteration}/ensemble.txt")).exists())
}

/// All files of a calibration; packed files, whose names and number are a matter of chance, as one.
fn file_names(folder: &Folder, out: &str) -> BTreeSet<PathBuf> {
    let files = folder.files().into_keys();
    files
        .filter_map(|file| file.strip_prefix(out).map(PathBuf::from).ok())
        .map(|file| {
            if file.display().to_string().ends_with("_packed.txt") {
                file.with_file_name("packed")
            } else {
                file
            }
        })
        .collect()
}

#[test]
fn a_calibration_killed_at_any_moment_ends_with_the_same_bytes() {
    survives("collision", "embedded", &[("num", "20"), ("iterations", "2")], 12, 1);
}

/// Sixty kills, which leave nothing behind and lose nothing.
#[test]
fn a_calibration_of_processes_killed_at_any_moment_ends_with_the_same_bytes() {
    survives("linear", "local", &[("num", "24"), ("iterations", "2"), ("emulated", "50")], 60, 2);
}

#[test]
fn packed_runs_killed_at_any_moment_end_with_the_bytes_of_loose_ones() {
    let settings = [("num", "24"), ("iterations", "2"), ("emulated", "50"), ("packed", "false")];
    let loose = Folder::default();
    copy_case(&loose, "linear", &settings);
    finish(&mut calibrate(&loose, "local", "whole"));
    let packed =
        survives("linear", "local", &[settings[0], settings[1], settings[2], ("packed", "true")], 20, 3);
    assert_eq!(tables(&loose, "whole"), tables(&packed, "whole"));
}

#[test]
fn a_calibration_that_is_done_runs_nothing_again() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    finish(&mut calibrate(&folder, "embedded", "out"));
    let (before, runs) = (folder.files(), written(&folder, "out"));
    finish(&mut calibrate(&folder, "embedded", "out"));
    assert_eq!(before, folder.files());
    assert_eq!(runs, written(&folder, "out"));
}

#[test]
fn iterations_are_limited_and_added() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    let iterations = || (0..).take_while(|i| folder.path(&format!("out/iter{i}/stop.code")).exists()).count();
    let (_, stderr) = finish(calibrate(&folder, "embedded", "out").args(["--iterations", "2"]));
    assert_eq!(iterations(), 2);
    assert!(stderr.contains("stop, by iterations"), "{stderr}");
    assert!(stderr.contains("the posterior is not settled"), "{stderr}");
    let first = tables(&folder, "out");
    finish(calibrate(&folder, "embedded", "out").args(["--more", "2"]));
    assert_eq!(iterations(), 4);
    let after = tables(&folder, "out");
    assert!(of_iterations(&first).all(|(file, bytes)| after[file] == *bytes));
    assert_eq!(folder.quantity("out/iter3/posterior.txt", "runs"), 22.0);
}

/// The tables of single iterations, without those that a calibration ends with.
fn of_iterations(tables: &BTreeMap<PathBuf, Vec<u8>>) -> impl Iterator<Item = (&PathBuf, &Vec<u8>)> {
    tables.iter().filter(|(file, _)| file.parent().is_some_and(|parent| !parent.as_os_str().is_empty()))
}

fn iterate(folder: &Folder, arguments: &str, iteration: usize) -> (Option<i32>, String, String) {
    let mut command = driver(folder, "gl-iterate");
    let output = command
        .args(arguments.split(' '))
        .args(["--out", "out", "--iteration", &iteration.to_string()])
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn runs_made_elsewhere_give_the_same_tables_iteration_by_iteration() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    finish(calibrate(&folder, "embedded", "whole").args(["--iterations", "2"]));
    folder.run("gl-sample -p case/params.txt -n 10 --method sobol --name collision -o mine.txt");
    folder.run("gl-contact -s mine.txt mine");
    let (code, stdout, stderr) = iterate(&folder, "case mine.txt mine", 0);
    assert_eq!(code, Some(1), "{stdout}{stderr}");
    assert!(stdout.contains("iteration 0: 10 runs, 0 failed"), "{stdout}");
    assert!(stdout.ends_with("next samples: out/iter1/samples.txt\n"), "{stdout}");
    folder.run("gl-contact -s out/iter1/samples.txt next");
    let (code, stdout, stderr) = iterate(&folder, "case out/iter1/samples.txt next", 1);
    assert!(code < Some(2), "{stdout}{stderr}");
    let (whole, out) = (tables(&folder, "whole"), tables(&folder, "out"));
    for (file, bytes) in of_iterations(&whole) {
        assert!(out[file] == *bytes, "{} differs", file.display());
    }
    // A run that is there now and failed before is taken in.
    let run = folder.path("next/collision_Iter1_Sample0_sim.txt");
    let text = std::fs::read(&run).unwrap();
    std::fs::remove_file(&run).unwrap();
    iterate(&folder, "case out/iter1/samples.txt next", 1);
    assert_eq!(folder.quantity("out/iter1/posterior.txt", "failed"), 1.0);
    std::fs::write(&run, text).unwrap();
    iterate(&folder, "case out/iter1/samples.txt next", 1);
    assert_eq!(folder.quantity("out/iter1/posterior.txt", "failed"), 0.0);
}

#[test]
fn a_wrong_call_says_what_is_wrong() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    let refused = |arguments: &[&str], says: &str| {
        let output = driver(&folder, "gl-calibrate").args(arguments).output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(says), "{arguments:?}: {message}");
    };
    refused(&["case", "--engine", "slrum"], "no engine slrum: did you mean slurm?");
    refused(&["case", "--engine", ""], "no engine");
    refused(&["case", "--iterations", "ten"], "from 1");
    refused(&["case", "--more", "0"], "from 1");
    refused(&["case", "nmu=3"], "nmu: did you mean num?");
    refused(&["num=3"], "num=3: is no folder of a case; CASE comes first");
    refused(&["nowhere"], "nowhere/case.toml: no such case");
    for (arguments, iteration, says) in [
        ("nowhere mine.txt runs", 0, "nowhere/case.toml: no such case"),
        ("case nowhere.txt runs", 0, "nowhere.txt: no such samples table"),
        ("case case/obs.txt runs", 0, "runs: no such folder of runs"),
        ("case case/obs.txt case", 1, "do iteration 0 first"),
    ] {
        let (code, _, stderr) = iterate(&folder, arguments, iteration);
        assert_eq!(code, Some(2), "{arguments}");
        assert!(stderr.contains(says), "{arguments}: {stderr}");
    }
    assert!(!folder.path("out").exists());
}

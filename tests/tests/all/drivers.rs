//! The drivers: what they are called with, what they leave, and where they work.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::SystemTime;

use pipelines::calibration::{calibrate, copy_case, driver, finish, set, tables};
use pipelines::folder::Folder;
use pipelines::{programs, require, root};

const SMALL: [(&str, &str); 2] = [("num", "8"), ("iterations", "1")];

/// The settings of the smallest diagnosis. Its calibrations rest on real runs alone: through an emulator they take ten times
/// as long.
const SMALL_DIAGNOSIS: [(&str, &str); 4] =
    [("num", "20"), ("iterations", "2"), ("design_num", "60"), ("posterior", "\"weights\"")];

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// `make` of the project, which takes what is built as it is.
fn make(folder: &Folder, arguments: &[&str]) -> Output {
    folder.write("bin/cargo", "#!/bin/sh\n");
    fs::set_permissions(folder.path("bin/cargo"), fs::Permissions::from_mode(0o755)).unwrap();
    let path = std::env::var("PATH").unwrap();
    Command::new("make")
        .arg("-C")
        .arg(root().canonicalize().unwrap())
        .args(arguments)
        .env("PATH", format!("{}:{path}", folder.path("bin").display()))
        .env("CARGO_TARGET_DIR", programs().parent().unwrap())
        .env_remove("MAKEFLAGS")
        .env_remove("MAKELEVEL")
        .output()
        .unwrap()
}

/// The tables of a calibration, without what it was called with.
fn results(folder: &Folder, out: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = tables(folder, out);
    files.retain(|file, _| !file.ends_with("settings.toml"));
    files
}

fn rows(folder: &Folder, file: &str) -> usize {
    folder.table(file).len()
}

/// When each file below a folder was written.
fn times(folder: &Folder, out: &str) -> BTreeMap<PathBuf, SystemTime> {
    // Who drives it now is another one each time.
    let files = folder.files().into_keys().filter(|file| file.starts_with(out) && !file.ends_with(".lock"));
    files
        .map(|file| (file.clone(), fs::metadata(folder.path("").join(&file)).unwrap().modified().unwrap()))
        .collect()
}

#[test]
fn what_a_call_does_not_come_to_is_set_aside_and_taken_up_again() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &[("num", "8")]);
    let three = ["--iterations", "3"];
    finish(calibrate(&folder, "local", "out").args(three));
    let (whole, made) = (results(&folder, "out"), times(&folder, "out/iter2/runs"));
    let (_, said) = finish(calibrate(&folder, "local", "out").args(["--iterations", "1"]));
    assert!(said.contains("out/iter1 was made by another call"), "{said}");
    finish(calibrate(&folder, "local", "one").args(["--iterations", "1"]));
    let mut short = results(&folder, "out");
    short.retain(|file, _| !file.to_string_lossy().contains(".aside/"));
    assert_eq!(short, results(&folder, "one"));
    finish(calibrate(&folder, "local", "out").args(three));
    assert_eq!(results(&folder, "out"), whole);
    assert_eq!(times(&folder, "out/iter2/runs"), made);
}

#[test]
fn the_results_of_another_case_are_not_overwritten() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &SMALL);
    finish(&mut calibrate(&folder, "local", "out"));
    let before = folder.files();
    set(&folder, &[("name", "\"another\"")]);
    let output = calibrate(&folder, "local", "out").output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = text(&output.stderr);
    assert!(
        said.contains("the results of another case in it, linear (settings.toml), and this is another"),
        "{said}"
    );
    let is_result = |file: &PathBuf| file.starts_with("out") && !file.ends_with(".lock");
    let kept = |files: BTreeMap<PathBuf, Vec<u8>>| -> BTreeMap<PathBuf, Vec<u8>> {
        files.into_iter().filter(|(file, _)| is_result(file)).collect()
    };
    assert_eq!(kept(folder.files()), kept(before));
}

#[test]
fn a_calibration_goes_on_though_nobody_reads_what_it_says() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &SMALL);
    let mut child = calibrate(&folder, "local", "out").stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
    assert!(folder.path("out/posterior.txt").exists());
}

#[test]
fn settings_of_the_call_of_make_and_of_the_case_are_the_same_settings() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &SMALL);
    let given = ["NUM=12", "seed=5", "Noise=y=0.3", "--iterations", "2"];
    finish(calibrate(&folder, "local", "call").args(given));
    let path = |name: &str| folder.path(name).display().to_string();
    let (case, out) = (format!("CASE={}", path("case")), format!("OUT={}", path("make")));
    let output = make(
        &folder,
        &["calibrate", &case, &out, "ENGINE=local", "NUM=12", "SEED=5", "NOISE=y=0.3", "ITERATIONS=2"],
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    set(&folder, &[("num", "12"), ("seed", "5"), ("noise", "{ y = 0.3 }"), ("iterations", "2")]);
    finish(&mut calibrate(&folder, "local", "own"));
    let expected = results(&folder, "call");
    assert!(expected.contains_key(Path::new("iter1/posterior.txt")));
    for out in ["make", "own"] {
        let found = results(&folder, out);
        assert_eq!(expected.keys().collect::<Vec<_>>(), found.keys().collect::<Vec<_>>());
        for (file, bytes) in &expected {
            assert!(found[file] == *bytes, "{out}: {} differs", file.display());
        }
    }
}

#[test]
fn other_settings_are_computed_anew_and_the_same_are_not() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &SMALL);
    finish(&mut calibrate(&folder, "local", "fit"));
    let before = times(&folder, "fit/iter0/runs");
    finish(calibrate(&folder, "local", "fit").arg("num=10"));
    assert_eq!(rows(&folder, "fit/iter0/samples.txt"), 10);
    let is_simulation = |file: &Path| file.display().to_string().ends_with("_sim.txt");
    let after = times(&folder, "fit/iter0/runs");
    let new = after.iter().filter(|(file, time)| is_simulation(file) && before.get(*file) != Some(time));
    assert_eq!(new.count(), 2, "eight of the samples are the same");
    let after = times(&folder, "fit");
    finish(calibrate(&folder, "local", "fit").arg("num=10"));
    assert!(after == times(&folder, "fit"));
}

#[test]
fn an_effect_that_is_given_is_in() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL);
    finish(&mut calibrate(&folder, "embedded", "without"));
    finish(calibrate(&folder, "embedded", "with").arg("effects=adhesion"));
    let values = |out: &str| {
        let mut values = folder.column(&format!("{out}/iter0/samples.txt"), "w");
        values.sort_by(f64::total_cmp);
        values.dedup();
        values.len()
    };
    assert_eq!((values("without"), values("with")), (1, 8));
}

#[test]
fn a_path_may_have_any_name_but_make_takes_none_with_blanks() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &SMALL);
    for name in ["a b", "a$b", "a%b", "a#b", "a'b"] {
        fs::rename(folder.path("case"), folder.path(name)).unwrap();
        let out = format!("fit {name}");
        finish(driver(&folder, "gl-calibrate").args([name, "--out", &out]));
        assert!(folder.path(&format!("{out}/posterior.txt")).exists(), "{name}");
        fs::rename(folder.path(name), folder.path("case")).unwrap();
    }
    for target in ["calibrate", "diagnose", "check"] {
        let output = make(&folder, &[target, "CASE=/a b"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains("CASE=/a b: a path with blanks cannot go through make"));
    }
    // Where it was called from does not matter, nor that no folder was named for the results.
    finish(driver(&folder, "gl-calibrate").arg(".").current_dir(folder.path("case")));
    assert!(folder.path("case/out/case/posterior.txt").exists());
}

/// Open MPI without a daemon beside each run, and without a folder that runs share at the same time and that the first to
/// end deletes.
const ONE_PROCESS: [(&str, &str); 2] =
    [("OMPI_MCA_ess_singleton_isolated", "1"), ("OMPI_MCA_orte_create_session_dirs", "0")];

#[test]
fn a_calibration_by_lammps_is_that_of_the_embedded_simulator() {
    if !require("lmp") {
        return;
    }
    let folder = Folder::default();
    // Where an emulator asks for the next runs, the fifth digit of a curve decides which; weights follow it smoothly.
    copy_case(&folder, "collision", &[("iterations", "2"), ("posterior", "\"runs\"")]);
    finish(&mut calibrate(&folder, "embedded", "embedded"));
    // What may go wrong on a machine while `lmp` starts is none of it: once more.
    folder.write("case/twice", "#!/bin/sh\n\"$@\" || \"$@\"\n");
    let model = "model=sh {case}/twice lmp -in {case}/lammps.in -log none -screen none -var E_m {E_m} -var nu {nu} -var name {description}";
    let (_, said) = finish(calibrate(&folder, "local", "lammps").arg(model).envs(ONE_PROCESS));
    assert_eq!(folder.quantity("lammps/posterior.txt", "failed"), 0.0, "{said}");
    for name in ["E_m", "nu"] {
        for kind in ["mean", "sd", "q05", "q95"] {
            let of = |out: &str| folder.quantity(&format!("{out}/posterior.txt"), &format!("{kind}({name})"));
            let (found, expected) = (of("lammps"), of("embedded"));
            assert!((found - expected).abs() <= 1e-4 * expected, "{kind}({name}): {found} for {expected}");
        }
    }
}

#[test]
fn two_spheres_in_lammps_go_as_in_the_embedded_simulator() {
    if !require("lmp") {
        return;
    }
    let folder = Folder::default();
    let script = root().canonicalize().unwrap().join("examples/contact-effects/lammps/contact.in");
    for (work, name) in [("0", "base"), ("4", "adhesive")] {
        let values = [
            ("form", "own"),
            ("E_m", "9.2"),
            ("nu", "0.3"),
            ("mu", "0.45"),
            ("w", work),
            ("tau", "0"),
            ("slip", "1"),
            ("rho", "2650"),
            ("name", name),
        ];
        let mut lammps = Command::new("lmp");
        lammps.arg("-in").arg(&script).args(["-log", "none", "-screen", "none"]);
        for (name, value) in values {
            lammps.args(["-var", name, value]);
        }
        lammps.envs(ONE_PROCESS).current_dir(folder.path(""));
        finish(&mut lammps);
        folder.run(&format!(
            "gl-contact --programme cycles --curve E_m=9.2,nu=0.3,mu=0.45,w={work} -o {name}.txt"
        ));
        // The tangential force within what the steps of integration leave. In LAMMPS spheres without an overlap do not
        // touch yet.
        for (observable, tolerance) in [("f", 1e-9), ("t", 1e-3)] {
            let found = folder.column(&format!("{name}_sim.txt"), observable);
            let expected = folder.column(&format!("{name}.txt"), observable);
            assert_eq!(found.len(), expected.len());
            for (step, (found, expected)) in found.iter().zip(&expected).enumerate().skip(1) {
                assert!(
                    (found - expected).abs() < tolerance,
                    "{name} {observable} {step}: {found} {expected}"
                );
            }
        }
    }
}

#[test]
fn each_call_is_noted_as_it_is_typed() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &SMALL);
    finish(calibrate(&folder, "embedded", "fit").arg("posterior=weights"));
    let log = folder.read("fit/commands.log");
    let call = log.lines().find(|line| line.starts_with("gl-likelihood ")).unwrap();
    let before = folder.read("fit/iter0/misfit.txt");
    fs::remove_file(folder.path("fit/iter0/misfit.txt")).unwrap();
    folder.run(call);
    assert_eq!(before, folder.read("fit/iter0/misfit.txt"));
    let run = "gl-run embedded --case case --times fit/iter0/runs/times.txt -- fit/iter0/samples.txt";
    assert!(log.lines().any(|line| line.starts_with(run)), "{log}");
}

#[test]
fn a_case_that_cannot_run_is_refused_before_the_first_run_with_all_that_is_wrong() {
    let wrong = |settings: &[(&str, &str)], files: &[(&str, &str)], engine: &str, says: &[&str]| {
        let folder = Folder::default();
        copy_case(&folder, "collision", settings);
        for (file, text) in files {
            folder.write(file, text);
        }
        for tool in ["gl-check", "gl-calibrate", "gl-diagnose"] {
            let output =
                driver(&folder, tool).args(["case", "--engine", engine, "--out", "out"]).output().unwrap();
            let said = text(&output.stderr);
            assert_eq!(output.status.code(), Some(2), "{tool}: {said}");
            for part in says {
                assert!(said.contains(part), "{tool} does not say {part}: {said}");
            }
            assert!(!folder.path("out").exists(), "{tool}");
        }
    };
    wrong(&[], &[("case/obs.txt", "u f\n")], "embedded", &["case/obs.txt: no rows"]);
    wrong(&[], &[("case/obs.txt", "")], "embedded", &["case/obs.txt"]);
    wrong(
        &[],
        &[("case/obs.txt", "u force\n0 1\n")],
        "embedded",
        &["case/obs.txt:1: no column f; the columns are u, force"],
    );
    let both = [("case/obs.txt", "u g\n0 1\n"), ("case/params.txt", "name lower upper\na 2 1\n")];
    wrong(&[], &both, "embedded", &["no column f", "case/params.txt:2: column upper"]);
    wrong(
        &[("truth", "{ E = 9.3 }")],
        &[],
        "embedded",
        &["case/case.toml:1: truth: no parameter E; they are E_m, nu"],
    );
    wrong(
        &[("units", "{ F = \"N\" }")],
        &[],
        "embedded",
        &["units: no column or parameter F; did you mean f?"],
    );
    wrong(
        &[("effects", "[\"adhesion\"]")],
        &[],
        "embedded",
        &["effects: no effect adhesion; there are none"],
    );
    wrong(&[("steps", "\"90:95\"")], &[], "embedded", &["--steps 90:95: the measurement has"]);
    wrong(
        &[("noise", "{ g = 1 }")],
        &[],
        "embedded",
        &["case.toml:1: noise: no observable g: observables names f"],
    );
    let local = |model: &str| format!("[model]\nlocal = \"{model}\"\n");
    for (model, says) in [
        ("true {E_n}", "{E_n} is no column of the samples"),
        ("no-such-program {nu}", "no program no-such-program"),
        ("true 'a", "a quote is not closed"),
        ("no-such-script.py", "no such script"),
    ] {
        let case = format!(
            "name = \"c\"\ncontrol = \"u\"\nobservables = [\"f\"]\nnoise = {{ f = 1 }}\n{}",
            local(model)
        );
        wrong(&[], &[("case/case.toml", &case)], "local", &["case/case.toml:6: model: ", says]);
    }
    let zero = [
        ("case/obs.txt", "u f\n0 0\n1 -1\n"),
        (
            "case/case.toml",
            "name = \"c\"\ncontrol = \"u\"\nobservables = [\"f\"]\n[model]\nembedded = \"gl-contact\"\n",
        ),
    ];
    wrong(&[], &zero, "embedded", &["cannot be a scale"]);
}

#[test]
fn the_check_says_how_many_runs_there_will_be_and_how_long_they_take() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    let check = |given: &str| {
        finish(driver(&folder, "gl-check").args(["case", "--out", "out", "--verdict", "said.txt", given]))
    };
    check("num=7");
    let verdict = |code: &str| {
        let codes = folder.texts("said.txt", "code");
        let place = codes.iter().position(|other| other == code);
        place.map(|place| folder.texts("said.txt", "value")[place].clone())
    };
    assert_eq!((verdict("runs").as_deref(), verdict("seconds-a-run")), (Some("210"), None));
    finish(calibrate(&folder, "embedded", "out").args(["num=7", "--iterations", "1"]));
    let (_, said) = check("num=7");
    assert!(said.contains("by the 7 runs that are there"), "{said}");
    assert!(verdict("seconds-a-run").unwrap().parse::<f64>().unwrap() < 10.0);
}

#[test]
fn kept_runs_are_taken_and_the_model_is_not_run() {
    let folder = Folder::default();
    copy_case(&folder, "linear", &SMALL);
    finish(&mut calibrate(&folder, "local", "made"));
    finish(driver(&folder, "gl-run").args(["pack", "made/iter0/runs"]));
    let packed = fs::read_dir(folder.path("made/iter0/runs")).unwrap().map(|entry| entry.unwrap().path());
    let packed = packed.filter(|path| path.to_str().unwrap().ends_with("_packed.txt")).last().unwrap();
    folder.write("case/kept.txt", fs::read(packed).unwrap());
    set(&folder, &[("kept", "\"kept.txt\"")]);
    // No run could be made any more.
    fs::remove_file(folder.path("case/linear.awk")).unwrap();
    let (_, said) = finish(&mut calibrate(&folder, "local", "taken"));
    assert!(said.contains("8 of 8 runs are not made but taken from"), "{said}");
    assert_eq!(results(&folder, "made"), results(&folder, "taken"));
}

#[test]
fn a_prior_that_is_wide_beside_the_measurement_does_not_hide_the_effect() {
    let folder = Folder::default();
    // What calibration does not see is measured apart. Through an emulator it takes three times as long.
    copy_case(&folder, "contact-effects", &[("steps", "\"0:60\""), ("posterior", "\"weights\"")]);
    let params = folder.read("case/params.txt");
    let params =
        params.replace("E_m\t8.5\t10", "E_m\t7\t11").replace("mu\t0.1\t0.8\tlinear", "mu\t0.01\t2\tlog");
    folder.write("case/params.txt", params);
    finish(driver(&folder, "gl-diagnose").args(["case", "--out", "made"]));
    assert_eq!(folder.texts("made/attribution.txt", "hypothesis")[0], "adhesion");
    assert_eq!(folder.read("made/winner.txt"), "adhesion\n");
    let place =
        folder.texts("made/design/round0/params.txt", "name").iter().position(|name| name == "E_m").unwrap();
    let bound = |name: &str| folder.column("made/design/round0/params.txt", name)[place];
    assert!(4.0 / (bound("upper") - bound("lower")) >= 2.0);
    let all =
        folder.texts("made/shrink-unseen.txt", "observable").iter().position(|name| name == "all").unwrap();
    assert!(folder.column("made/shrink-unseen.txt", "shrink")[all] > 0.5);
}

/// The folder of the last round of the design.
fn last_round(folder: &Folder) -> String {
    let rounds = (0..).map(|r| format!("made/design/round{r}"));
    rounds.take_while(|round| folder.path(round).exists()).last().unwrap()
}

#[test]
fn the_last_runs_of_a_design_lie_where_the_first_ones_point() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL_DIAGNOSIS);
    finish(driver(&folder, "gl-diagnose").args(["case", "--out", "made", "design_num=100"]));
    // Two fifths in the first round, and then tenths.
    assert_eq!(rows(&folder, "made/design/round0/samples.txt"), 40);
    assert_eq!(rows(&folder, &format!("{}/samples.txt", last_round(&folder))), 10);
    let spread = |round: &str| {
        let values = folder.column(&format!("{round}/samples.txt"), "E_m");
        let weights = vec![1.0 / values.len() as f64; values.len()];
        gl_numeric::statistics::sd(&values, &weights)
    };
    let (first, last) = (spread("made/design/round0"), spread(&last_round(&folder)));
    assert!(last < 0.7 * first, "{last} after {first}");
    let mut runs = folder.texts("made/design/ensemble.txt", "sample");
    runs.dedup();
    assert_eq!(runs.len(), rows(&folder, "made/design/samples.txt"));
}

#[test]
fn a_design_that_has_ended_goes_on_where_it_may_have_more_runs() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL_DIAGNOSIS);
    // So noisy that no two rounds are sure of anything.
    set(&folder, &[("noise", "{ f = 0.3, t = 0.1 }")]);
    folder.run(
        "gl-contact --programme cycles --curve E_m=9.2,nu=0.3,mu=0.45,w=4 --noise f=0.3,t=0.1 -o case/obs.txt",
    );
    let sizes = |runs: &str| -> Vec<usize> {
        finish(driver(&folder, "gl-diagnose").args(["case", "--out", "made", runs]));
        let rounds = (0..).map(|r| format!("made/design/round{r}/samples.txt"));
        rounds.take_while(|samples| folder.path(samples).exists()).map(|it| rows(&folder, &it)).collect()
    };
    assert_eq!(sizes("design_num=40"), [16, 4, 4, 4, 4, 4, 4]);
    let second = || folder.read("made/design/round1/samples.txt");
    let (before, was) = (second(), folder.read("made/design/samples.txt"));
    assert_eq!(sizes("design_num=60"), [16, 4, 4, 4, 4, 4, 4, 20]);
    assert_eq!(second(), before);
    let now = folder.read("made/design/samples.txt");
    assert!(was.lines().all(|run| now.lines().any(|line| line == run)), "a run that was made is gone");
}

#[test]
fn a_design_goes_beyond_a_prior_that_excludes_the_truth_and_that_is_said_first() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL_DIAGNOSIS);
    let params = folder.read("case/params.txt").replace("E_m\t8.5\t10", "E_m\t8.5\t9");
    folder.write("case/params.txt", params);
    finish(driver(&folder, "gl-diagnose").args(["case", "--out", "made", "design_num=100"]));
    assert_eq!(rows(&folder, "made/design/round1/samples.txt"), 20);
    for wider in ["made/design/params.txt", "made/wider-params.txt"] {
        let place = folder.texts(wider, "name").iter().position(|name| name == "E_m").unwrap();
        assert!((folder.column(wider, "upper")[place] - 9.25).abs() < 1e-9, "{wider}");
    }
    assert_eq!(folder.texts("made/attribution-verdict.txt", "code")[0], "beyond-prior");
    // 9.2 and adhesion are in it.
    assert_eq!(folder.read("made/winner.txt"), "adhesion\n");
    let of = |column: &str| folder.texts("made/posterior.txt", column);
    let mut rows_of = of("hypothesis").into_iter().zip(of("parameter"));
    let place = rows_of.position(|row| row == ("adhesion".to_owned(), "E_m".to_owned())).unwrap();
    let mean = folder.column("made/posterior.txt", "mean")[place];
    assert!((mean - 9.2).abs() < 0.02, "{mean}");
    assert!(folder.path("made/base-wider/posterior.txt").exists());
}

#[test]
fn a_box_goes_beyond_the_prior_twice_and_no_further() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL_DIAGNOSIS);
    // 9.2 is in it.
    let params = folder.read("case/params.txt").replace("E_m\t8.5\t10", "E_m\t8.5\t8.6");
    folder.write("case/params.txt", params);
    driver(&folder, "gl-diagnose").args(["case", "--out", "made", "design_num=40"]).output().unwrap();
    let calls = folder.read("made/commands.log");
    assert_eq!(calls.lines().filter(|call| call.contains("gl-box widen")).count(), 2);
    let place = folder.texts("made/design/params.txt", "name").iter().position(|name| name == "E_m").unwrap();
    let upper = folder.column("made/design/params.txt", "upper")[place];
    assert!(upper > 8.65 && upper < 8.75, "{upper}");
}

#[test]
fn a_case_without_a_candidate_is_not_diagnosed_and_one_of_errors_of_the_rig_alone_is() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &SMALL);
    let diagnosed = |measurement: &[&str]| {
        let mut driver = driver(&folder, "gl-diagnose");
        driver.args(["case", "--out", "made", "design_num=20"]).args(measurement).output().unwrap()
    };
    let refused = diagnosed(&[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("case/params.txt: there is no candidate"), "{:?}", refused.stderr);
    assert!(!folder.path("made/base").exists());
    let said = diagnosed(&["measurement=offset"]);
    assert_eq!(said.status.code(), Some(0), "{}", text(&said.stderr));
    let hypotheses = folder.texts("made/attribution.txt", "hypothesis");
    assert!(hypotheses.contains(&"offset(f)".to_owned()), "{hypotheses:?}");
}

/// The tools that work in a folder.
fn at_work(folder: &Folder) -> Vec<String> {
    let here = fs::canonicalize(folder.path("")).unwrap();
    let is_here = |process: &PathBuf| fs::read_link(process.join("cwd")).is_ok_and(|cwd| cwd == here);
    let processes = fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().path()).filter(is_here);
    let name = |process: PathBuf| fs::read_to_string(process.join("comm")).ok();
    processes.filter_map(name).filter(|name| name.starts_with("gl-")).collect()
}

#[test]
fn a_driver_that_is_stopped_takes_its_steps_with_it() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &SMALL);
    let mut driver = driver(&folder, "gl-calibrate");
    let driver = driver.args(["case", "--engine", "local", "--out", "made", "model=sleep 60"]);
    let mut child = driver.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let waits = |what: &dyn Fn() -> bool| {
        (0..1200).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(50));
            what()
        })
    };
    assert!(waits(&|| at_work(&folder).iter().any(|name| name.starts_with("gl-run"))));
    // The driver alone: who calls `kill` with a number knows no groups.
    Command::new("kill").arg(child.id().to_string()).status().unwrap();
    child.wait().unwrap();
    assert!(waits(&|| at_work(&folder).is_empty()), "{:?}", at_work(&folder));
}

/// All runs of a folder of results.
fn all_runs(folder: &Folder, out: &str) -> usize {
    let samples = times(folder, out).into_keys().filter(|file| {
        let name = file.display().to_string();
        name.ends_with("samples.txt")
            && (name.contains("/iter") || name.contains("/round"))
            && !name.contains("all-")
    });
    samples.map(|file| rows(folder, &file.display().to_string())).sum()
}

#[test]
fn a_cause_that_stands_out_is_found_and_put_in_with_few_runs() {
    let folder = Folder::default();
    // Of the prior the posterior is a billionth: what was found must not be lost again. The one diagnosis with nothing made
    // smaller, as a user calls it: a minute of a processor.
    copy_case(&folder, "contact-effects", &[]);
    finish(driver(&folder, "gl-diagnose").args(["case", "--out", "made"]));
    assert_eq!(folder.read("made/winner.txt"), "adhesion\n");
    let runs = all_runs(&folder, "made");
    assert!((80..=200).contains(&runs), "{runs}");
    for (name, truth) in [("E_m", 9.2), ("nu", 0.3), ("mu", 0.45), ("w", 4.0)] {
        let of =
            |kind: &str| folder.quantity("made/after-adhesion/posterior.txt", &format!("{kind}({name})"));
        assert!((of("mean") - truth).abs() < 3.0 * of("sd"), "{name}: {} ± {}", of("mean"), of("sd"));
        assert!(of("sd") < 0.1 * truth, "{name}");
    }
    // The runs of the design with adhesion alone are runs of the calibration with it.
    let known = rows(&folder, "made/after-adhesion/known/samples.txt");
    let own = all_runs(&folder, "made/after-adhesion");
    assert_eq!(folder.quantity("made/after-adhesion/posterior.txt", "runs") as usize, known + own);
    assert!(known > 5, "{known}");
}

#[test]
fn runs_without_an_effect_are_runs_of_the_calibration_with_it_where_its_bounds_hold_that_value() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &[]);
    let params = folder.read("case/params.txt");
    let params =
        params.replace("w\t0.3\t10\tlog", "w\t0\t10\tlinear").replace("E_m\t8.5\t10", "E_m\t8.8\t9.6");
    folder.write("case/params.txt", &params);
    let calibrate = |arguments: &[&str]| finish(driver(&folder, "gl-calibrate").arg("case").args(arguments));
    calibrate(&["iterations=1", "--out", "base"]);
    fs::create_dir(folder.path("known")).unwrap();
    fs::copy(folder.path("base/iter0/samples.txt"), folder.path("known/samples.txt")).unwrap();
    fs::copy(folder.path("base/ensemble.txt"), folder.path("known/ensemble.txt")).unwrap();
    calibrate(&["iterations=2", "effects=adhesion", "--with", "known", "--out", "after"]);
    assert!(!folder.path("after/iter1/fallback.txt").exists());
    let (known, own) = (rows(&folder, "known/samples.txt"), all_runs(&folder, "after"));
    assert_eq!(folder.quantity("after/posterior.txt", "runs") as usize, known + own);
    // Where no emulator follows the simulator, the runs that were there say nothing, and the tables beside each other are of
    // the same runs.
    for file in ["posterior-runs-weights.txt", "posterior-weights.txt", "posterior.txt", "stop.code"] {
        fs::remove_file(folder.path("after/iter1").join(file)).unwrap();
    }
    folder.write("after/iter1/fallback.txt", "no emulator follows this simulator\n");
    calibrate(&["iterations=2", "effects=adhesion", "--with", "known", "--out", "after"]);
    assert!(folder.path("after/iter1/fallback.txt").exists());
    assert_eq!(folder.texts("after/posterior-runs-weights.txt", "sample").len(), own);
    folder.run(
        "gl-gap-locate -b case/obs.txt -c u -v f,t --noise f=0.003,t=0.001 \
         -w after/posterior-runs-weights.txt after/ensemble.txt -o gap.txt",
    );
}

#[test]
fn a_diagnosis_goes_on_where_it_was() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL_DIAGNOSIS);
    let diagnose = || finish(driver(&folder, "gl-diagnose").args(["case", "--out", "made"]));
    // As from a call by which some steps were not calibrated on.
    folder.write("made/shrink-unseen.txt", "stale\n");
    diagnose();
    assert!(!folder.path("made/shrink-unseen.txt").exists());
    let (first, before) = (folder.read("made/attribution.txt"), times(&folder, "made"));
    let (pages, said) = diagnose();
    assert_eq!(pages, "made/report.html\nmade/report.md\n");
    assert!(said.contains(&folder.read("made/attribution.log")), "{said}");
    assert!(before == times(&folder, "made"), "what is done is not done again");
    for file in before
        .keys()
        .filter(|file| file.ends_with("attribution.txt") || file.ends_with("design/ensemble.txt"))
    {
        fs::remove_file(folder.path("").join(file)).unwrap();
    }
    diagnose();
    assert_eq!(first, folder.read("made/attribution.txt"));
    let is_simulation = |file: &Path| file.display().to_string().ends_with("_sim.txt");
    let after = times(&folder, "made");
    assert!(before.iter().all(|(file, time)| !is_simulation(file) || after[file] == *time));
}

/// The forms in which a table may be written.
fn forms(table: &str) -> Vec<(&'static str, String)> {
    let commas = table.replace('\t', ",");
    vec![
        ("tabs", table.to_owned()),
        ("blanks", table.replace('\t', "  ")),
        ("commas", commas.clone()),
        ("number sign", format!("# {}", table.replace('\t', " "))),
        ("CRLF and BOM", format!("\u{feff}{}", commas.replace('\n', "\r\n"))),
    ]
}

#[test]
fn every_form_of_the_tables_gives_the_same_bytes() {
    let folder = Folder::default();
    copy_case(&folder, "contact-effects", &SMALL_DIAGNOSIS);
    set(&folder, &[("max_effects", "1")]);
    let tables_in = ["case/params.txt", "case/obs.txt"].map(|file| (file, folder.read(file)));
    let mut first: Option<BTreeMap<PathBuf, Vec<u8>>> = None;
    for (i, (form, _)) in forms("").into_iter().enumerate() {
        for (file, text) in &tables_in {
            folder.write(file, &forms(text)[i].1);
        }
        let [fit, made] = ["fit", "made"].map(|name| format!("{name}{i}"));
        finish(calibrate(&folder, "embedded", &fit).args(["posterior=emulator", "iterations=1", "num=10"]));
        finish(driver(&folder, "gl-diagnose").args(["case", "--out", &made]));
        assert_eq!(folder.read(&format!("{made}/winner.txt")), "adhesion\n", "{form}");
        assert!(rows(&folder, &format!("{made}/shrink.txt")) > 0, "{form}");
        let mut found = tables(&folder, &fit);
        found.extend(
            tables(&folder, &made).into_iter().map(|(file, bytes)| (Path::new("made").join(file), bytes)),
        );
        // The pages of a report name the folder that they are of.
        found.retain(|file, _| {
            !matches!(file.extension().and_then(|ending| ending.to_str()), Some("md" | "html"))
        });
        // So does what is said of a bound.
        for bytes in found.iter_mut().filter(|(file, _)| file.ends_with("attribution-verdict.txt")) {
            *bytes.1 = text(bytes.1).replace(&made, "made").into_bytes();
        }
        let expected = first.get_or_insert_with(|| found.clone());
        assert_eq!(expected.keys().collect::<Vec<_>>(), found.keys().collect::<Vec<_>>(), "{form}");
        for (file, bytes) in expected {
            assert!(found[file] == *bytes, "{form}: {} differs", file.display());
        }
    }
}

/// Without source, cargo, make, and anything in PATH.
#[test]
fn an_installed_tree_works_in_an_empty_folder() {
    let folder = Folder::default();
    let prefix = folder.path("usr");
    let output = make(&folder, &["-s", "install", &format!("PREFIX={}", prefix.display())]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let tools: Vec<PathBuf> =
        fs::read_dir(prefix.join("bin")).unwrap().map(|entry| entry.unwrap().path()).collect();
    for tool in ["gl-init", "gl-check", "gl-calibrate", "gl-iterate", "gl-diagnose", "gl-run", "gl-box"] {
        assert!(tools.contains(&prefix.join("bin").join(tool)), "{tool}");
    }
    for tool in &tools {
        let name = tool.file_name().unwrap().to_str().unwrap();
        assert!(prefix.join(format!("share/man/man1/{name}.1")).exists(), "{name}");
    }
    fs::create_dir(folder.path("empty")).unwrap();
    let call = |tool: &str, arguments: &[&str]| {
        let output = Command::new(prefix.join("bin").join(tool))
            .args(arguments)
            .env_clear()
            .current_dir(folder.path("empty"))
            .output()
            .unwrap();
        assert!(output.status.success(), "{tool}: {}{}", text(&output.stdout), text(&output.stderr));
        text(&output.stdout)
    };
    assert!(call("gl-init", &["--list"]).contains("contact-effects\t"));
    call("gl-init", &["mine", "--from", "contact-effects"]);
    call("gl-check", &["mine"]);
    let small = ["num=20", "iterations=2", "design_num=60", "posterior=weights"];
    assert!(call("gl-calibrate", &["mine", small[0], small[1]]).starts_with("iteration 0: 20 runs"));
    call("gl-diagnose", &[&["mine"], &small[..]].concat());
    let page = folder.path("empty/out/mine-diagnosis/report.html");
    fs::remove_file(&page).unwrap();
    call("gl-report", &["mine"]);
    assert!(page.exists());
    assert_eq!(folder.read("empty/out/mine-diagnosis/winner.txt"), "adhesion\n");
    assert!(folder.path("empty/out/mine/posterior.txt").exists());
}

#[test]
fn make_iteration_goes_from_runs_to_the_next_samples() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    folder.run("gl-sample -p case/params.txt -n 30 --name collision -o samples.txt");
    folder.run("gl-contact -s samples.txt runs");
    let path = |name: &str| folder.path(name).display().to_string();
    let iterate = |samples: &str, number: &str| {
        let [case, samples, runs, out] =
            [("CASE", "case"), ("SAMPLES", samples), ("RUNS", "runs"), ("OUT", "fit")]
                .map(|(key, name)| format!("{key}={}", path(name)));
        make(&folder, &["iteration", &case, &samples, &runs, &out, &format!("ITERATION={number}")])
    };
    // To go on is no error here.
    let output = iterate("samples.txt", "0");
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("next samples: ") && folder.path("fit/iter1/samples.txt").exists());
    folder.run("gl-contact -s fit/iter1/samples.txt runs");
    assert!(iterate("fit/iter1/samples.txt", "1").status.success());
    assert!(folder.path("fit/iter2/samples.txt").exists());
    let output = iterate("nowhere.txt", "0");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("nowhere.txt: no such samples table"));
}

#[test]
fn a_box_is_made_narrower_and_wider_by_hand() {
    let folder = Folder::default();
    folder.write("params.txt", "# name,lower,upper\r\na,0,10\r\n");
    folder.write("weights.txt", "sample a misfit weight\nr1 4 1 0.5\nr2 6 2 0.5\n");
    assert_eq!(folder.stdout("gl-box narrow -p params.txt weights.txt"), "name\tlower\tupper\na\t3.5\t6.5\n");
    folder.run("gl-box narrow -p params.txt weights.txt -o box.txt");
    folder.write("posterior.txt", "hypothesis parameter lean\nnone a -1\n");
    assert_eq!(
        folder.stdout("gl-box widen -p params.txt --box box.txt posterior.txt"),
        "name\tlower\tupper\na\t0.5\t6.5\n"
    );
    folder.write("posterior.txt", "hypothesis parameter lean\nnone a 0\n");
    let output = folder.call("gl-box widen -p params.txt --box box.txt posterior.txt", "");
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(text(&output.stdout), folder.read("box.txt"));
    folder.refuses("gl-box narrow -p params.txt box.txt", &["box.txt:1: no column sample"]);
}

/// The first column of the table of settings, and all of it.
#[test]
fn the_page_on_calibration_names_the_settings_that_there_are() {
    let page = fs::read_to_string(root().join("docs/calibration.md")).unwrap();
    let cells = page.lines().filter_map(|line| line.strip_prefix("| `")?.split(" |").next());
    let mut named: Vec<&str> =
        cells.flat_map(|cell| cell.split(['`', ',', ' '])).filter(|name| !name.is_empty()).collect();
    named.sort_unstable();
    named.dedup();
    let mut known = gl_case::Case::settings();
    known.sort_unstable();
    assert_eq!(named, known);
}

#[test]
fn an_iteration_by_hand_keeps_out_of_a_folder_in_which_a_driver_works() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &[]);
    folder.run("gl-sample -p case/params.txt -n 8 --name collision -o mine.txt");
    folder.run("gl-contact -s mine.txt mine");
    folder.write("out/.lock", "");
    let mut holder =
        Command::new("flock").arg(folder.path("out/.lock")).args(["sleep", "60"]).spawn().unwrap();
    let is_free = || {
        let lock = folder.path("out/.lock");
        Command::new("flock").arg("-n").arg(lock).arg("true").status().unwrap().success()
    };
    while is_free() {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let call =
        || driver(&folder, "gl-iterate").args(["case", "mine.txt", "mine", "--out", "out"]).output().unwrap();
    let refused = call();
    holder.kill().unwrap();
    holder.wait().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused.stderr));
    assert!(!folder.path("out/iter0").exists());
}

#[test]
fn settings_of_the_cluster_for_a_call_reach_its_jobs() {
    let folder = Folder::default();
    copy_case(&folder, "collision", &SMALL);
    folder.write("pbs/calls", "");
    let path =
        format!("{}:{}", root().join("tests/scripts/fake-pbs").display(), pipelines::path_with_tools());
    let output = calibrate(&folder, "pbs", "out")
        .args(["--no-wait", "cluster.partition=short", "model=cat {E_m}"])
        .env("PATH", path)
        .env("FAKE_PBS", folder.path("pbs"))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert!(folder.read("pbs/calls").contains("short"), "{}", folder.read("pbs/calls"));
    // Its jobs end before their folder does.
    let is_busy = || {
        fs::read_dir(folder.path("pbs"))
            .unwrap()
            .any(|job| job.unwrap().file_name().to_string_lossy().ends_with(".fake"))
    };
    while is_busy() {
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

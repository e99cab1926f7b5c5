//! `gl-emulate` between the tools before and after it.
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use tempfile::TempDir;

fn tool(name: &str, directory: &Path) -> Command {
    let deps = std::env::current_exe().unwrap();
    let release: PathBuf = deps.parent().unwrap().parent().unwrap().to_owned();
    let mut command = Command::new(release.join(name));
    command.current_dir(directory);
    command
}

fn run(command: &mut Command) -> (i32, String, String) {
    let output = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

/// Rows of numbers under the named columns.
fn columns(table: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split('\t').collect();
    let places: Vec<usize> =
        names.iter().map(|name| header.iter().position(|column| column == name).unwrap()).collect();
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split('\t').collect();
            places.iter().map(|&place| fields[place].parse().unwrap()).collect()
        })
        .collect()
}

fn model(a: f64, b: f64, u: f64) -> [f64; 2] {
    [100.0 * a * u + (3.0 * b * u).sin(), 1e-3 * (b - a * u * u)]
}

/// A folder with the switch design of two base parameters and an effect, and its runs.
fn folder(runs: usize) -> TempDir {
    let folder = TempDir::new().unwrap();
    let path = folder.path();
    fs::write(
        path.join("params.txt"),
        "name lower upper effect off\na 1 3 - -\nb 0 2 - -\nk 0.5 1 cohesion 0\n",
    )
    .unwrap();
    let count = runs.to_string();
    let sample = ["-p", "params.txt", "-n", &count, "--effects", "switch", "-o", "samples.txt"];
    tool("gl-sample", path).args(sample).assert().success();
    let samples = fs::read_to_string(path.join("samples.txt")).unwrap();
    let names: Vec<&str> = samples.lines().skip(1).map(|line| line.split('\t').next().unwrap()).collect();
    let mut ensemble = "sample step u f e\n".to_owned();
    for (name, row) in names.iter().zip(columns(&samples, &["a", "b", "k"])) {
        for step in 0..10 {
            let u = 0.1 * f64::from(step);
            let [f, e] = model(row[0], row[1], u);
            writeln!(ensemble, "{name} {step} {u} {} {e}", f + 5.0 * row[2] * u).unwrap();
        }
    }
    fs::write(path.join("ensemble.txt"), ensemble).unwrap();
    fs::write(path.join("new.txt"), "description a b k\nx 1.7 0.9 0\ny 2.2 1.3 0.8\n").unwrap();
    folder
}

const BEFORE: [&str; 4] = ["-p", "params.txt", "-s", "samples.txt"];

#[test]
fn the_ensemble_at_other_samples_is_what_the_model_gives() {
    let folder = folder(80);
    let mut command = tool("gl-emulate", folder.path());
    let (code, stdout, stderr) = run(command.args(BEFORE).args(["--at", "new.txt", "ensemble.txt"]));
    assert_eq!((code, stderr.as_str()), (0, ""));
    let rows = columns(&stdout, &["step", "u", "f", "e", "f_sd", "e_sd"]);
    assert_eq!(rows.len(), 20);
    for (i, row) in rows.iter().enumerate() {
        let (a, b, k) = if i < 10 { (1.7, 0.9, 0.0) } else { (2.2, 1.3, 0.8) };
        let [f, e] = model(a, b, row[1]);
        assert!((row[2] - f - 5.0 * k * row[1]).abs() < 0.3, "{row:?}");
        assert!((row[3] - e).abs() < 3e-6, "{row:?}");
        assert!(row[4] < 1.0 && row[5] < 1e-4, "{row:?}");
    }
}

#[test]
fn bytes_do_not_depend_on_threads_nor_on_where_the_ensemble_comes_from() {
    let folder = folder(60);
    let ensemble = fs::read(folder.path().join("ensemble.txt")).unwrap();
    let outputs = ["1", "3"].map(|threads| {
        let mut command = tool("gl-emulate", folder.path());
        command.env("RAYON_NUM_THREADS", threads).args(BEFORE).args(["--at", "new.txt"]);
        run(command.write_stdin(ensemble.clone())).1
    });
    assert_eq!(outputs[0], outputs[1]);
    let mut command = tool("gl-emulate", folder.path());
    command.args(BEFORE).args(["--at", "new.txt", "-c", "u", "-v", "f,e", "-o", "out.txt", "ensemble.txt"]);
    assert_eq!(run(&mut command).1, "");
    assert_eq!(fs::read_to_string(folder.path().join("out.txt")).unwrap(), outputs[0]);
}

#[test]
fn check_prints_the_error_of_each_observable() {
    let folder = folder(80);
    let mut command = tool("gl-emulate", folder.path());
    let (code, stdout, _) = run(command.args(BEFORE).args(["--check", "ensemble.txt"]));
    assert_eq!(code, 0);
    let names: Vec<&str> = stdout.lines().map(|line| line.split('\t').next().unwrap()).collect();
    assert_eq!(names, ["observable", "f", "e"]);
    for row in columns(&stdout, &["rmse", "rmse_range", "coverage90", "scatter_sd"]) {
        assert!(row[0] > 0.0 && row[1] < 1e-3 && row[2] > 0.8 && row[3] >= 0.0, "{row:?}");
    }
}

#[test]
fn every_run_is_predicted_from_the_others() {
    let folder = folder(80);
    let mut command = tool("gl-emulate", folder.path());
    let (code, stdout, _) = run(command.args(BEFORE).args(["--leave-one-out", "ensemble.txt"]));
    assert_eq!(code, 0);
    let runs = fs::read_to_string(folder.path().join("ensemble.txt")).unwrap().replace(' ', "\t");
    let (predicted, simulated) = (columns(&stdout, &["step", "f"]), columns(&runs, &["step", "f"]));
    assert_eq!(predicted.len(), simulated.len());
    let errors = predicted.iter().zip(&simulated).map(|(p, s)| (p[1] - s[1]).abs());
    let largest = errors.fold(0.0, f64::max);
    assert!(0.0 < largest && largest < 3.0, "{largest}");
}

#[test]
fn the_scatter_enters_the_sd_by_its_share() {
    let folder = folder(80);
    let path = folder.path();
    // Runs are stiffer or softer with a sign that no parameter explains.
    let text = fs::read_to_string(path.join("ensemble.txt")).unwrap();
    let noisy: String = text
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let mut fields: Vec<String> = line.split(' ').map(str::to_owned).collect();
            if i > 0 {
                let sign = (12.9898 * ((i - 1) / 10) as f64).sin().signum();
                let u: f64 = fields[2].parse().unwrap();
                let f: f64 = fields[3].parse().unwrap();
                fields[3] = (f + 2.0 * sign * u).to_string();
            }
            fields.join(" ") + "\n"
        })
        .collect();
    fs::write(path.join("noisy.txt"), noisy).unwrap();
    let sd = |scatter: &str| {
        let mut command = tool("gl-emulate", path);
        let (code, stdout, stderr) =
            run(command.args(BEFORE).args(["--at", "new.txt", "--scatter", scatter, "noisy.txt"]));
        assert_eq!(code, 0, "{stderr}");
        columns(&stdout, &["f_sd"])[9][0]
    };
    // At the last step u = 0.9, where the scatter's standard deviation is 1.8.
    let (without, with) = (sd("0"), sd("1"));
    assert!(without < 0.9, "{without}");
    let scatter = (with * with - without * without).sqrt();
    assert!((scatter / 1.8 - 1.0).abs() < 0.25, "{scatter}");
    assert!((sd("4").powi(2) - without * without - 4.0 * scatter * scatter).abs() < 1e-9);
}

#[test]
fn failed_runs_and_extrapolation_are_counted() {
    let folder = folder(60);
    let path = folder.path();
    let text = fs::read_to_string(path.join("ensemble.txt")).unwrap();
    let rest: String = text
        .lines()
        .enumerate()
        .filter(|(i, _)| !(11..41).contains(i))
        .map(|(_, l)| format!("{l}\n"))
        .collect();
    fs::write(path.join("ensemble.txt"), rest).unwrap();
    fs::write(path.join("new.txt"), "description a b k\nx 1.7 0.9 0\ny 9 1.3 0.8\n").unwrap();
    let mut command = tool("gl-emulate", path);
    let (code, _, stderr) = run(command.args(BEFORE).args(["--at", "new.txt", "ensemble.txt"]));
    assert_eq!(code, 0);
    assert!(stderr.contains("3 of 60 samples have no run"), "{stderr}");
    assert!(stderr.contains("1 of 2 samples lie outside"), "{stderr}");
}

#[test]
fn bad_input_is_an_error_that_says_what_would_be_right() {
    let folder = folder(30);
    let path = folder.path();
    let text = fs::read_to_string(path.join("ensemble.txt")).unwrap();
    let few: String = text.lines().take(31).map(|line| format!("{line}\n")).collect();
    fs::write(path.join("few.txt"), few).unwrap();
    fs::write(path.join("header.txt"), "sample step u f\n").unwrap();
    fs::write(path.join("other.txt"), "description a b\nx 1.7 0.9\n").unwrap();
    fs::write(path.join("stranger.txt"), text.replace("Sample0", "Other0")).unwrap();
    let same = "description a b k\n".to_owned()
        + &fs::read_to_string(path.join("samples.txt"))
            .unwrap()
            .lines()
            .skip(1)
            .map(|line| {
                let fields: Vec<&str> = line.split('\t').collect();
                format!("{} {} {} 0\n", fields[0], fields[2], fields[3])
            })
            .collect::<String>();
    fs::write(path.join("same.txt"), same).unwrap();
    let cases: [(&[&str], &str); 8] = [
        (&["-s", "samples.txt", "--at", "new.txt", "few.txt"], "3 runs for"),
        (&["-s", "samples.txt", "--at", "new.txt", "header.txt"], "0 runs"),
        (&["-s", "samples.txt", "--at", "other.txt", "ensemble.txt"], "no column k"),
        (&["-s", "samples.txt", "--at", "new.txt", "stranger.txt"], "is not in samples.txt"),
        (&["-s", "same.txt", "--at", "new.txt", "ensemble.txt"], "sample y has k 0.8"),
        (&["-s", "samples.txt", "--at", "new.txt", "--scatter", "-1", "ensemble.txt"], "--scatter"),
        (&["-s", "samples.txt", "--at", "new.txt", "-v", "zzz", "ensemble.txt"], "no column zzz"),
        (&["-s", "-", "--at", "new.txt", "-"], "stdin"),
    ];
    for (arguments, expected) in cases {
        let mut command = tool("gl-emulate", path);
        let command = command.args(["-p", "params.txt", "-o", "out.txt"]).args(arguments);
        let (code, stdout, stderr) = run(command.write_stdin("description a b k\n"));
        assert_eq!((code, stdout.as_str()), (2, ""), "{arguments:?}: {stderr}");
        assert!(stderr.contains(expected), "{arguments:?}: {stderr}");
        assert!(!path.join("out.txt").exists());
    }
}

#[test]
fn an_emulated_ensemble_is_not_trained_on() {
    let folder = folder(30);
    let path = folder.path();
    let arguments = ["--at", "samples.txt", "-o", "emulated.txt", "ensemble.txt"];
    tool("gl-emulate", path).args(BEFORE).args(arguments).assert().success();
    let mut command = tool("gl-emulate", path);
    let (code, _, stderr) = run(command.args(BEFORE).args(["--at", "new.txt", "emulated.txt"]));
    assert_eq!(code, 2);
    assert!(stderr.contains("_sd columns"), "{stderr}");
}

#[test]
fn an_emulated_ensemble_is_calibrated_on() {
    let folder = folder(80);
    let path = folder.path();
    let mut obs = "u f e\n".to_owned();
    for step in 0..10 {
        let u = 0.1 * f64::from(step);
        let [f, e] = model(1.7, 0.9, u);
        writeln!(obs, "{u} {f} {e}").unwrap();
    }
    fs::write(path.join("obs.txt"), obs).unwrap();
    let many = ["-p", "params.txt", "-n", "2000", "--name", "many", "-o", "many.txt"];
    tool("gl-sample", path).args(many).assert().success();
    let emulate = ["--at", "many.txt", "-o", "emulated.txt", "ensemble.txt"];
    tool("gl-emulate", path).args(BEFORE).args(emulate).assert().success();
    let likelihood = ["-b", "obs.txt", "-c", "u", "-v", "f,e", "--noise", "f=10,e=1e-4", "-o", "misfit.txt"];
    tool("gl-likelihood", path).args(likelihood).arg("emulated.txt").assert().success();
    let filter =
        ["-s", "many.txt", "--sigma", "noise", "--summary", "summary.txt", "-o", "w.txt", "misfit.txt"];
    tool("gl-filter", path).args(filter).assert().success();
    let summary = fs::read_to_string(path.join("summary.txt")).unwrap();
    let value = |name: &str| -> f64 {
        let line = summary.lines().find(|line| line.starts_with(name)).unwrap();
        line.split('\t').nth(1).unwrap().parse().unwrap()
    };
    for (name, truth) in [("a", 1.7), ("b", 0.9)] {
        let (mean, sd) = (value(&format!("mean({name})")), value(&format!("sd({name})")));
        assert!((mean - truth).abs() < sd && sd < 0.15, "{name}: {mean} {sd}\n{summary}");
    }
}

#[test]
fn runs_of_several_tables_are_as_those_of_one() {
    let folder = folder(60);
    let path = folder.path();
    let one = run(tool("gl-emulate", path).args(BEFORE).args(["--check", "ensemble.txt"])).1;
    for (table, per_run) in [("samples", 1), ("ensemble", 10)] {
        let text = fs::read_to_string(path.join(format!("{table}.txt"))).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let (header, rows) = lines.split_first().unwrap();
        for (name, part) in [("a", &rows[..25 * per_run]), ("b", &rows[25 * per_run..])] {
            fs::write(path.join(format!("{table}-{name}.txt")), format!("{header}\n{}\n", part.join("\n")))
                .unwrap();
        }
    }
    let mut command = tool("gl-emulate", path);
    command.args(["-p", "params.txt", "-s", "samples-a.txt", "-s", "samples-b.txt", "--check"]);
    let (code, several, stderr) = run(command.args(["ensemble-a.txt", "ensemble-b.txt"]));
    assert_eq!((code, stderr.as_str(), several), (0, "", one));
}

//! Whole calibrations by `gl-calibrate`.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

use crate::folder::Folder;
use crate::{example, programs};

/// Copy an example into a folder as `case`, with some settings of its `case.toml` replaced, each a key and a value
/// in the words of TOML.
pub fn copy_case(folder: &Folder, name: &str, settings: &[(&str, &str)]) {
    for entry in std::fs::read_dir(example(name)).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            let file = format!("case/{}", path.file_name().unwrap().display());
            folder.write(&file, std::fs::read(path).unwrap());
        }
    }
    set(folder, settings);
}

/// A case of a curve over x from 0 to 1, simulated by awk, as `case`: what is measured is `curve` and a noise of 0.01 that
/// is the same at each run of a test.
///
/// * `variables` — `-v NAME={PARAMETER} …`, of the `simulated` expression in x.
pub fn write_curve(
    folder: &Folder,
    (name, params): (&str, &str),
    curve: impl Fn(f64) -> f64,
    (variables, simulated): (&str, &str),
) {
    let reading = |i: u32| (f64::from(i) / 30.0, 0.01 * (f64::from(i * i * 7919 % 101) / 50.0 - 1.0));
    let rows = (0..31).map(reading).map(|(x, noise)| format!("{x}\t{}\n", curve(x) + noise));
    folder.write("case/params.txt", params);
    folder.write("case/obs.txt", format!("x\ty\n{}", rows.collect::<String>()));
    folder.write(
        "case/case.toml",
        format!(
            "name = \"{name}\"\ncontrol = \"x\"\nobservables = [\"y\"]\nnoise = {{ y = 0.01 }}\ndesign_num = 50\n\n[model]\n\
             local = \"awk -f {{case}}/curve.awk {variables} -v name={{description}}\"\n"
        ),
    );
    folder.write(
        "case/curve.awk",
        format!(
            "BEGIN {{ CONVFMT = \"%.12g\"; file = name \"_sim.txt\"; print \"x\\ty\" > file\n\
             for (i = 0; i < 31; i++) {{ x = i / 30; print x \"\\t\" {simulated} > file }} }}\n"
        ),
    );
}

/// Replace settings of `case/case.toml`.
pub fn set(folder: &Folder, settings: &[(&str, &str)]) {
    let mut lines: Vec<String> = folder.read("case/case.toml").lines().map(str::to_owned).collect();
    for (key, value) in settings {
        lines.retain(|line| !line.starts_with(&format!("{key} = ")));
        lines.insert(0, format!("{key} = {value}"));
    }
    folder.write("case/case.toml", lines.join("\n") + "\n");
}

/// A driver, called in a folder, in a process group of its own.
pub fn driver(folder: &Folder, tool: &str) -> Command {
    let mut command = Command::new(programs().join(tool));
    command
        .env_remove("MAKEFLAGS")
        .env_remove("MAKELEVEL")
        .env_remove("PACKED")
        .current_dir(folder.path(""))
        .process_group(0)
        .stdin(Stdio::null());
    command
}

/// `gl-calibrate case --engine ENGINE --out OUT` in a folder.
pub fn calibrate(folder: &Folder, engine: &str, out: &str) -> Command {
    let mut command = driver(folder, "gl-calibrate");
    command.args(["case", "--engine", engine, "--out", out]);
    command
}

/// Run a command to its end, which must be a good one: what it says on stdout and on stderr.
///
/// # Panics
/// If it fails.
pub fn finish(command: &mut Command) -> (String, String) {
    let output: Output = command.output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{stdout}{stderr}");
    (stdout, stderr)
}

/// Kill a process and all that it started.
pub fn kill_group(child: &mut Child) {
    let group = format!("-{}", child.id());
    Command::new("kill").args(["-KILL", "--", &group]).stderr(Stdio::null()).status().unwrap();
    child.wait().unwrap();
}

/// The tables of a calibration, without the runs and logs, which hold times and process numbers.
pub fn tables(folder: &Folder, out: &str) -> BTreeMap<PathBuf, Vec<u8>> {
    let is_table = |file: &PathBuf| {
        let name = file.display().to_string();
        name.starts_with(&format!("{out}/")) && !name.contains("/runs/") && !name.ends_with(".log")
    };
    let files = folder.files().into_iter().filter(|(file, _)| is_table(file));
    files.map(|(file, bytes)| (file.strip_prefix(out).unwrap().to_owned(), bytes)).collect()
}

/// The last posterior of a calibration.
pub fn posterior(folder: &Folder, out: &str) -> String {
    let last = (0..).take_while(|i| folder.path(&format!("{out}/iter{i}/stop.code")).exists()).last();
    format!("{out}/iter{}/posterior.txt", last.unwrap())
}

/// E/(1 − ν²) in Pa of the collision, from the posterior's runs: its mean and standard deviation.
pub fn stiffness(folder: &Folder, out: &str) -> (f64, f64) {
    let weights = posterior(folder, out).replace("posterior.txt", "posterior-weights.txt");
    let [e, nu, w] = ["E_m", "nu", "weight"].map(|name| folder.column(&weights, name));
    let stiffness: Vec<f64> = e.iter().zip(&nu).map(|(e, nu)| 10f64.powf(*e) / (1.0 - nu * nu)).collect();
    (gl_numeric::statistics::mean(&stiffness, &w), gl_numeric::statistics::sd(&stiffness, &w))
}

/// The collision's true E/(1 − ν²), Pa.
pub const STIFFNESS: f64 = 1.995_262_314_968_88e9 / 0.96;

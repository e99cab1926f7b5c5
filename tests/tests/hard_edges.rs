//! Numbers at the ends of what a number can say, outputs that meet, streams that break off.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::os::unix::fs::symlink;
use std::process::Command;
use std::thread;

use pipelines::folder::Folder;
use pipelines::{line, path_with_tools};

const COLLECT: &str =
    "gl-collect -s samples.txt -b obs.txt -c x -v y runs -o ensemble.txt --status status.txt";
const LIKELIHOOD: &str = "gl-likelihood -b obs.txt -c x -v y ensemble.txt -o misfit.txt";
const FILTER: &str = "gl-filter -s samples.txt -p params.txt misfit.txt -o weights.txt --summary summary.txt";

/// A line whose ensemble of `n` runs is collected already.
fn collected(n: usize) -> Folder {
    let folder = Folder::default();
    line::measure(&folder, (0.5, 4.0), 0.3, 1);
    folder.run(&format!("gl-sample -p params.txt -n {n} -o samples.txt"));
    line::simulate(&folder, "samples.txt", "runs");
    folder.run(COLLECT);
    folder
}

/// The lines of a table, with the last field of the last row replaced.
fn with_last_field(table: &str, field: &str) -> String {
    let end = table.trim_end().rfind(['\t', ' ']).unwrap() + 1;
    format!("{}{field}\n", &table[..end])
}

fn shell(folder: &Folder, script: &str) -> std::process::Output {
    Command::new("bash")
        .args(["-c", &format!("set -o pipefail; {script}")])
        .current_dir(folder.path("."))
        .env("PATH", path_with_tools())
        .output()
        .unwrap()
}

#[test]
fn a_run_that_blew_up_but_stayed_finite_fails_alone() {
    let folder = collected(12);
    let run = fs::read_dir(folder.path("runs"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.to_string_lossy().ends_with("_sim.txt"))
        .unwrap();
    let text = fs::read_to_string(&run).unwrap();
    fs::write(&run, with_last_field(&text, "1e200")).unwrap();
    folder.run(COLLECT);
    let status = folder.read("status.txt");
    assert!(status.contains("non-finite") && status.contains("the run blew up"), "{status}");
    folder.run(LIKELIHOOD);
    folder.run(FILTER);
    assert_eq!(
        (folder.quantity("summary.txt", "runs"), folder.quantity("summary.txt", "failed")),
        (11.0, 1.0)
    );
}

#[test]
fn a_misfit_beyond_numbers_leaves_its_run_out_and_is_said() {
    let folder = collected(6);
    folder.write("ensemble.txt", with_last_field(&folder.read("ensemble.txt"), "1e200"));
    let said = folder.run(LIKELIHOOD);
    assert!(said.contains("1 runs left out"), "{said}");
    let misfits = folder.read("misfit.txt");
    assert!(!misfits.contains("inf") && !misfits.contains("NaN"), "{misfits}");
}

#[test]
fn variances_beyond_numbers_are_refused() {
    let folder = collected(6);
    folder.refuses(
        "gl-likelihood -b obs.txt -c x -v y --noise y=0.1 --sigma 5e-324 ensemble.txt -o misfit.txt",
        &["beyond what a number can say"],
    );
    folder.write("obs.txt", with_last_field(&folder.read("obs.txt"), "1e155"));
    folder.refuses(LIKELIHOOD, &["obs.txt", "beyond what a number can say"]);
}

#[test]
fn writers_to_one_file_leave_the_table_of_one_of_them() {
    let folder = collected(6);
    folder.run("gl-sample -p params.txt -n 3000 --name a -o a.txt");
    folder.run("gl-sample -p params.txt -n 3000 --name b -o b.txt");
    let one_of = [folder.read("a.txt"), folder.read("b.txt")];
    for _ in 0..10 {
        thread::scope(|scope| {
            for name in ["a", "b"] {
                let folder = &folder;
                scope.spawn(move || {
                    folder.run(&format!("gl-sample -p params.txt -n 3000 --name {name} -o same.txt"));
                });
            }
        });
        assert!(one_of.contains(&folder.read("same.txt")));
    }
}

#[test]
fn a_link_in_the_way_of_a_part_is_not_followed() {
    let folder = collected(6);
    folder.write("precious.txt", "keep\n");
    symlink(folder.path("precious.txt"), folder.path(".misfit.txt.part")).unwrap();
    folder.run(LIKELIHOOD);
    assert_eq!(folder.read("precious.txt"), "keep\n");
}

#[test]
fn two_outputs_to_one_file_are_refused() {
    let folder = collected(6);
    folder.run(LIKELIHOOD);
    folder.refuses(
        "gl-filter -s samples.txt -p params.txt misfit.txt -o w.txt --summary w.txt",
        &["w.txt: two outputs are to go there"],
    );
}

#[test]
fn a_stream_that_breaks_off_does_not_pass_for_complete() {
    let folder = collected(14);
    let ensemble = folder.read("ensemble.txt");
    let cut = ensemble.lines().count() / 2;
    let spoilt: Vec<String> = ensemble
        .lines()
        .enumerate()
        .map(|(i, line)| if i == cut { line.replace('\t', "\tabc") } else { line.to_owned() })
        .collect();
    folder.write("ensemble.txt", spoilt.join("\n") + "\n");
    let output = shell(
        &folder,
        "set +o pipefail; gl-likelihood -b obs.txt -c x -v y ensemble.txt | gl-filter -s samples.txt -o w.txt",
    );
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(!folder.path("w.txt").exists());
}

#[test]
fn a_stream_that_breaks_off_late_says_so_in_its_last_line() {
    let folder = collected(6);
    let output =
        folder.call("gl-filter -s samples.txt -o w.txt -", "sample\tstep\tmisfit\terror\n!incomplete\n");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("stdin:2: the table ends here"));
}

#[test]
fn a_number_that_may_be_cut_off_is_refused() {
    let folder = collected(6);
    let obs = folder.read("obs.txt");
    folder.write("obs.txt", obs.trim_end());
    folder.refuses(LIKELIHOOD, &["obs.txt:", "the last line has no end"]);
    folder.write("obs.txt", obs);
    folder.run(LIKELIHOOD);
    let misfits = folder.read("misfit.txt");
    folder.write("misfit.txt", misfits.trim_end());
    folder.refuses(FILTER, &["misfit.txt:", "cut off"]);
    folder.write("misfit.txt", misfits);
    folder.run(FILTER);
    folder.write("weights.txt", folder.read("weights.txt").trim_end());
    folder.refuses("gl-predict -w weights.txt ensemble.txt -o predicted.txt", &["weights.txt:", "no end"]);
}

#[test]
fn lines_that_end_with_cr_alone_are_refused() {
    let folder = collected(6);
    folder.write("samples.txt", folder.read("samples.txt").replace('\n', "\r"));
    folder.refuses(COLLECT, &["samples.txt: its lines end with CR alone"]);
}

#[test]
fn steps_beyond_the_measurement_are_refused() {
    let folder = collected(6);
    let steps = folder.read("obs.txt").lines().count() - 1;
    folder.refuses(
        "gl-likelihood -b obs.txt -c x -v y --steps 0:999 ensemble.txt -o misfit.txt",
        &["--steps 0:999", &format!("the measurement has {steps} steps")],
    );
}

#[test]
fn a_closed_stdout_is_an_error() {
    let folder = collected(6);
    let output = shell(&folder, "gl-sample -p params.txt -n 4 >&-");
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
    let output = shell(&folder, "gl-sample -p params.txt -n 4 >/dev/null");
    assert_eq!(output.status.code(), Some(0));
}

#[test]
fn absurd_numbers_of_samples_are_refused() {
    let folder = collected(6);
    for n in ["1000000000", "18446744073709551615"] {
        folder.refuses(&format!("gl-sample -p params.txt -n {n} -o many.txt"), &["-n", n]);
    }
}

#[test]
fn twenty_parameters_and_components_are_drawn_one_way_or_the_other() {
    let folder = Folder::default();
    let rows: String = (0..20).map(|j| format!("p{j} 0 1\n")).collect();
    folder.write("params.txt", format!("name lower upper\n{rows}"));
    folder.run("gl-sample -p params.txt -n 400 -o samples.txt");
    let samples = folder.table("samples.txt");
    let names: Vec<String> = (0..20).map(|j| format!("p{j}")).collect();
    let mut weights = format!("sample\t{}\tweight\n", names.join("\t"));
    for row in 0..samples.len() {
        let fields: Vec<&str> = (2..22).map(|j| samples.field(row, j)).collect();
        weights += &format!("s{row}\t{}\t1\n", fields.join("\t"));
    }
    folder.write("weights.txt", weights);
    let said = folder.run("gl-gmm-resample -p params.txt -n 200 --components 20 weights.txt -o next.txt");
    assert_eq!(folder.table("next.txt").len(), 200, "{said}");
}

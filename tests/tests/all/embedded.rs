//! The embedded simulators, from samples to an ensemble.

use std::fs;

use assert_cmd::Command;
use gl_case::{Case, Engine};
use gl_table::Table;
use pipelines::{example, tool};

/// The case of an example.
fn case(name: &str) -> Case {
    Case::load::<&str>(&example(name), &[]).unwrap()
}

const EXAMPLES: [&str; 2] = ["contact-effects", "triaxial-element"];

#[test]
fn every_run_of_a_switch_design_is_collected() {
    for name in EXAMPLES {
        let dir = tempfile::tempdir().unwrap();
        let (samples, runs) = (dir.path().join("samples.txt"), dir.path().join("runs"));
        let params = example(name).join("params.txt");
        tool("gl-sample")
            .args(["-n", "48", "--effects", "switch", "-p"])
            .arg(params)
            .arg("-o")
            .arg(&samples)
            .assert()
            .success();
        let case = case(name);
        let model = case.model.of(Engine::Embedded).unwrap();
        let mut words = model.split(' ');
        let mut simulate = tool(words.next().unwrap());
        simulate.args(words).arg("-s").arg(&samples).arg(&runs).assert().success().stdout("");
        let ensemble = dir.path().join("ensemble.tsv");
        tool("gl-collect")
            .args([
                "--max-failed",
                "0",
                "-c",
                &case.tests[0].control.measured,
                "-v",
                &case.tests[0].observable_names().join(","),
                "-s",
            ])
            .arg(&samples)
            .arg("-b")
            .arg(example(name).join("obs.txt"))
            .arg("-o")
            .arg(&ensemble)
            .arg(&runs)
            .assert()
            .success();
        let steps = Table::read(&example(name).join("obs.txt")).unwrap().len();
        assert_eq!(Table::read(&ensemble).unwrap().len(), 48 * steps);
    }
}

#[test]
fn measurements_of_the_examples_are_made_again_by_their_scripts() {
    let dir = tempfile::tempdir().unwrap();
    for name in EXAMPLES {
        let again = dir.path().join(name);
        Command::new(example(name).join("make-obs")).arg(&again).assert().success();
        let (found, kept) =
            (Table::read(&again).unwrap(), Table::read(&example(name).join("obs.txt")).unwrap());
        assert_eq!(found.format().columns(), kept.format().columns());
        for column in found.format().columns() {
            for (found, kept) in found.numbers(column).unwrap().iter().zip(kept.numbers(column).unwrap()) {
                assert!((found - kept).abs() <= 1e-9 * kept.abs().max(1e-3), "{column}: {found} for {kept}");
            }
        }
    }
}

#[test]
fn readmes_say_the_command_that_makes_the_measurement() {
    for name in EXAMPLES {
        let script = fs::read_to_string(example(name).join("make-obs")).unwrap();
        let command = script.lines().last().unwrap().replace("\"${1:-obs.txt}\"", "obs.txt");
        let readme = fs::read_to_string(example(name).join("README.md")).unwrap();
        assert!(readme.contains(&format!("    {command}\n")), "{command}");
    }
}

#[test]
fn a_curve_made_at_the_controls_of_a_measurement_has_its_rows() {
    let obs = "e_z q\n0.001 0\n0.01 0\n0.05 0\n";
    let output = tool("gl-triaxial")
        .args(["--curve", "G0=100", "-c", "e_z", "-b", "-"])
        .write_stdin(obs)
        .assert()
        .success();
    let table = Table::parse("curve", output.get_output().stdout.clone()).unwrap();
    assert_eq!(table.numbers("e_a").unwrap(), [0.001, 0.01, 0.05]);
}

#[test]
fn bad_input_is_said_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let runs = dir.path().join("runs");
    let refused = |tool_name: &str, arguments: &[&str], stdin: &str, message: &str| {
        let assert =
            tool(tool_name).args(arguments).arg(&runs).write_stdin(stdin).assert().code(2).stdout("");
        let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(stderr.contains(message), "{stderr}");
        assert!(!runs.exists(), "{message}");
    };
    let table = "description key nu\na 0 0.2\n";
    refused(
        "gl-contact",
        &["-s", "-"],
        "description key x\na 0 1\n",
        "stdin:1: unknown parameter x; the parameters are E_m",
    );
    refused("gl-contact", &["-s", "-"], "description key nu\n../a 0 0.2\n", "stdin:2: column description");
    refused("gl-contact", &["-s", "-", "--steps", "0"], table, "\"0\" is not a number from 1");
    refused("gl-contact", &["-s", "-", "--radius=-1"], table, "radius -1: must be positive");
    refused("gl-contact", &["-s", "-", "--overlap", "NaN"], table, "displacement NaN");
    refused("gl-contact", &["-s", "-", "--overlap", "0.1"], table, "the radius is 0.001 only");
    refused("gl-contact", &["-s", "-", "--speed", "0"], table, "speed 0: must be positive");
    refused(
        "gl-triaxial",
        &["-s", "-", "--strain", "1.5"],
        table,
        "must increase, from 0 or above to less than 1",
    );
    refused("gl-triaxial", &["-s", "-", "--cell", "inf"], table, "cell pressure inf");
    refused("gl-triaxial", &["-s", "-"], table, "unknown parameter nu; the parameters are G0");
    refused("gl-triaxial", &["--curve", "phi=3"], "", "unknown parameter phi");
    refused("gl-triaxial", &["--curve", "de=0.5,c=-3"], "", "c = -3, but it makes sense from 0 to 1000 only");
    refused(
        "gl-contact",
        &["--curve", "nu=0.2", "--noise", "f=-1"],
        "",
        "--noise f=-1: a standard deviation",
    );
    refused("gl-triaxial", &[], "", "--samples");
}

#[test]
fn a_failed_run_leaves_the_others_and_exits_with_success() {
    let dir = tempfile::tempdir().unwrap();
    let assert = tool("gl-contact")
        .args(["-s", "-"])
        .arg(dir.path())
        .write_stdin("description key nu\na 0 0.2\nb 1 0.7\n")
        .assert()
        .success()
        .stdout("");
    let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert_eq!(
        stderr,
        "gl-contact: b: nu = 0.7, but it makes sense from 0 to 0.5 only\n\
         gl-contact: 1 runs done, 0 kept, 1 failed\n"
    );
    assert!(dir.path().join("a_sim.txt").exists() && !dir.path().join("b_sim.txt").exists());
}

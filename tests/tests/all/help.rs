//! Every tool's `--help`: its examples run as they stand there.

use std::fs;
use std::process::Command;

use pipelines::folder::Folder;
use pipelines::{example, path_with_tools, root};

/// All tools, those that draw or that have subcommands with each of these.
fn calls() -> Vec<String> {
    let mut calls: Vec<String> = fs::read_dir(root().join("tools"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.starts_with("gl-"))
        .collect();
    for kind in ["fit", "posterior", "pairs", "history", "proposal", "emulator", "gap", "attribution"] {
        calls.push(format!("gl-plot {kind}"));
    }
    calls.sort();
    calls
}

/// The indented lines under a line that begins with `Example`.
fn examples(help: &str) -> String {
    let mut examples = String::new();
    let mut is_example = false;
    for line in help.lines() {
        if line.starts_with("Example") {
            is_example = true;
        } else if is_example && (line.starts_with("  ") || line.is_empty()) {
            examples.push_str(line);
            examples.push('\n');
        } else {
            is_example = false;
        }
    }
    examples
}

/// One iteration of the collision, in the files that the examples name.
fn iteration() -> Folder {
    let folder = Folder::default();
    for file in ["params.txt", "obs.txt"] {
        folder.write(file, fs::read(example("collision").join(file)).unwrap());
    }
    folder.run("gl-sample -p params.txt -n 20 -o samples.txt");
    folder.run("gl-contact -s samples.txt sims");
    folder.run("gl-collect -s samples.txt -b obs.txt -c u -v f sims -o ensemble.txt");
    folder.run("gl-likelihood -b obs.txt -c u -v f --noise f=0.02 ensemble.txt -o misfit.txt");
    folder.run("gl-filter -s samples.txt --summary summary.txt misfit.txt -o weights.txt");
    folder
}

#[test]
fn every_example_runs() {
    for call in calls() {
        let folder = iteration();
        let examples = examples(&folder.stdout(&format!("{call} --help")));
        assert!(examples.contains("gl-"), "{call} --help has no example");
        let output = Command::new("sh")
            .args(["-e", "-c", &examples])
            .current_dir(folder.path("."))
            .env("PATH", format!("{}:{}", root().join("tests/scripts/fake-pbs").display(), path_with_tools()))
            .env("FAKE_PBS", folder.path("."))
            .output()
            .unwrap();
        // gl-check-stop answers that the calibration goes on.
        let expected = if call == "gl-check-stop" { 1 } else { 0 };
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(expected), "{examples}\n{stderr}");
    }
}

#[test]
fn examples_are_not_wrapped_on_a_terminal_of_80_columns() {
    for call in calls() {
        let help = Folder::default().stdout(&format!("{call} --help"));
        for line in examples(&help).lines() {
            assert!(line.chars().count() <= 80, "{call}: {line}");
        }
    }
}

#[test]
fn bash_completes_the_flags_of_a_subcommand() {
    let script = "source /dev/stdin <<<\"$(gl-plot --generate bash)\"
        COMP_WORDS=(gl-plot fit --obs) COMP_CWORD=2
        $(complete -p gl-plot | sed 's/.*-F \\([^ ]*\\).*/\\1/') gl-plot --obs fit
        echo \"${COMPREPLY[@]}\"";
    let output = Command::new("bash").args(["-c", script]).env("PATH", path_with_tools()).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&output.stdout), "--observables --observations\n");
}

#[test]
fn every_subcommand_has_a_manual_page() {
    let folder = Folder::default();
    assert_eq!(folder.stdout("gl-box --generate kinds"), "narrow\nwiden\n");
    for tool in ["gl-plot", "gl-run", "gl-box", "gl-blind"] {
        for kind in folder.stdout(&format!("{tool} --generate kinds")).lines() {
            let page = folder.stdout(&format!("{tool} --generate man {kind}"));
            assert!(page.contains(&format!(".TH {tool}-{kind} ")), "{tool} {kind}: {page:.400}");
        }
    }
    folder.refuses("gl-box --generate man other", &["--generate man other: gl-box has no such subcommand"]);
}

//! Clusters: the scripts that wait for a scheduler, which takes minutes and hardly a processor, beside all that computes.

use std::process::Command;

use pipelines::{path_with_tools, root};

#[test]
fn scripts_that_wait_for_a_scheduler_pass_their_own_tests() {
    let run = root().join("tests/scripts/run");
    let files = ["cluster-test.sh", "queue-test.sh"];
    let output = Command::new(run).args(files).env("PATH", path_with_tools()).output().unwrap();
    let said =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}");
    eprint!("{said}");
}

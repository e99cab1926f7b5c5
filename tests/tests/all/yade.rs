//! The collision by real runs of Yade.

use pipelines::calibration::{STIFFNESS, calibrate, copy_case, finish, posterior, stiffness};
use pipelines::folder::Folder;
use pipelines::require;

/// E/(1 − ν²) is all that a normal load tells: to 1 %, and the intervals of E and nu hold the truth.
#[test]
fn the_collision_is_calibrated_by_yade_batch_to_one_percent() {
    if !require("yade") || !require("yade-batch") {
        return;
    }
    let folder = Folder::default();
    // Yade takes a second to start: bounds nearer to the truth want fewer runs.
    copy_case(&folder, "collision", &[("num", "12"), ("iterations", "3")]);
    folder.write("case/params.txt", "name lower upper\nE_m 9 9.6\nnu 0 0.5\n");
    let (stdout, stderr) = finish(&mut calibrate(&folder, "yade-batch", "out"));
    let (mean, _) = stiffness(&folder, "out");
    assert!((mean / STIFFNESS - 1.0).abs() < 0.01, "{mean} is not {STIFFNESS}\n{stdout}{stderr}");
    let summary = posterior(&folder, "out");
    assert_eq!(folder.quantity(&summary, "failed"), 0.0);
    for (name, truth) in [("E_m", 9.3), ("nu", 0.2)] {
        let bound = |q: &str| folder.quantity(&summary, &format!("{q}({name})"));
        assert!((bound("q05")..=bound("q95")).contains(&truth), "{name}");
    }
}

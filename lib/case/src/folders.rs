//! The folders of a diagnosis, by the names that what writes, shows and reports them agrees on.

use std::path::{Path, PathBuf};

/// The calibration of the base model.
pub const BASE: &str = "base";

/// The same within the prior that the design has widened.
pub const BASE_WIDER: &str = "base-wider";

/// The closest fit of a calibration, which goes on from its runs.
pub fn closest(calibration: &Path) -> PathBuf {
    let name = calibration.file_name().unwrap_or_default().to_string_lossy();
    calibration.with_file_name(format!("closest-{name}"))
}

/// The table of what the draws of a calibration predict of each reading, in its folder and in those of its iterations.
pub const CURVES: &str = "posterior-curves.txt";

/// The table of the two calibrations that a shrink was measured between, `part folder`, by their names in the folder of the
/// diagnosis.
pub const SHRINK_BETWEEN: &str = "shrink-between.txt";

/// The shrink at steps that no calibration sees: its table, what it concludes and its words.
pub const SHRINK_UNSEEN: [&str; 3] = ["shrink-unseen.txt", "shrink-unseen-verdict.txt", "shrink-unseen.log"];

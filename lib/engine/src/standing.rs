//! How far the runs of an iteration or a round have come.

use std::collections::HashSet;
use std::fs;
use std::iter::Sum;
use std::path::Path;
use std::time::{Duration, SystemTime};

use anyhow::Result;

use crate::batch_table::BatchTable;
use crate::cluster::Task;
use crate::complete;
use crate::control::batches;

/// The runs of a folder `iterN` or `roundN`, or of one test of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Runs {
    /// Rows of its table.
    pub rows: usize,
    /// Those whose run is complete.
    pub done: usize,
    /// Those that a process or task has begun.
    pub running: usize,
    /// Those that have failed, and were not begun again.
    pub failed: usize,
    /// Those that have ended since runs were last started here, well or not.
    pub ended: usize,
    /// Since when they end.
    pub since: Option<SystemTime>,
}

impl Runs {
    /// Those of each test, by its name; where there is one test, its runs without a name.
    ///
    /// # Errors
    /// If a table or folder cannot be read.
    pub fn of_tests(stage: &Path) -> Result<Vec<(String, Self)>> {
        let name = |batch: &Path| {
            let test = batch.strip_prefix(stage).unwrap_or(batch);
            test.display().to_string()
        };
        batches(stage)?.iter().map(|batch| Ok((name(batch), Self::of_batch(batch)?))).collect()
    }

    /// Look into a folder with `samples.txt` and, if runs were started, `runs`.
    fn of_batch(stage: &Path) -> Result<Self> {
        let table = BatchTable::read(&stage.join("samples.txt"))?;
        let dir = stage.join("runs");
        let mut runs = Self { rows: table.len(), ..Self::default() };
        if !dir.is_dir() {
            return Ok(runs);
        }
        let work = dir.join(".run");
        let changed = |path: &Path| fs::metadata(path).and_then(|found| found.modified()).ok();
        let attempt = changed(&work.join("samples.txt"));
        runs.since = changed(&work.join("started")).or(attempt);
        // Those of an array have no status from before; of others the time tells.
        let task = Task::load(&work).ok();
        let submitted: Option<HashSet<usize>> = task.map(|task| task.rows.into_iter().collect());
        let is_new = |row: usize, path: &Path| match (&submitted, attempt) {
            (Some(rows), _) => rows.contains(&row),
            (None, Some(attempt)) => changed(path).is_some_and(|time| time >= attempt),
            (None, None) => false,
        };
        for (row, status) in complete::status(&table, &dir)?.into_iter().enumerate() {
            let name = table.name(row);
            let status_file = dir.join(format!("{name}.status"));
            if status.is_ok() {
                runs.done += 1;
                runs.ended += usize::from(
                    is_new(row, &status_file) || is_new(row, &dir.join(format!("{name}_packed.txt"))),
                );
            } else if work.join(format!("{name}.running")).exists() {
                runs.running += 1;
            } else if status_file.exists() && (attempt.is_none() || is_new(row, &status_file)) {
                runs.failed += 1;
                runs.ended += 1;
            }
        }
        Ok(runs)
    }

    /// Those that have not begun.
    pub fn to_come(&self) -> usize {
        self.rows - self.done - self.running - self.failed
    }

    /// How long the rest takes, if it goes on as since runs were last started.
    pub fn forecast(&self, now: SystemTime) -> Option<Duration> {
        let left = self.rows - self.done - self.failed;
        let spent = now.duration_since(self.since?).ok()?;
        (left > 0 && self.ended > 0).then(|| spent.mul_f64(left as f64 / self.ended as f64))
    }
}

impl Sum for Runs {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |sum, runs| Self {
            rows: sum.rows + runs.rows,
            done: sum.done + runs.done,
            running: sum.running + runs.running,
            failed: sum.failed + runs.failed,
            ended: sum.ended + runs.ended,
            since: [sum.since, runs.since].into_iter().flatten().min(),
        })
    }
}

/// A time as people say it: `about 13 min`.
pub fn roughly(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        5400.. => format!("about {} h", (seconds + 1800) / 3600),
        90.. => format!("about {} min", (seconds + 30) / 60),
        _ => format!("about {seconds} s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with five rows: complete, failed, running, and two to come.
    fn stage() -> tempfile::TempDir {
        let stage = tempfile::tempdir().unwrap();
        let path = |name: &str| stage.path().join(name);
        let rows: String = (0..5).map(|i| format!("r{i}\t{i}\n")).collect();
        fs::write(path("samples.txt"), format!("description\ta\n{rows}")).unwrap();
        fs::create_dir_all(path("runs/.run")).unwrap();
        fs::write(path("runs/.run/samples.txt"), "").unwrap();
        fs::write(path("runs/r0_param.txt"), "a\n0\n").unwrap();
        fs::write(path("runs/r0_sim.txt"), "u\tf\n0\t1\n").unwrap();
        fs::write(path("runs/r0.status"), "0\n").unwrap();
        fs::write(path("runs/r1.status"), "3\n").unwrap();
        fs::write(path("runs/.run/r2.running"), "17_0\n").unwrap();
        stage
    }

    #[test]
    fn each_run_is_counted_once() {
        let stage = stage();
        let runs = Runs::of_batch(stage.path()).unwrap();
        assert_eq!((runs.rows, runs.done, runs.running, runs.failed, runs.to_come()), (5, 1, 1, 1, 2));
        assert_eq!(runs.ended, 2);
    }

    #[test]
    fn a_run_that_is_to_be_tried_again_has_not_failed_yet() {
        let stage = stage();
        let table =
            fs::File::options().append(true).open(stage.path().join("runs/.run/samples.txt")).unwrap();
        table.set_modified(SystemTime::now() + Duration::from_secs(60)).unwrap();
        let runs = Runs::of_batch(stage.path()).unwrap();
        assert_eq!((runs.done, runs.failed, runs.to_come(), runs.ended), (1, 0, 3, 0));
    }

    #[test]
    fn runs_that_an_array_was_not_submitted_for_say_nothing_of_its_pace() {
        let stage = stage();
        let task = Task { rows: vec![1, 2, 3, 4], rows_per_task: 1, scratch: None };
        fs::write(stage.path().join("runs/.run/task.json"), serde_json::to_string(&task).unwrap()).unwrap();
        let runs = Runs::of_batch(stage.path()).unwrap();
        assert_eq!((runs.done, runs.failed, runs.ended), (1, 1, 1));
    }

    #[test]
    fn the_rest_takes_as_long_a_run_as_those_that_have_ended() {
        let now = SystemTime::now();
        let runs = Runs {
            rows: 40,
            done: 9,
            failed: 1,
            running: 2,
            ended: 10,
            since: Some(now - Duration::from_secs(100)),
        };
        assert_eq!(runs.forecast(now), Some(Duration::from_secs(300)));
        assert_eq!(Runs { ended: 0, ..runs.clone() }.forecast(now), None);
        assert_eq!(Runs { done: 39, ..runs }.forecast(now), None);
        for (seconds, expected) in
            [(89, "about 89 s"), (90, "about 2 min"), (5399, "about 90 min"), (5400, "about 2 h")]
        {
            assert_eq!(roughly(Duration::from_secs(seconds)), expected);
        }
    }

    #[test]
    fn the_runs_of_several_tests_count_together() {
        let (one, whole) = (stage(), tempfile::tempdir().unwrap());
        fs::copy(one.path().join("samples.txt"), whole.path().join("samples.txt")).unwrap();
        fs::create_dir(whole.path().join("tx200")).unwrap();
        fs::copy(one.path().join("samples.txt"), whole.path().join("tx200/samples.txt")).unwrap();
        fs::rename(one.path(), whole.path().join("tx100")).unwrap();
        let tests = Runs::of_tests(whole.path()).unwrap();
        assert_eq!(tests.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["tx100", "tx200"]);
        assert_eq!((tests[0].1.done, tests[0].1.to_come(), tests[1].1.to_come()), (1, 2, 5));
        let runs: Runs = tests.into_iter().map(|(_, runs)| runs).sum();
        assert_eq!((runs.rows, runs.done, runs.running, runs.failed, runs.to_come()), (10, 1, 1, 1, 7));
    }

    #[test]
    fn samples_without_runs_are_all_to_come() {
        let stage = stage();
        fs::remove_dir_all(stage.path().join("runs")).unwrap();
        assert_eq!(Runs::of_batch(stage.path()).unwrap().to_come(), 5);
    }
}

//! The tools, called with tables and flags that were spoilt at random.
//!
//! A thousand cases, always the same. `FUZZ=100000` runs so many, of seeds from `FUZZ_FROM` (default 0) on;
//! `FUZZ_SEED=n` runs one.

use std::env;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use pipelines::fuzz::World;

/// So many cases are run always.
const CASES: u64 = 1000;
/// Failures after which there is no need of more.
const ENOUGH: usize = 200;

fn given(name: &str) -> Option<u64> {
    env::var(name).ok().and_then(|value| value.parse().ok())
}

#[test]
fn spoilt_tables_and_flags_end_in_a_result_or_a_message() {
    let world = World::new();
    let unsound: Vec<String> = world.sound().into_iter().map(|failure| failure.report).collect();
    assert!(unsound.is_empty(), "{}", unsound.join("\n"));

    let from = given("FUZZ_SEED").or(given("FUZZ_FROM")).unwrap_or(0);
    let count = given("FUZZ_SEED").map_or(given("FUZZ").unwrap_or(CASES), |_| 1);
    let next = AtomicU64::new(from);
    let failures = Mutex::new(Vec::new());
    let work = || loop {
        let seed = next.fetch_add(1, Ordering::Relaxed);
        let is_enough = failures.lock().is_ok_and(|failures| failures.len() >= ENOUGH);
        if seed >= from + count || is_enough {
            break;
        }
        if let (Some(failure), Ok(mut failures)) = (world.spoilt(seed), failures.lock()) {
            failures.push(failure.report);
        }
    };
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    let failures = failures.into_inner().unwrap_or_default();
    assert!(failures.is_empty(), "{} cases failed\n\n{}", failures.len(), failures.join("\n"));
}

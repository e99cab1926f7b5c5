//! How far a long computation has come.
//!
//! The library shows nothing. It tells a watcher, if there is one; `gl_cli::parse` sets one where a
//! tool's messages go to a terminal.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whoever wants to know.
pub trait Watcher: Send + Sync {
    /// Something begins that has so many pieces.
    fn begin(&self, what: &str, pieces: usize);
    /// One more piece is done; called from any thread.
    fn advance(&self);
    /// What began has ended.
    fn end(&self);
}

/// Tell this watcher from now on; the first one stays.
pub fn watch(watcher: Box<dyn Watcher>) {
    // Two would fight over the same line.
    let _ = WATCH.watcher.set(watcher);
}

/// Begin something that has so many pieces. What begins within something else is a part of it, and its
/// own pieces are not told.
pub fn stage(what: &str, pieces: usize) -> Stage<'static> {
    WATCH.stage(what, pieces)
}

/// Something that takes a while, until it is dropped.
#[must_use = "a stage ends where it is dropped"]
pub struct Stage<'a>(Option<&'a Watch>);

impl Stage<'_> {
    /// One more piece is done.
    pub fn advance(&self) {
        if let Some(watcher) = self.0.and_then(|watch| watch.watcher.get()) {
            watcher.advance();
        }
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        let Some(watch) = self.0 else { return };
        watch.watcher.get().inspect(|watcher| watcher.end());
        watch.is_busy.store(false, Ordering::SeqCst);
    }
}

static WATCH: Watch = Watch::new();

struct Watch {
    watcher: OnceLock<Box<dyn Watcher>>,
    /// Whether something is going on that the watcher was told of.
    is_busy: AtomicBool,
}

impl Watch {
    const fn new() -> Self {
        Self { watcher: OnceLock::new(), is_busy: AtomicBool::new(false) }
    }

    fn stage(&self, what: &str, pieces: usize) -> Stage<'_> {
        match self.watcher.get() {
            Some(watcher) if !self.is_busy.swap(true, Ordering::SeqCst) => {
                watcher.begin(what, pieces);
                Stage(Some(self))
            }
            _ => Stage(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    #[derive(Clone, Default)]
    struct Log(Arc<Mutex<Vec<String>>>);

    impl Watcher for Log {
        fn begin(&self, what: &str, pieces: usize) {
            self.0.lock().unwrap().push(format!("{pieces} {what}"));
        }

        fn advance(&self) {
            self.0.lock().unwrap().push("one".to_owned());
        }

        fn end(&self) {
            self.0.lock().unwrap().push("end".to_owned());
        }
    }

    #[test]
    fn what_begins_within_something_else_is_a_part_of_it() {
        let (log, watch) = (Log::default(), Watch::new());
        watch.stage("unheard", 1).advance();
        assert!(watch.watcher.set(Box::new(log.clone())).is_ok());
        let outer = watch.stage("outer", 2);
        watch.stage("inner", 7).advance();
        outer.advance();
        drop(outer);
        drop(watch.stage("next", 0));
        assert_eq!(*log.0.lock().unwrap(), ["2 outer", "one", "end", "0 next", "end"]);
    }
}

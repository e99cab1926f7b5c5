//! Progress on a terminal.

use std::env;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use gl_progress::Watcher;

/// What is over sooner is not worth a line.
const PATIENCE: Duration = Duration::from_millis(500);
const REDRAW: Duration = Duration::from_millis(200);
const CELLS: usize = 24;

/// One line on stderr that says how far the tool has come, and is gone when it has.
pub struct Line {
    tool: String,
    done: Arc<AtomicUsize>,
    /// The thread that draws, and what ends it when it is dropped.
    drawing: Mutex<Option<(Sender<()>, JoinHandle<()>)>>,
}

impl Line {
    /// A line for a tool, if its messages go to a terminal that can take a line back.
    pub fn on_terminal(tool: &str) -> Option<Self> {
        let can_erase = env::var_os("TERM").is_some_and(|name| name != "dumb");
        (can_erase && io::stderr().is_terminal()).then(|| Self {
            tool: tool.to_owned(),
            done: Arc::default(),
            drawing: Mutex::default(),
        })
    }
}

impl Watcher for Line {
    fn begin(&self, what: &str, pieces: usize) {
        self.done.store(0, Ordering::Relaxed);
        let head = format!("{}: {what}", self.tool);
        let (done, (sender, receiver)) = (Arc::clone(&self.done), channel::<()>());
        let start = Instant::now();
        let draw = move || {
            let (mut wait, mut is_drawn) = (PATIENCE, false);
            while receiver.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                write(&state(&head, done.load(Ordering::Relaxed), pieces, start.elapsed()));
                (wait, is_drawn) = (REDRAW, true);
            }
            if is_drawn {
                write("");
            }
        };
        if let Ok(mut drawing) = self.drawing.lock() {
            *drawing = thread::Builder::new().spawn(draw).ok().map(|thread| (sender, thread));
        }
    }

    fn advance(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    fn end(&self) {
        let drawing = self.drawing.lock().ok().and_then(|mut drawing| drawing.take());
        if let Some((sender, thread)) = drawing {
            drop(sender);
            let _ = thread.join();
        }
    }
}

/// Put a text in place of the line.
fn write(text: &str) {
    let mut stderr = io::stderr();
    // A terminal that is gone is no reason to die.
    let _ = write!(stderr, "\r{text}\x1b[K").and_then(|()| stderr.flush());
}

fn state(head: &str, done: usize, pieces: usize, elapsed: Duration) -> String {
    let full = (CELLS * done.min(pieces)).checked_div(pieces).unwrap_or(0);
    let bar = format!("{}{}", "#".repeat(full), ".".repeat(CELLS - full));
    let left = match done {
        0 => String::new(),
        _ => {
            let seconds = elapsed.as_secs_f64() * pieces.saturating_sub(done) as f64 / done as f64;
            format!(", about {} left", duration(seconds))
        }
    };
    format!("{head} {bar} {done} of {pieces}{left}")
}

fn duration(seconds: f64) -> String {
    match seconds.ceil() {
        s if s < 100.0 => format!("{s} s"),
        s if s < 6000.0 => format!("{} min", (s / 60.0).round()),
        s => format!("{:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_is_done_and_how_long_the_rest_takes() {
        assert_eq!(
            state("gl-emulate: training", 5, 20, Duration::from_secs(10)),
            "gl-emulate: training ######.................. 5 of 20, about 30 s left"
        );
        assert_eq!(state("a: b", 0, 0, PATIENCE), format!("a: b {} 0 of 0", ".".repeat(CELLS)));
        assert_eq!([duration(98.2), duration(400.0), duration(7200.0)], ["99 s", "7 min", "2.0 h"]);
    }
}

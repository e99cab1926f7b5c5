//! Progress on a terminal.

use std::env;
use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, RwLock};
use std::thread;
use std::time::Duration;

use gl_progress::Watcher;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

/// What is over sooner is not worth a line.
const PATIENCE: Duration = Duration::from_millis(500);
const REDRAW: Duration = Duration::from_millis(200);

/// One line on stderr that says how far the tool has come, and is gone when it has.
pub struct Line {
    tool: String,
    bar: RwLock<Option<ProgressBar>>,
    /// Dropped when what began has ended.
    begun: Mutex<Option<Sender<()>>>,
}

impl Line {
    /// A line for a tool, if its messages go to a terminal that can take a line back.
    pub fn on_terminal(tool: &str) -> Option<Self> {
        let can_erase = env::var_os("TERM").is_some_and(|name| name != "dumb");
        (can_erase && io::stderr().is_terminal()).then(|| Self {
            tool: tool.to_owned(),
            bar: RwLock::default(),
            begun: Mutex::default(),
        })
    }
}

impl Watcher for Line {
    fn begin(&self, what: &str, pieces: usize) {
        let bar = ProgressBar::with_draw_target(Some(pieces as u64), ProgressDrawTarget::hidden())
            .with_style(style())
            .with_message(format!("{}: {what}", self.tool));
        let (sender, receiver) = channel::<()>();
        let waiting = bar.clone();
        let show = move || {
            if receiver.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                waiting.set_draw_target(ProgressDrawTarget::stderr());
                waiting.enable_steady_tick(REDRAW);
                // It goes when what began ends.
                let _ = receiver.recv();
                waiting.finish_and_clear();
            }
        };
        // Without a thread there is no line, which is no reason to fail.
        let shown = thread::Builder::new().spawn(show);
        if let (Ok(mut begun), Ok(mut slot)) = (self.begun.lock(), self.bar.write()) {
            *begun = shown.is_ok().then_some(sender);
            *slot = Some(bar);
        }
    }

    fn advance(&self) {
        if let Ok(bar) = self.bar.read() {
            bar.iter().for_each(|bar| bar.inc(1));
        }
    }

    fn end(&self) {
        if let Ok(mut begun) = self.begun.lock() {
            drop(begun.take());
        }
        if let Some(bar) = self.bar.write().ok().and_then(|mut bar| bar.take()) {
            bar.finish_and_clear();
        }
    }
}

fn style() -> ProgressStyle {
    let style = ProgressStyle::with_template("{msg} {bar:16} {pos} of {len}{left}");
    style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("#.").with_key(
        "left",
        |state: &ProgressState, text: &mut dyn Write| {
            // A line without it is as good.
            let _ = text.write_str(&left(state.pos(), state.len().unwrap_or(0), state.elapsed()));
        },
    )
}

/// How long the rest takes, by the time of what is done.
fn left(done: u64, pieces: u64, elapsed: Duration) -> String {
    if done == 0 {
        return String::new();
    }
    let seconds = elapsed.as_secs_f64() * pieces.saturating_sub(done) as f64 / done as f64;
    format!(", about {} left", duration(seconds))
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
    fn a_line_says_how_long_the_rest_takes() {
        assert_eq!(left(5, 20, Duration::from_secs(10)), ", about 30 s left");
        assert_eq!(left(0, 20, PATIENCE), "");
        assert_eq!([duration(98.2), duration(400.0), duration(7200.0)], ["99 s", "7 min", "2.0 h"]);
    }
}

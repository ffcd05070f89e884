//! Progress display of long work on stderr: on a terminal a line that is redrawn, otherwise one line every ten seconds.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::print::say_beside;
use isotherm_profile::duration_text;

/// Interval between lines if stderr is not a terminal. The first line is printed after half of this interval.
const SAID_EVERY: Duration = Duration::from_secs(10);
const DRAWN_EVERY: Duration = Duration::from_millis(200);

/// Display of work in progress. It ends when this value is dropped.
pub(super) struct Progress {
    bar: ProgressBar,
    state: Arc<Mutex<String>>,
    /// Sender whose drop ends the display thread.
    works: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Progress {
    /// Starts the display with the name of the first step.
    pub(super) fn begin(what: &str) -> Progress {
        let bar = ProgressBar::new_spinner().with_message(what.to_owned());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style);
        }
        if bar.is_hidden() {
            return Progress::said(bar, what, SAID_EVERY, |line| say_beside!("{line}"));
        }
        bar.enable_steady_tick(DRAWN_EVERY);
        Progress { bar, state: Arc::default(), works: None, thread: None }
    }

    fn said(
        bar: ProgressBar,
        what: &str,
        every: Duration,
        say: impl Fn(String) + Send + 'static,
    ) -> Progress {
        let state = Arc::new(Mutex::new(what.to_owned()));
        let (works, is_over) = channel::<()>();
        let shown = Arc::clone(&state);
        let thread = std::thread::spawn(move || {
            let (mut spent, mut wait) = (Duration::ZERO, every / 2);
            while is_over.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
                spent += wait;
                wait = every;
                let what = shown.lock().unwrap_or_else(PoisonError::into_inner).clone();
                say(format!("{what} ({})", duration_text(spent)));
            }
        });
        Progress { bar, state, works: Some(works), thread: Some(thread) }
    }

    /// Updates the display: `done` of `all` steps are finished.
    pub(super) fn note(&self, what: &str, done: usize, all: usize) {
        let line = format!("{what}: {done} of {all}");
        self.bar.set_message(line.clone());
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = line;
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.works = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_a_line_comes_as_often_as_it_must_and_ends_with_the_work() {
        let (tell, said) = channel();
        let every = Duration::from_millis(10);
        let say = move |line| drop(tell.send(line));
        let progress = Progress::said(ProgressBar::hidden(), "reading", every, say);
        assert_eq!(said.recv().unwrap(), "reading (5ms)");
        progress.note("held out", 1, 5);
        assert!(said.iter().any(|line: String| line.starts_with("held out: 1 of 5 (")));
        drop(progress);
        assert!(said.iter().count() < usize::MAX, "nobody says any more");
    }
}

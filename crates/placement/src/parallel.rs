//! Helper functions for parallel calculations that report their progress.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

use rayon::prelude::*;

use crate::body::Progress;

/// Callback that reports progress from any thread; see [`Progress`].
type ReportProgress<'a> = &'a (dyn Fn(&str, usize, usize) + Sync);

/// Runs `work` on another thread, and calls `progress` on the calling thread, because `progress` cannot be shared
/// between threads.
pub(crate) fn listening<R: Send>(
    progress: Progress<'_>,
    work: impl FnOnce(ReportProgress<'_>) -> R + Send,
) -> R {
    let (says, receives) = mpsc::channel::<(String, usize, usize)>();
    std::thread::scope(|scope| {
        let worker = scope.spawn(move || {
            work(&|what, done, all| {
                let _ = says.send((what.to_owned(), done, all));
            })
        });
        receives.iter().for_each(|(what, done, all)| progress(&what, done, all));
        worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Calls the function `of` for each item in parallel, and returns the results in the order of the items.
pub(crate) fn each<T: Sync, R: Send>(
    what: &str,
    things: &[T],
    progress: Progress<'_>,
    of: impl Fn(&T) -> R + Send + Sync,
) -> Vec<R> {
    let done = AtomicUsize::new(0);
    let all = things.len();
    listening(progress, |says| {
        says(what, 0, all);
        let made = |thing: &T| {
            let made = of(thing);
            says(what, done.fetch_add(1, Ordering::Relaxed) + 1, all);
            made
        };
        things.par_iter().map(made).collect()
    })
}

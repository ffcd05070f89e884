//! Independent pieces of work over the cores.

use std::num::NonZeroUsize;

/// `work` on each item, in their order, one thread per core.
pub(crate) fn map<'a, T: Sync, R: Send>(items: &'a [T], work: impl Fn(&'a T) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(1, NonZeroUsize::get).max(1);
    let work = &work;
    // Every thread takes each so-manieth item: pieces of one call are of about one size.
    let take = |first: usize| items.iter().skip(first).step_by(threads).map(work).collect::<Vec<R>>();
    let take = &take;
    std::thread::scope(|scope| {
        let others: Vec<_> =
            (1..threads.min(items.len())).map(|first| scope.spawn(move || take(first))).collect();
        let mut parts = vec![take(0).into_iter()];
        for other in others {
            match other.join() {
                Ok(done) => parts.push(done.into_iter()),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        (0..items.len()).filter_map(|place| parts[place % threads].next()).collect()
    })
}

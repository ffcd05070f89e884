//! The library panics at some of what a peer may send. That is a fault of this line, and no end of the gateway.

use std::cell::Cell;
use std::future::Future;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::pin::pin;
use std::sync::Once;
use std::task::Poll;

thread_local! {
    /// The library has its turn: what it says of a panic is left out, as all that it says.
    static ITS_TURN: Cell<bool> = const { Cell::new(false) };
}

/// What comes of this work of the library's; `None` where it panicked. What it worked with must not be used again.
pub(super) async fn contained<T>(work: impl Future<Output = T>) -> Option<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let known = take_hook();
        set_hook(Box::new(move |panic| {
            if !ITS_TURN.get() {
                known(panic);
            }
        }));
    });
    let mut work = pin!(work);
    std::future::poll_fn(|context| {
        ITS_TURN.set(true);
        let polled = catch_unwind(AssertUnwindSafe(|| work.as_mut().poll(context)));
        ITS_TURN.set(false);
        match polled {
            Ok(Poll::Pending) => Poll::Pending,
            Ok(Poll::Ready(done)) => Poll::Ready(Some(done)),
            Err(_) => Poll::Ready(None),
        }
    })
    .await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_panics_comes_to_nothing_and_what_does_not_to_what_it_comes_to() {
        assert_eq!(contained(async { 7 }).await, Some(7));
        let fails = async {
            tokio::task::yield_now().await;
            let empty: &[u8] = &[];
            empty[std::hint::black_box(3)]
        };
        assert_eq!(contained(fails).await, None);
    }
}

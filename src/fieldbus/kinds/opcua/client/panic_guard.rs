//! Containment of panics in the OPC UA library. Some input from a peer can cause a panic; the panic is then a fault of
//! this bus line, and must not end the gateway.

use std::future::Future;
use std::pin::pin;
use std::task::Poll;

use isotherm_core::border::{Panicked, beyond};

/// Runs a future of the library, and catches a panic of this future.
///
/// # Errors
/// The future panicked. The data that it used must not be used again.
pub(super) async fn contained<T>(work: impl Future<Output = T>) -> Result<T, Panicked> {
    let mut work = pin!(work);
    std::future::poll_fn(|context| match beyond(|| work.as_mut().poll(context)) {
        Ok(Poll::Pending) => Poll::Pending,
        Ok(Poll::Ready(done)) => Poll::Ready(Ok(done)),
        Err(panicked) => Poll::Ready(Err(panicked)),
    })
    .await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_panics_between_two_waits_is_an_error_and_what_does_not_is_done() {
        assert_eq!(contained(async { 7 }).await, Ok(7));
        let fails = async {
            tokio::task::yield_now().await;
            panic!("a length below zero")
        };
        assert_eq!(contained::<()>(fails).await, Err(Panicked));
    }
}

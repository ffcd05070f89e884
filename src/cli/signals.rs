//! SIGTERM, SIGINT and SIGHUP: the first asks for a graceful stop, the second for an end at once.

use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

/// Listens from the moment it is made.
#[derive(Debug)]
pub(super) struct Signals {
    term: Signal,
    interrupt: Signal,
    hangup: Signal,
}

impl Signals {
    /// Needs a running runtime.
    pub(super) fn listen() -> std::io::Result<Signals> {
        Ok(Signals {
            term: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
            hangup: signal(SignalKind::hangup())?,
        })
    }

    /// Counts them from now on. Nobody has to be waiting when one comes: the second may follow the first at once.
    pub(super) fn count(mut self) -> watch::Receiver<u32> {
        let (counter, count) = watch::channel(0);
        tokio::spawn(async move {
            loop {
                self.next().await;
                counter.send_modify(|count| *count += 1);
            }
        });
        count
    }

    /// The next one.
    pub(super) async fn next(&mut self) {
        tokio::select! {
            _ = self.term.recv() => {}
            _ = self.interrupt.recv() => {}
            _ = self.hangup.recv() => {}
        }
    }
}

//! Signals SIGTERM, SIGINT and SIGHUP. The first one requests an orderly stop, the second one an immediate
//! end. SIGXFSZ (a file has reached its largest size) does not end the program.

use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

/// Listener for SIGTERM, SIGINT and SIGHUP. It also receives signals that arrive between its creation and the first
/// wait.
#[derive(Debug)]
pub(super) struct Signals {
    term: Signal,
    interrupt: Signal,
    hangup: Signal,
}

/// Keeps the process alive when a file reaches the largest size that the process may write (SIGXFSZ). The write fails
/// instead, and its error is reported. Must be called inside a tokio runtime; the effect lasts until the process ends.
pub(super) fn survive_file_size_limit() -> std::io::Result<()> {
    signal(SignalKind::from_raw(libc::SIGXFSZ)).map(drop)
}

impl Signals {
    /// Starts to listen for the signals. Must be called inside a running tokio runtime.
    pub(super) fn listen() -> std::io::Result<Signals> {
        Ok(Signals {
            term: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
            hangup: signal(SignalKind::hangup())?,
        })
    }

    /// Starts a task that counts the signals from now on, and returns the count. Signals in quick succession are
    /// therefore not missed.
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

    /// Waits for the next signal.
    pub(super) async fn next(&mut self) {
        tokio::select! {
            _ = self.term.recv() => {}
            _ = self.interrupt.recv() => {}
            _ = self.hangup.recv() => {}
        }
    }
}

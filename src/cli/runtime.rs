//! Asynchronous runtime (tokio) for the verbs that connect to devices.

/// Creates a runtime on the current thread, with timers and sockets.
pub(super) fn start() -> std::io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_all().build()
}

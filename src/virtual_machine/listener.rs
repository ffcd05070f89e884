//! Listener of virtual devices, which faults close and open again.

use std::io;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;

/// Command to open (`true`) or close a listener or a port, and the channel that reports its execution.
pub(super) type Switch = (bool, oneshot::Sender<()>);

/// Accepts connections and starts `converse` for each, until `stop` changes or its sender is dropped. Closing the
/// listener also ends its connections.
pub(super) async fn serve<S, F>(
    listener: TcpListener,
    mut switched: mpsc::Receiver<S>,
    mut stop: watch::Receiver<bool>,
    converse: impl Fn(TcpStream) -> F + Send + 'static,
) -> io::Result<()>
where
    S: Into<Switch>,
    F: Future<Output = io::Result<()>> + Send + 'static,
{
    let address = listener.local_addr()?;
    let mut listener = Some(listener);
    let mut connections: JoinSet<io::Result<()>> = JoinSet::new();
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some((is_open, done)) = switch.map(Into::<Switch>::into) else { return Ok(()) };
                listener = None;
                if is_open {
                    listener = Some(TcpListener::bind(address).await?);
                } else {
                    connections.shutdown().await;
                }
                let _ = done.send(());
            }
            accepted = accept(listener.as_ref()) => {
                let stream = accepted?;
                // A connection without this option is only slower.
                let _ = stream.set_nodelay(true);
                connections.spawn(converse(stream));
            }
            Some(ended) = connections.join_next() => {
                if let Err(error) = ended && error.is_panic() {
                    return Err(io::Error::other(error));
                }
            }
        }
    }
}

/// Waits for the next connection. Never returns without a listener.
async fn accept(listener: Option<&TcpListener>) -> io::Result<TcpStream> {
    match listener {
        Some(listener) => Ok(listener.accept().await?.0),
        None => std::future::pending().await,
    }
}

//! Listener of virtual devices that send text.

use std::io;
use std::sync::Arc;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::task::JoinSet;

use super::line::{TextLine, converse};

/// Command to open (`true`) or close a listener or a port, and the channel that reports its execution.
pub(in crate::virtual_machine) type Switch = (bool, oneshot::Sender<()>);

/// Serves the devices of a line on a listener, until `stop` changes or its sender is dropped.
pub(in crate::virtual_machine) async fn serve<S: Into<Switch>>(
    listener: TcpListener,
    line: Arc<TextLine>,
    mut switched: mpsc::Receiver<S>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
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
                let line = line.clone();
                let stream = accepted?;
                connections.spawn(async move {
                    stream.set_nodelay(true)?;
                    converse(stream, &line, None).await
                });
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

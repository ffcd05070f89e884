//! TCP listener of virtual devices that send text.

use std::io;
use std::sync::Arc;

use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};

use super::line::{TextLine, converse};
use crate::virtual_machine::listener::{self, Switch};

/// Serves the devices of a line on a listener, until `stop` changes or its sender is dropped.
pub(in crate::virtual_machine) async fn serve<S: Into<Switch>>(
    listener: TcpListener,
    line: Arc<TextLine>,
    switched: mpsc::Receiver<S>,
    stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let converse = move |stream: TcpStream| {
        let line = line.clone();
        async move { converse(stream, &line, None).await }
    };
    listener::serve(listener, switched, stop, converse).await
}

//! Serial port (pseudo-terminal) of virtual devices that send text.

use std::io;
use std::sync::Arc;

use tokio::sync::{mpsc, watch};

use super::line::{TextLine, converse};
use crate::virtual_machine::listener::Switch;
use crate::virtual_machine::pseudo_terminal::{VirtualPort, after};
use isotherm_profile::Serial;

/// Serves the devices of a bus line on a serial port, until `stop` changes or its sender is dropped.
pub(in crate::virtual_machine) async fn serve<S: Into<Switch>>(
    mut port: VirtualPort,
    serial: Serial,
    line: Arc<TextLine>,
    mut switched: mpsc::Receiver<S>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some((is_open, done)) = switch.map(Into::<Switch>::into) else { return Ok(()) };
                port.set_present(is_open)?;
                let _ = done.send(());
            }
            ended = talk(&port, &line, serial) => ended?,
        }
    }
}

/// Sends values to the client that has opened the port, and answers its requests. Never returns while the port is
/// removed.
async fn talk(port: &VirtualPort, line: &TextLine, serial: Serial) -> io::Result<()> {
    loop {
        let stream = port.stream().await?;
        after(converse(stream, line, Some(serial)).await)?;
    }
}

//! Virtual Modbus units on a serial port.

use std::io;
use std::sync::Arc;

use tokio::sync::{mpsc, watch};

use super::pseudo_terminal::{VirtualPort, after};
use super::server::{Line, OpenOrClose, converse};
use isotherm_profile::Serial;

/// Serves the Modbus units of a bus line on a serial port, until `stop` changes or its sender is dropped.
pub(super) async fn serve(
    mut port: VirtualPort,
    serial: Serial,
    line: Arc<Line>,
    mut switched: mpsc::Receiver<OpenOrClose>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some(OpenOrClose { is_open, done }) = switch else { return Ok(()) };
                port.set_present(is_open)?;
                let _ = done.send(());
            }
            ended = talk(&port, &line, serial) => ended?,
        }
    }
}

/// Answers the client that has opened the port. Never returns while the port is removed.
async fn talk(port: &VirtualPort, line: &Line, serial: Serial) -> io::Result<()> {
    loop {
        let stream = port.stream().await?;
        after(converse(stream, line, Some(serial)).await)?;
    }
}

//! Pseudo-terminal of a virtual device that sends text.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rustix::fs::OFlags;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;
use tokio::net::unix::pipe::{Receiver, Sender};
use tokio::sync::{mpsc, watch};

use super::line::{TextLine, converse};
use super::server::Switch;
use isotherm_profile::Serial;

/// Interval at which the virtual machine checks whether a client has opened the port.
const CLIENT_CHECK: Duration = Duration::from_millis(5);

/// End of a pseudo-terminal at which the devices answer.
type Hardware = (Receiver, Sender);

/// Serves the devices of a line on a port with this path, until `stop` changes or its sender is dropped.
pub(in crate::virtual_machine) async fn serve<S: Into<Switch>>(
    path: PathBuf,
    serial: Serial,
    line: Arc<TextLine>,
    mut switched: mpsc::Receiver<S>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let mut port = Some(plug_in(&path)?);
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some((is_open, done)) = switch.map(Into::<Switch>::into) else { return Ok(()) };
                port = if is_open { Some(plug_in(&path)?) } else { None };
                if port.is_none() {
                    let _ = fs::remove_file(&path);
                }
                let _ = done.send(());
            }
            ended = talk(port.as_mut(), &line, serial) => ended?,
        }
    }
}

/// Creates a pseudo-terminal to which the path points.
fn plug_in(path: &Path) -> io::Result<Hardware> {
    let hardware = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    rustix::pty::grantpt(&hardware)?;
    rustix::pty::unlockpt(&hardware)?;
    let mut termios = rustix::termios::tcgetattr(&hardware)?;
    termios.make_raw();
    rustix::termios::tcsetattr(&hardware, OptionalActions::Now, &termios)?;
    let flags = rustix::fs::fcntl_getfl(&hardware)?;
    rustix::fs::fcntl_setfl(&hardware, flags | OFlags::NONBLOCK)?;
    let port = rustix::pty::ptsname(&hardware, Vec::new())?.into_bytes();
    let _ = fs::remove_file(path);
    symlink(OsString::from_vec(port), path)?;
    let other = hardware.try_clone()?;
    Ok((Receiver::from_owned_fd_unchecked(hardware)?, Sender::from_owned_fd_unchecked(other)?))
}

/// Sends to the client that has opened the port. Never returns while the port is removed (`None`).
async fn talk(port: Option<&mut Hardware>, line: &TextLine, serial: Serial) -> io::Result<()> {
    let Some((receiver, sender)) = port else { return std::future::pending().await };
    loop {
        match converse(tokio::io::join(&mut *receiver, &mut *sender), line, Some(serial)).await {
            // No client has the port open.
            Ok(()) => {}
            Err(error) if error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error()) => {}
            Err(error) => return Err(error),
        }
        tokio::time::sleep(CLIENT_CHECK).await;
    }
}

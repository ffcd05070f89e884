//! Virtual serial port: a pseudo-terminal at a fixed path, which a fault script can remove and create again.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rustix::fs::OFlags;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;
use tokio::net::unix::pipe::{Receiver, Sender};
use tokio::sync::{mpsc, watch};

use super::server::{Line, OpenOrClose, converse};
use isotherm_profile::Serial;

/// Interval at which the virtual machine checks whether a client has opened the port.
const LOOK: Duration = Duration::from_millis(5);

/// Path of a serial port. Dropping this value removes the path.
#[derive(Debug)]
pub(super) struct Name {
    path: PathBuf,
    /// Directory that was created only for this port; `None` for a path in the profile.
    directory: Option<PathBuf>,
}

impl Name {
    /// Reserves the path in the profile. Returns `None` if the path exists already, or cannot be created.
    pub(super) fn wanted(path: &Path) -> Option<Name> {
        let is_left_over = path.is_symlink() && !path.exists();
        if is_left_over {
            fs::remove_file(path).ok()?;
        }
        // Tested with a target that does not exist. The port is linked later.
        symlink("/nonexistent", path).ok()?;
        Some(Name { path: path.to_owned(), directory: None })
    }

    /// Creates a unique path in a new directory.
    pub(super) fn free(bus: &str) -> io::Result<Name> {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let directory = std::env::temp_dir().join(format!("isotherm-{}-{count}", std::process::id()));
        fs::create_dir_all(&directory)?;
        Ok(Name { path: directory.join(bus), directory: Some(directory) })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn points_to(&self, port: &Path) -> io::Result<()> {
        self.is_nowhere();
        symlink(port, &self.path)
    }

    fn is_nowhere(&self) {
        let _ = fs::remove_file(&self.path);
    }
}

impl Drop for Name {
    fn drop(&mut self) {
        self.is_nowhere();
        if let Some(directory) = &self.directory {
            let _ = fs::remove_dir(directory);
        }
    }
}

/// Serves the units of a line on a port with this path, until `stop` changes or its sender is dropped.
pub(super) async fn serve(
    name: Name,
    serial: Serial,
    line: Arc<Line>,
    mut switched: mpsc::Receiver<OpenOrClose>,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let mut port = Some(plug_in(&name)?);
    loop {
        tokio::select! {
            _ = stop.changed() => return Ok(()),
            switch = switched.recv() => {
                let Some(OpenOrClose { is_open, done }) = switch else { return Ok(()) };
                if is_open {
                    port = Some(plug_in(&name)?);
                } else {
                    name.is_nowhere();
                    port = None;
                }
                let _ = done.send(());
            }
            ended = talk(port.as_mut(), &line, serial) => ended?,
        }
    }
}

/// Creates a pseudo-terminal to which the path points, and returns the end at which the devices answer.
fn plug_in(name: &Name) -> io::Result<(Receiver, Sender)> {
    let (hardware, path) = pseudo_terminal()?;
    name.points_to(&path)?;
    let other = hardware.try_clone()?;
    Ok((Receiver::from_owned_fd_unchecked(hardware)?, Sender::from_owned_fd_unchecked(other)?))
}

fn pseudo_terminal() -> io::Result<(OwnedFd, PathBuf)> {
    let hardware = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    rustix::pty::grantpt(&hardware)?;
    rustix::pty::unlockpt(&hardware)?;
    let mut termios = rustix::termios::tcgetattr(&hardware)?;
    termios.make_raw();
    rustix::termios::tcsetattr(&hardware, OptionalActions::Now, &termios)?;
    let flags = rustix::fs::fcntl_getfl(&hardware)?;
    rustix::fs::fcntl_setfl(&hardware, flags | OFlags::NONBLOCK)?;
    let path = rustix::pty::ptsname(&hardware, Vec::new())?.into_bytes();
    Ok((hardware, PathBuf::from(std::ffi::OsString::from_vec(path))))
}

/// Answers the client that has opened the port. Never returns while the port is removed (`None`).
async fn talk(port: Option<&mut (Receiver, Sender)>, line: &Line, serial: Serial) -> io::Result<()> {
    let Some((receiver, sender)) = port else { return std::future::pending().await };
    loop {
        match converse(tokio::io::join(&mut *receiver, &mut *sender), line, Some(serial)).await {
            // No client has the port open.
            Ok(()) => {}
            Err(error) if error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error()) => {}
            Err(error) => return Err(error),
        }
        tokio::time::sleep(LOOK).await;
    }
}

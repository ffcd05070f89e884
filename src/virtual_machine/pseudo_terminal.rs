//! Virtual serial port: a pseudo-terminal at a fixed path, which a fault script can remove and create again.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rustix::fs::OFlags;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;
use tokio::io::Join;
use tokio::net::unix::pipe::{Receiver, Sender};

/// Interval at which the virtual machine checks whether a client has opened the port.
const CLIENT_CHECK: Duration = Duration::from_millis(5);

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

/// Serial port: a pseudo-terminal with its path.
#[derive(Debug)]
pub(super) struct VirtualPort {
    name: Name,
    /// End of the pseudo-terminal at which the devices answer. `None` while the port is removed.
    hardware: Option<(Receiver, Sender)>,
}

impl VirtualPort {
    /// Creates the port. A client can open it when this function returns.
    pub(super) fn plug_in(name: Name) -> io::Result<VirtualPort> {
        let mut port = VirtualPort { name, hardware: None };
        port.set_present(true)?;
        Ok(port)
    }

    /// Removes the port, or creates it again.
    pub(super) fn set_present(&mut self, is_present: bool) -> io::Result<()> {
        if !is_present {
            self.name.is_nowhere();
            self.hardware = None;
            return Ok(());
        }
        let (hardware, path) = pseudo_terminal()?;
        self.name.points_to(&path)?;
        let other = hardware.try_clone()?;
        let ends = (Receiver::from_owned_fd_unchecked(hardware)?, Sender::from_owned_fd_unchecked(other)?);
        self.hardware = Some(ends);
        Ok(())
    }

    /// Returns the connection to the client. `None` while the port is removed.
    pub(super) fn stream(&mut self) -> Option<Join<&mut Receiver, &mut Sender>> {
        self.hardware.as_mut().map(|(receiver, sender)| tokio::io::join(receiver, sender))
    }
}

/// Waits before the port is tried again, if no client has it open. Returns any other error.
pub(super) async fn after(ended: io::Result<()>) -> io::Result<()> {
    match ended {
        Err(error) if error.raw_os_error() != Some(rustix::io::Errno::IO.raw_os_error()) => Err(error),
        _ => {
            tokio::time::sleep(CLIENT_CHECK).await;
            Ok(())
        }
    }
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

//! Virtual serial port: a pseudo-terminal at a fixed path, which a fault script can remove and create again.

use std::fs;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
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

    /// Creates a unique path for the port, in a new directory for temporary files.
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
    hardware: Option<OwnedFd>,
}

impl VirtualPort {
    /// Creates the port. A client can open it when this function returns.
    pub(super) fn plug_in(name: Name) -> io::Result<VirtualPort> {
        let mut port = VirtualPort { name, hardware: None };
        port.set_present(true)?;
        Ok(port)
    }

    /// Creates the port if `is_present` is true, otherwise removes it.
    pub(super) fn set_present(&mut self, is_present: bool) -> io::Result<()> {
        if !is_present {
            self.name.is_nowhere();
            self.hardware = None;
            return Ok(());
        }
        let (hardware, path) = pseudo_terminal()?;
        self.name.points_to(&path)?;
        self.hardware = Some(hardware);
        Ok(())
    }

    /// Waits until a client has opened the port, and returns the connection to it. Never returns while the port is
    /// removed.
    ///
    /// Each client has its own registration with the runtime. A registration remembers that a client has closed the
    /// port, and each later read would then end at once without a byte.
    pub(super) async fn stream(&self) -> io::Result<Join<Receiver, Sender>> {
        let Some(hardware) = &self.hardware else { return std::future::pending().await };
        while is_without_client(hardware)? {
            tokio::time::sleep(CLIENT_CHECK).await;
        }
        let receiver = Receiver::from_owned_fd_unchecked(hardware.try_clone()?)?;
        Ok(tokio::io::join(receiver, Sender::from_owned_fd_unchecked(hardware.try_clone()?)?))
    }
}

/// Returns whether no client has opened the port, and no byte of an earlier client is left.
fn is_without_client(hardware: &OwnedFd) -> io::Result<bool> {
    let mut polled = [PollFd::new(hardware, PollFlags::IN)];
    poll(&mut polled, Some(&Timespec::default()))?;
    let found = polled[0].revents();
    Ok(found.contains(PollFlags::HUP) && !found.contains(PollFlags::IN))
}

/// Returns the error with which a connection ended. `Ok` if the client has closed the port.
pub(super) fn after(ended: io::Result<()>) -> io::Result<()> {
    ended.or_else(|error| match error.raw_os_error() {
        Some(code) if code == rustix::io::Errno::IO.raw_os_error() => Ok(()),
        _ => Err(error),
    })
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

#[cfg(test)]
mod tests {
    use std::pin::Pin;

    use tokio::io::{AsyncRead, AsyncReadExt, AsyncWriteExt, ReadBuf};

    use super::*;

    /// A read that waits for a byte takes no processor time, also after an earlier client has closed the port.
    #[tokio::test]
    async fn a_read_that_waits_for_a_later_client_is_not_repeated() {
        let port = VirtualPort::plug_in(Name::free("waits").unwrap()).unwrap();
        for _ in 0..2 {
            let mut client = fs::File::options().read(true).write(true).open(port.name.path()).unwrap();
            let mut stream = port.stream().await.unwrap();
            std::io::Write::write_all(&mut client, b"a").unwrap();
            assert_eq!(stream.read_u8().await.unwrap(), b'a');
            stream.write_u8(b'b').await.unwrap();
            let (mut polls, mut bytes) = (0, [0; 8]);
            let read = std::future::poll_fn(|context| {
                polls += 1;
                Pin::new(&mut stream).poll_read(context, &mut ReadBuf::new(&mut bytes))
            });
            let waited = tokio::time::timeout(Duration::from_millis(50), read).await;
            assert!(waited.is_err() && polls <= 3, "{polls} polls");
            drop(client);
            let ended = stream.read_u8().await.map(|_| ());
            assert!(ended.is_err() && after(ended).is_ok());
            assert!(is_without_client(port.hardware.as_ref().unwrap()).unwrap());
        }
    }
}

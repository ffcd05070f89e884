//! The process at the other end of the command socket.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::sockopt::socket_peercred;
use rustix::process::{PidfdFlags, pidfd_open};

/// It stays the same one when another program takes the place of the one that runs in it.
pub(super) struct Process(OwnedFd);

impl Process {
    /// That of the gateway at this connection. `None` if it cannot be seen from here, as from outside a container.
    pub(super) fn behind(stream: &UnixStream) -> Option<Process> {
        let peer = socket_peercred(stream).ok()?;
        pidfd_open(peer.pid, PidfdFlags::empty()).ok().map(Process)
    }

    pub(super) fn has_ended(&self) -> bool {
        let mut looked = [PollFd::new(&self.0, PollFlags::IN)];
        poll(&mut looked, Some(&Timespec::default())).is_ok_and(|ended| ended > 0)
    }
}

//! Process at the other end of the command socket.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::net::sockopt::socket_peercred;
use rustix::process::{PidfdFlags, pidfd_open};

/// Handle of a gateway process. When `exec` starts another program in the process, the handle remains valid.
pub(super) struct Process(OwnedFd);

impl Process {
    /// Returns the process at the other end of the connection. `None` if the process is not visible, for example from
    /// outside a container.
    pub(super) fn behind(stream: &UnixStream) -> Option<Process> {
        let peer = socket_peercred(stream).ok()?;
        pidfd_open(peer.pid, PidfdFlags::empty()).ok().map(Process)
    }

    /// Returns whether the process has ended.
    pub(super) fn has_ended(&self) -> bool {
        let mut looked = [PollFd::new(&self.0, PollFlags::IN)];
        poll(&mut looked, Some(&Timespec::default())).is_ok_and(|ended| ended > 0)
    }
}

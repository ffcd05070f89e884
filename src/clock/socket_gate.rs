//! Sockets whose messages get no reply. Virtual time waits until a task has read these messages.
//!
//! The sender of such a message may go to sleep at once. The message is then in the receive queue of the kernel, and no
//! task of the program knows of it. Without this module, the clock would advance before the message is read. The clock
//! therefore checks that queue before it advances.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::simulated::Simulated;
use super::{Clock, Source};

/// Registration of a receiving socket with a virtual clock. With a wall clock it has no effect.
///
/// ```text
/// loop { wait until readable; let taking = gate.taking(); read until there is no more, act; drop(taking) }
/// ```
#[derive(Debug)]
pub struct SocketGate(Option<(Arc<Simulated>, u64)>);

/// Value for a task that reads from the socket: virtual time does not advance until this value is dropped. Create it
/// before the first read of a message. Drop it after all work that results from the last message, including wakeups.
#[derive(Debug)]
pub struct ReadGuard<'a>(&'a SocketGate);

impl Clock {
    /// Registers a socket with the clock. Keep the result as long as a task reads from the socket. A virtual clock does
    /// not advance while the socket has an unread message.
    ///
    /// # Errors
    /// The process cannot open another file descriptor.
    pub fn gate(&self, socket: &impl AsFd) -> io::Result<SocketGate> {
        let Source::Simulated(clock) = &self.source else { return Ok(SocketGate(None)) };
        let from = socket.as_fd().try_clone_to_owned()?;
        Ok(SocketGate(Some((clock.clone(), clock.watch(from)))))
    }
}

impl SocketGate {
    /// Stops virtual time until the returned value is dropped. Call it before reading from the socket.
    pub fn taking(&self) -> ReadGuard<'_> {
        self.tell(true);
        ReadGuard(self)
    }

    fn tell(&self, is_taken: bool) {
        if let Some((clock, number)) = &self.0 {
            clock.take_from(*number, is_taken);
        }
    }
}

impl Drop for ReadGuard<'_> {
    fn drop(&mut self) {
        self.0.tell(false);
    }
}

impl Drop for SocketGate {
    fn drop(&mut self) {
        if let Some((clock, number)) = &self.0 {
            clock.forget(*number);
        }
    }
}

/// Returns whether the socket has data or an error to read. Returns `false` if the kernel does not report its state.
pub(super) fn has_come(socket: &OwnedFd) -> bool {
    let mut polled = [PollFd::new(socket, PollFlags::IN)];
    poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok_and(|ready| ready > 0)
}

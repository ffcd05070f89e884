//! What comes through the kernel and is answered by nobody: virtual time waits until it has been taken.
//!
//! Whoever sends such a message and goes to sleep would else be overtaken by the clock: nothing of ours knows of the
//! message while it lies in the reader's queue. So the clock looks there before it moves.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::simulated::Simulated;
use super::{Clock, Source};

/// The reader's end of a socket, watched by a virtual clock; on the wall's time, nothing.
///
/// ```text
/// loop { wait until readable; let taking = inlet.taking(); read until there is no more, act; drop(taking) }
/// ```
#[derive(Debug)]
pub struct Inlet(Option<(Arc<Simulated>, u64)>);

/// The reader is at it: virtual time stands until this is dropped. To be held from before the first read of a message
/// until all that follows from the last one has been done, wakeups included.
#[derive(Debug)]
pub struct Taking<'a>(&'a Inlet);

impl Clock {
    /// Watches what comes through a socket. Keep it as long as somebody reads there: a virtual clock stands still for
    /// ever before a message that nobody takes.
    ///
    /// # Errors
    /// The process has no descriptor left.
    pub fn inlet(&self, socket: &impl AsFd) -> io::Result<Inlet> {
        let Source::Simulated(clock) = &self.source else { return Ok(Inlet(None)) };
        let from = socket.as_fd().try_clone_to_owned()?;
        Ok(Inlet(Some((clock.clone(), clock.watch(from)))))
    }
}

impl Inlet {
    /// From now on time stands, until what is given is dropped.
    pub fn taking(&self) -> Taking<'_> {
        self.tell(true);
        Taking(self)
    }

    fn tell(&self, is_taken: bool) {
        if let Some((clock, number)) = &self.0 {
            clock.take_from(*number, is_taken);
        }
    }
}

impl Drop for Taking<'_> {
    fn drop(&mut self) {
        self.0.tell(false);
    }
}

impl Drop for Inlet {
    fn drop(&mut self) {
        if let Some((clock, number)) = &self.0 {
            clock.forget(*number);
        }
    }
}

/// Whether there is something to be read, be it an error. Where the kernel cannot say, there is not.
pub(super) fn has_come(socket: &OwnedFd) -> bool {
    let mut polled = [PollFd::new(socket, PollFlags::IN)];
    poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok_and(|ready| ready > 0)
}

//! Frames through a raw socket of the kernel.
//!
//! Four traps, each measured on a real kernel:
//!
//! - A read that waits for frames never learns that the interface went down: the socket's error is waited for as well.
//! - Going down leaves one error behind that the next call gets, even after the interface is up again: a write tries twice.
//! - A full queue says so at once (`ENOBUFS`) and never that there is room again: the write pauses and is repeated.
//! - The receive buffer holds 278 frames, and what comes then is lost without a word: it is made larger, and losses are
//!   counted.
//!
//! A socket hears its own frames only where it is told to ([`Socket::hears_itself`]). Where the interface was deleted it is of no use any more, also when there is one
//! of that name again: open another.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::{AtomicU64, Ordering};

use socketcan::{
    CanAddr, CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanFilter, EmbeddedFrame,
    Frame as _, Socket as _, SocketOptions,
};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

use super::trouble::Trouble;
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use isotherm_core::codec::{CanId, CanMatch, Frame};

/// Bytes of the receive buffer, which the kernel doubles: 10 923 frames by Linux 6.1, 9363 by 6.12, more than half a second
/// of the fullest bus.
const BUFFER: libc::c_int = 4 << 20;
/// Filters that the kernel takes.
const MOST_FILTERS: usize = 512;
/// Frames, and the error that tells that the interface went down.
const READING: Interest = Interest::READABLE.add(Interest::ERROR);
/// Arbitration is lost all the time on a bus that is well.
const TROUBLES: u32 = libc::CAN_ERR_MASK & !libc::CAN_ERR_LOSTARB;

/// What came.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// A frame with data.
    Frame(Frame),
    /// The controller says that something is wrong on the bus.
    Trouble(Trouble),
}

/// An open socket on one interface.
#[derive(Debug)]
pub struct Socket {
    fd: AsyncFd<CanFdSocket>,
    full: AtomicU64,
}

impl Socket {
    /// On the interface of this name, which may be down; only frames that are wanted are let through by the
    /// kernel, and error frames.
    ///
    /// # Errors
    /// No such interface, one that is not CAN, a kernel without CAN.
    pub fn open(interface: &str, wanted: &[CanMatch]) -> Result<Socket, Fault> {
        let address = CanAddr::from_iface(interface).map_err(|_| fault(CanFault::NoInterface))?;
        let socket = CanFdSocket::open_addr(&address).map_err(|error| match error.raw_os_error() {
            Some(libc::ENODEV) => fault(CanFault::NotCan),
            Some(libc::EAFNOSUPPORT | libc::EPROTONOSUPPORT) => fault(CanFault::NoKernel),
            Some(libc::EPERM | libc::EACCES) => fault(CanFault::Forbidden),
            _ => fault(CanFault::NoInterface),
        })?;
        let fd = set(&socket, wanted).and_then(|()| watched(socket)).map_err(|error| judge(&error))?;
        Ok(Socket { fd, full: AtomicU64::new(0) })
    }

    /// Hears its own frames too, where they are wanted: each in its place among the others, once it has gone out.
    ///
    /// # Errors
    /// The kernel refuses it.
    pub fn hears_itself(self) -> Result<Socket, Fault> {
        self.fd.get_ref().set_recv_own_msgs(true).map_err(|error| judge(&error))?;
        Ok(self)
    }

    /// Until something has come since this was last asked. Whoever waits so calls [`Socket::hear_now`] until there is
    /// nothing more, else what is left is waited for in vain.
    pub async fn ready(&self) {
        // Where the runtime ends, so does whoever waits.
        if let Ok(mut guard) = self.fd.ready(READING).await {
            // Before the reads, not after them: what comes between the two is told anew.
            guard.clear_ready();
        }
    }

    /// The next frame, if it has come.
    ///
    /// # Errors
    /// Down, once for each time the interface goes down: the socket hears again as soon as it is up. Gone: open another.
    pub fn hear_now(&self) -> Result<Option<Heard>, Fault> {
        loop {
            match self.fd.get_ref().read_frame() {
                Ok(frame) => {
                    if let Some(heard) = taken(frame) {
                        return Ok(Some(heard));
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(error) => return Err(judge(&error)),
            }
        }
    }

    /// Puts a frame into the interface's queue, where it has room now.
    ///
    /// # Errors
    /// Down, gone, full, a frame of more than 8 bytes on an interface without CAN FD.
    pub fn send_now(&self, frame: &Frame) -> Result<(), Fault> {
        self.write(&packed(frame).ok_or(fault(CanFault::TooLong))?)
    }

    /// As [`Socket::send_now`], an error frame of this class, as a controller gives to its own computer: on a virtual
    /// interface the others hear it.
    ///
    /// # Errors
    /// As [`Socket::send_now`].
    pub fn send_error_now(&self, class: u32, data: &[u8; 8]) -> Result<(), Fault> {
        let frame = CanErrorFrame::new_error(class, data).map_err(|_| fault(CanFault::TooLong))?;
        self.write(&CanAnyFrame::Error(frame))
    }

    fn write(&self, packed: &CanAnyFrame) -> Result<(), Fault> {
        let socket = self.fd.get_ref();
        let written = match socket.write_frame(packed) {
            // What was left behind by the last time it was down.
            Err(error) if error.raw_os_error() == Some(libc::ENETDOWN) => socket.write_frame(packed),
            written => written,
        };
        written.map_err(|error| {
            let fault = judge(&error);
            if fault == Fault::Link(LinkFault::Can(CanFault::Full)) {
                self.full.fetch_add(1, Ordering::Relaxed);
            }
            fault
        })
    }

    /// How often a frame found the queue full, since it was opened.
    pub fn full(&self) -> u64 {
        self.full.load(Ordering::Relaxed)
    }

    /// Frames that were lost because they were not taken fast enough, since it was opened; 0 where the kernel does not say.
    pub fn lost(&self) -> u64 {
        // Nine numbers, the last of them the losses (linux/sock_diag.h).
        let mut numbers = [0; 36];
        let socket = self.fd.get_ref();
        match socket.get_socket_option_bytes(libc::SOL_SOCKET, libc::SO_MEMINFO, &mut numbers) {
            Ok(36) => u64::from(u32::from_ne_bytes([numbers[32], numbers[33], numbers[34], numbers[35]])),
            _ => 0,
        }
    }
}

impl AsFd for Socket {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.get_ref().as_fd()
    }
}

const fn fault(fault: CanFault) -> Fault {
    Fault::Link(LinkFault::Can(fault))
}

#[allow(
    deprecated,
    reason = "what replaces it is unsafe for types that change their descriptor; this one owns its only one"
)]
fn watched(socket: CanFdSocket) -> io::Result<AsyncFd<CanFdSocket>> {
    let interest = Interest::READABLE | Interest::WRITABLE | Interest::ERROR;
    AsyncFd::try_with_interest(socket, interest).map_err(io::Error::from)
}

fn set(socket: &CanFdSocket, wanted: &[CanMatch]) -> io::Result<()> {
    socket.set_nonblocking(true)?;
    if wanted.is_empty() {
        socket.set_filter_drop_all()?;
    } else if wanted.len() <= MOST_FILTERS {
        socket.set_filters(&wanted.iter().map(filter).collect::<Vec<_>>())?;
    }
    socket.set_error_filter(TROUBLES)?;
    // Beyond the system's limit where we may, else up to it.
    socket
        .set_socket_option_int(libc::SOL_SOCKET, libc::SO_RCVBUFFORCE, BUFFER)
        .or_else(|_| socket.set_socket_option_int(libc::SOL_SOCKET, libc::SO_RCVBUF, BUFFER))
}

/// The same number with the other length is another identifier, and a frame that asks for data has none.
fn filter(wanted: &CanMatch) -> CanFilter {
    let length = if wanted.id.is_extended() { libc::CAN_EFF_FLAG } else { 0 };
    CanFilter::new(wanted.id.raw() | length, wanted.mask | libc::CAN_EFF_FLAG | libc::CAN_RTR_FLAG)
}

fn taken(frame: CanAnyFrame) -> Option<Heard> {
    let is_fd = matches!(frame, CanAnyFrame::Fd(_));
    match frame {
        CanAnyFrame::Error(error) => Some(Heard::Trouble(Trouble::of(error))),
        CanAnyFrame::Remote(_) => None,
        CanAnyFrame::Normal(_) | CanAnyFrame::Fd(_) => {
            let raw = frame.raw_id();
            let id = if frame.is_extended() { CanId::extended(raw) } else { CanId::standard(raw) }?;
            let frame = if is_fd { Frame::fd(id, frame.data()) } else { Frame::classic(id, frame.data()) };
            frame.map(Heard::Frame)
        }
    }
}

fn packed(frame: &Frame) -> Option<CanAnyFrame> {
    let (id, data) = (frame.id(), frame.data());
    let id = if id.is_extended() {
        socketcan::Id::Extended(socketcan::ExtendedId::new(id.raw())?)
    } else {
        socketcan::Id::Standard(socketcan::StandardId::new(u16::try_from(id.raw()).ok()?)?)
    };
    if frame.is_fd() {
        return Some(CanAnyFrame::Fd(CanFdFrame::new(id, data)?));
    }
    Some(CanAnyFrame::Normal(CanDataFrame::new(id, data)?))
}

fn judge(error: &io::Error) -> Fault {
    fault(match error.raw_os_error() {
        Some(libc::ENETDOWN) => CanFault::Down,
        Some(libc::ENOBUFS) => CanFault::Full,
        // The socket's own buffer.
        _ if error.kind() == io::ErrorKind::WouldBlock => CanFault::Full,
        // A frame that the interface cannot carry.
        Some(libc::EINVAL | libc::EMSGSIZE) => CanFault::TooLong,
        Some(libc::EPERM | libc::EACCES) => CanFault::Forbidden,
        _ => CanFault::NoInterface,
    })
}

//! Raw CAN sockets of the kernel.
//!
//! Four properties of the kernel, confirmed by measurements:
//!
//! - A read that waits for frames does not report that the interface went down. [`Socket::ready`] therefore also waits
//!   for the error state of the socket.
//! - After the interface went down, the next call on the socket returns one old error, even if the interface is up
//!   again. A write is therefore tried twice.
//! - The kernel reports a full send queue at once (`ENOBUFS`), but does not report when the queue has room again. The
//!   caller pauses and tries again.
//! - The default receive buffer holds 278 frames. The kernel drops later frames without an error. The socket therefore
//!   enlarges the buffer, and counts the dropped frames.
//!
//! A socket receives its own frames only after a call of [`Socket::receives_own_frames`]. A socket whose interface was
//! removed is unusable, even if a new interface has the same name. The caller must open another socket.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::atomic::{AtomicU64, Ordering};

use socketcan::{
    CanAddr, CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanFilter, EmbeddedFrame,
    Frame as _, Socket as _, SocketOptions,
};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

use super::error_frame::ErrorFrame;
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use isotherm_core::codec::{CanId, CanMatch, Frame};

/// Size of the receive buffer in bytes, which the kernel doubles. It holds 10 923 frames on Linux 6.1 and 9363 on 6.12:
/// more than half a second of traffic at full load.
const BUFFER: libc::c_int = 4 << 20;
/// Maximum number of filters that the kernel accepts for one socket. If more frames are wanted than filters are
/// possible, no filter is set, and the socket receives all frames.
const MOST_FILTERS: usize = 512;
/// Events for which the socket waits before a read: frames have arrived, or the interface went down.
const READING: Interest = Interest::READABLE.add(Interest::ERROR);
/// Classes of error frames to receive: all except lost arbitration, which is normal on a healthy bus.
const TROUBLES: u32 = libc::CAN_ERR_MASK & !libc::CAN_ERR_LOSTARB;

/// Frame that a socket has received.
#[derive(Clone, Debug, PartialEq)]
pub enum ReceivedFrame {
    /// A frame with data.
    Frame(Frame),
    /// Error frame: the controller reports a problem on the bus.
    Error(ErrorFrame),
}

/// Open socket that sends and receives the frames of one CAN interface.
#[derive(Debug)]
pub struct Socket {
    fd: AsyncFd<CanFdSocket>,
    full: AtomicU64,
}

impl Socket {
    /// Opens a socket on the interface of this name, which may be down. The socket receives error frames, and the
    /// frames that match `wanted`.
    ///
    /// # Errors
    /// The interface does not exist or is not a CAN interface, the kernel does not support CAN, or access is denied.
    pub fn open(interface: &str, wanted: &[CanMatch]) -> Result<Socket, Fault> {
        let address = CanAddr::from_iface(interface).map_err(|_| fault(CanFault::NoInterface))?;
        let socket = CanFdSocket::open_addr(&address).map_err(|error| match error.raw_os_error() {
            Some(libc::ENODEV) => fault(CanFault::NotCan),
            Some(libc::EAFNOSUPPORT | libc::EPROTONOSUPPORT) => fault(CanFault::NoKernel),
            Some(libc::EPERM | libc::EACCES) => fault(CanFault::Forbidden),
            _ => fault(CanFault::NoInterface),
        })?;
        let fd = set(&socket, wanted).and_then(|()| watched(socket)).map_err(|error| assess(&error))?;
        Ok(Socket { fd, full: AtomicU64::new(0) })
    }

    /// Makes the socket also receive its own frames that match `wanted`. Each frame arrives after it was sent on the
    /// bus, in the order of the bus.
    ///
    /// # Errors
    /// The kernel refuses the option.
    pub fn receives_own_frames(self) -> Result<Socket, Fault> {
        self.fd.get_ref().set_recv_own_msgs(true).map_err(|error| assess(&error))?;
        Ok(self)
    }

    /// Waits until a frame or an error has arrived since the last call. The caller must then call
    /// [`Socket::receive_now`] until it returns `None`. Otherwise no later call reports the remaining frames.
    pub async fn ready(&self) {
        // An error means that the runtime ends, and the caller with it.
        if let Ok(mut guard) = self.fd.ready(READING).await {
            // Clear before the reads, not after them: a frame that arrives in between is then reported again.
            guard.clear_ready();
        }
    }

    /// Returns the next frame; `None` if no frame has arrived.
    ///
    /// # Errors
    /// [`CanFault::Down`]: returned once for each time that the interface goes down; the socket receives again when the
    /// interface is up. [`CanFault::NoInterface`]: the interface was removed, and the caller must open another socket.
    pub fn receive_now(&self) -> Result<Option<ReceivedFrame>, Fault> {
        loop {
            match self.fd.get_ref().read_frame() {
                Ok(frame) => {
                    if let Some(received) = taken(frame) {
                        return Ok(Some(received));
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(error) => return Err(assess(&error)),
            }
        }
    }

    /// Puts a frame into the send queue of the interface, if the queue has room now.
    ///
    /// # Errors
    /// The interface is down or gone, the queue is full, or the frame has more than 8 bytes without CAN FD.
    pub fn send_now(&self, frame: &Frame) -> Result<(), Fault> {
        self.write(&packed(frame).ok_or(fault(CanFault::TooLong))?)
    }

    /// Sends an error frame of this class, as a CAN controller would report it to its own computer. Tests use
    /// this on a virtual interface: the other sockets of the interface receive the error frame.
    ///
    /// # Errors
    /// Same as for [`Socket::send_now`].
    pub fn send_error_now(&self, class: u32, data: &[u8; 8]) -> Result<(), Fault> {
        let frame = CanErrorFrame::new_error(class, data).map_err(|_| fault(CanFault::TooLong))?;
        self.write(&CanAnyFrame::Error(frame))
    }

    fn write(&self, packed: &CanAnyFrame) -> Result<(), Fault> {
        let socket = self.fd.get_ref();
        let written = match socket.write_frame(packed) {
            // An old error from the last time that the interface was down.
            Err(error) if error.raw_os_error() == Some(libc::ENETDOWN) => socket.write_frame(packed),
            written => written,
        };
        written.map_err(|error| {
            let fault = assess(&error);
            if fault == Fault::Link(LinkFault::Can(CanFault::Full)) {
                self.full.fetch_add(1, Ordering::Relaxed);
            }
            fault
        })
    }

    /// Returns the number of frames that could not be sent since the socket was opened, because the send
    /// queue was full.
    pub fn full(&self) -> u64 {
        self.full.load(Ordering::Relaxed)
    }

    /// Returns the number of received frames that the kernel dropped since the socket was opened, because they were not
    /// read fast enough. Returns 0 if the kernel does not count them.
    pub fn lost(&self) -> u64 {
        // The kernel returns nine numbers; the last one counts losses (linux/sock_diag.h).
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
    reason = "its replacement is an unsafe function; this function is correct for a type that keeps its file descriptor"
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
    // Exceed the system's limit if permitted, else use up to the limit.
    socket
        .set_socket_option_int(libc::SOL_SOCKET, libc::SO_RCVBUFFORCE, BUFFER)
        .or_else(|_| socket.set_socket_option_int(libc::SOL_SOCKET, libc::SO_RCVBUF, BUFFER))
}

/// Returns the kernel filter that accepts the frames of one match. The filter rejects frames with the other identifier
/// length (11 or 29 bits). It also rejects remote frames, because they carry no data.
fn filter(wanted: &CanMatch) -> CanFilter {
    let length = if wanted.id.is_extended() { libc::CAN_EFF_FLAG } else { 0 };
    CanFilter::new(wanted.id.raw() | length, wanted.mask | libc::CAN_EFF_FLAG | libc::CAN_RTR_FLAG)
}

fn taken(frame: CanAnyFrame) -> Option<ReceivedFrame> {
    let is_fd = matches!(frame, CanAnyFrame::Fd(_));
    match frame {
        CanAnyFrame::Error(error) => Some(ReceivedFrame::Error(ErrorFrame::of(error))),
        CanAnyFrame::Remote(_) => None,
        CanAnyFrame::Normal(_) | CanAnyFrame::Fd(_) => {
            let raw = frame.raw_id();
            let id = if frame.is_extended() { CanId::extended(raw) } else { CanId::standard(raw) }?;
            let frame = if is_fd { Frame::fd(id, frame.data()) } else { Frame::classic(id, frame.data()) };
            frame.map(ReceivedFrame::Frame)
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

fn assess(error: &io::Error) -> Fault {
    fault(match error.raw_os_error() {
        Some(libc::ENETDOWN) => CanFault::Down,
        Some(libc::ENOBUFS) => CanFault::Full,
        // The send buffer of the socket is full.
        _ if error.kind() == io::ErrorKind::WouldBlock => CanFault::Full,
        // The interface cannot carry this frame.
        Some(libc::EINVAL | libc::EMSGSIZE) => CanFault::TooLong,
        Some(libc::EPERM | libc::EACCES) => CanFault::Forbidden,
        _ => CanFault::NoInterface,
    })
}

//! Serial ports of this computer, straight from the system: no library between them and us, and none to install.
//!
//! A port is opened by its path each time, so that an adapter which was unplugged and comes back under the same name
//! below /dev/serial/by-id is found again. It is ours alone while it is open. Its [`PortIdentity`] distinguishes it from another port
//! under that name.

use std::fs::File;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};

use rustix::fs::{FlockOperation, Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{ControlModes, InputModes, OptionalActions, QueueSelector, SpecialCodeIndex};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::unix::pipe::{Receiver, Sender};

use super::error::LinkFault;
use super::port::Port;
use isotherm_profile::{Parity, Serial};

mod identity;

pub(crate) use identity::PortHistory;
pub use identity::{PortIdentity, device_number};

/// An open serial port, eight data bits, nothing interpreted.
#[derive(Debug)]
pub struct SerialPort {
    reader: Receiver,
    writer: Sender,
    identity: PortIdentity,
}

impl SerialPort {
    /// Opens the port, takes it for itself, sets it up and discards what waits there. Within a tokio runtime.
    ///
    /// # Errors
    /// Why it cannot be had.
    pub fn open(path: &str, settings: Serial) -> Result<SerialPort, LinkFault> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = File::from(rustix::fs::open(path, flags, Mode::empty()).map_err(why_not)?);
        // The first keeps out every program, but not root's; the second whoever asks, as we do.
        rustix::termios::ioctl_tiocexcl(&port).map_err(why_not)?;
        rustix::fs::flock(&port, FlockOperation::NonBlockingLockExclusive).map_err(why_not)?;
        set_up(&port, settings).map_err(why_not)?;
        rustix::termios::tcflush(&port, QueueSelector::IOFlush).map_err(why_not)?;
        let runtime = |_: io::Error| LinkFault::Unsuited;
        // To the runtime a port is like a pipe with two ends.
        let other = port.try_clone().map_err(runtime)?;
        let identity = PortIdentity::of(&port).ok_or(LinkFault::Unsuited)?;
        Ok(SerialPort {
            reader: Receiver::from_file_unchecked(port).map_err(runtime)?,
            writer: Sender::from_file_unchecked(other).map_err(runtime)?,
            identity,
        })
    }

    /// Identity of the port, by which another one under the same name is recognised.
    pub fn identity(&self) -> PortIdentity {
        self.identity
    }
}

impl Drop for SerialPort {
    /// A pseudo-terminal would stay taken while its other end is open; and a port that is closed still sends what it has.
    fn drop(&mut self) {
        self.discard_unsent();
        let _ = rustix::termios::ioctl_tiocnxcl(&self.reader);
    }
}

fn why_not(error: Errno) -> LinkFault {
    match error {
        Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::IO => LinkFault::Absent,
        Errno::ACCESS | Errno::PERM => LinkFault::Forbidden,
        Errno::BUSY | Errno::WOULDBLOCK => LinkFault::Busy,
        _ => LinkFault::Unsuited,
    }
}

fn set_up(port: &File, settings: Serial) -> rustix::io::Result<()> {
    let mut termios = rustix::termios::tcgetattr(port)?;
    termios.make_raw();
    // Hanging up on close drops a line that resets some converters and boards.
    termios.control_modes -= ControlModes::CSIZE
        | ControlModes::PARENB
        | ControlModes::PARODD
        | ControlModes::CSTOPB
        | ControlModes::CRTSCTS
        | ControlModes::HUPCL;
    termios.control_modes |= ControlModes::CS8 | ControlModes::CLOCAL | ControlModes::CREAD;
    termios.control_modes |= match settings.parity {
        Parity::None => ControlModes::empty(),
        Parity::Even => ControlModes::PARENB,
        Parity::Odd => ControlModes::PARENB | ControlModes::PARODD,
    };
    if settings.stop_bits == 2 {
        termios.control_modes |= ControlModes::CSTOPB;
    }
    // A character with a wrong parity bit is left out, so that its frame has a wrong checksum and length.
    if settings.parity != Parity::None {
        termios.input_modes |= InputModes::INPCK | InputModes::IGNPAR;
    }
    termios.special_codes[SpecialCodeIndex::VMIN] = 1;
    termios.special_codes[SpecialCodeIndex::VTIME] = 0;
    termios.set_speed(settings.baud)?;
    rustix::termios::tcsetattr(port, OptionalActions::Now, &termios)?;
    // The call succeeds where only part of it could be done. (A driver may round the speed a little.)
    let now = rustix::termios::tcgetattr(port)?;
    let is_near = now.output_speed().abs_diff(settings.baud) <= settings.baud / 50;
    if is_near { Ok(()) } else { Err(Errno::INVAL) }
}

impl Port for SerialPort {
    fn take_waiting(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        Ok(rustix::io::read(&self.reader, bytes)?)
    }

    fn discard_unsent(&mut self) {
        let _ = rustix::termios::tcflush(&self.writer, QueueSelector::OFlush);
    }
}

impl AsyncRead for SerialPort {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.reader).poll_read(context, buffer)
    }
}

impl AsyncWrite for SerialPort {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.writer).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.writer).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.writer).poll_shutdown(context)
    }
}

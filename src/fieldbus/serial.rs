//! Serial ports of this computer. The module uses system calls directly, without a library for serial ports.
//!
//! A port is opened by its path each time. An adapter that was unplugged is found again under the same name below
//! /dev/serial/by-id. The port is locked while it is open. The [`PortIdentity`] of a port distinguishes it from another
//! port that has got the same name.

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
pub use identity::PortIdentity;
pub(in crate::fieldbus) use identity::place;

/// Open serial port: all bytes are passed unchanged.
#[derive(Debug)]
pub struct SerialPort {
    reader: Receiver,
    writer: Sender,
    identity: PortIdentity,
}

/// Kind of data on a port: frames with a checksum, or text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    /// Frames with a checksum: eight data bits. A character with a wrong parity bit is discarded, so that its frame has
    /// a wrong checksum and length.
    Frames,
    /// Text with this number of data bits. A character with a wrong parity or stop bit is passed as zero, because a
    /// number without one of its digits would be another number.
    Text { data_bits: u8 },
}

impl SerialPort {
    /// Opens, locks and configures the port, and discards its waiting input. Must be called inside a tokio runtime.
    ///
    /// # Errors
    /// The reason why the port cannot be opened.
    pub fn open(path: &str, settings: Serial) -> Result<SerialPort, LinkFault> {
        SerialPort::open_for(path, settings, Content::Frames)
    }

    /// Opens a port for text with 7 or 8 data bits, otherwise as [`SerialPort::open`]. A character with a wrong parity
    /// or stop bit is passed as zero.
    ///
    /// # Errors
    /// The reason why the port cannot be opened.
    pub fn open_for_text(path: &str, settings: Serial, data_bits: u8) -> Result<SerialPort, LinkFault> {
        SerialPort::open_for(path, settings, Content::Text { data_bits })
    }

    fn open_for(path: &str, settings: Serial, content: Content) -> Result<SerialPort, LinkFault> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = File::from(rustix::fs::open(path, flags, Mode::empty()).map_err(why_not)?);
        // The first lock excludes every program except those of root. The second excludes programs that check it, as
        // this does.
        rustix::termios::ioctl_tiocexcl(&port).map_err(why_not)?;
        rustix::fs::flock(&port, FlockOperation::NonBlockingLockExclusive).map_err(why_not)?;
        set_up(&port, settings, content).map_err(why_not)?;
        rustix::termios::tcflush(&port, QueueSelector::IOFlush).map_err(why_not)?;
        let runtime = |_: io::Error| LinkFault::Unsuited;
        // For the runtime, a port is like a pipe with two ends.
        let other = port.try_clone().map_err(runtime)?;
        let identity = PortIdentity::of(&port).ok_or(LinkFault::Unsuited)?;
        Ok(SerialPort {
            reader: Receiver::from_file_unchecked(port).map_err(runtime)?,
            writer: Sender::from_file_unchecked(other).map_err(runtime)?,
            identity,
        })
    }

    /// Returns the identity of the port, which distinguishes it from another port under the same name.
    pub fn identity(&self) -> PortIdentity {
        self.identity
    }
}

impl Drop for SerialPort {
    /// Discards unsent bytes, which the system would still send after the close, and unlocks the port. The lock of a
    /// pseudo-terminal would otherwise last while its other end is open.
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
        Errno::MFILE | Errno::NFILE => LinkFault::NoDescriptors,
        _ => LinkFault::Unsuited,
    }
}

fn set_up(port: &File, settings: Serial, content: Content) -> rustix::io::Result<()> {
    let mut termios = rustix::termios::tcgetattr(port)?;
    termios.make_raw();
    // A hang-up on close would change a control line that resets some converters and boards.
    termios.control_modes -= ControlModes::CSIZE
        | ControlModes::PARENB
        | ControlModes::PARODD
        | ControlModes::CSTOPB
        | ControlModes::CRTSCTS
        | ControlModes::HUPCL;
    termios.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
    termios.control_modes |= match content {
        Content::Text { data_bits: 7 } => ControlModes::CS7,
        Content::Frames | Content::Text { .. } => ControlModes::CS8,
    };
    termios.control_modes |= match settings.parity {
        Parity::None => ControlModes::empty(),
        Parity::Even => ControlModes::PARENB,
        Parity::Odd => ControlModes::PARENB | ControlModes::PARODD,
    };
    if settings.stop_bits == 2 {
        termios.control_modes |= ControlModes::CSTOPB;
    }
    match content {
        Content::Frames if settings.parity == Parity::None => {}
        Content::Frames => termios.input_modes |= InputModes::INPCK | InputModes::IGNPAR,
        // With INPCK and without IGNPAR, a character with a wrong parity or stop bit is passed as zero. Stop bits are
        // only checked with INPCK, also on a port without parity.
        Content::Text { .. } => {
            termios.input_modes -= InputModes::IGNPAR;
            termios.input_modes |= InputModes::INPCK;
        }
    }
    termios.special_codes[SpecialCodeIndex::VMIN] = 1;
    termios.special_codes[SpecialCodeIndex::VTIME] = 0;
    termios.set_speed(settings.baud)?;
    rustix::termios::tcsetattr(port, OptionalActions::Now, &termios)?;
    // The call also succeeds if only some settings were accepted. (A driver may round the speed a little.)
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

#[cfg(test)]
mod tests {
    use rustix::pty::OpenptFlags;

    use super::*;

    #[test]
    fn a_wrong_stop_bit_in_text_is_detected_also_without_parity() {
        let hardware = rustix::pty::openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        rustix::pty::grantpt(&hardware).unwrap();
        rustix::pty::unlockpt(&hardware).unwrap();
        let path = rustix::pty::ptsname(&hardware, Vec::new()).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let port = File::from(rustix::fs::open(path.as_c_str(), flags, Mode::empty()).unwrap());
        for (content, parity, checks, discards) in [
            (Content::Frames, Parity::None, false, false),
            (Content::Frames, Parity::Even, true, true),
            (Content::Text { data_bits: 8 }, Parity::None, true, false),
            (Content::Text { data_bits: 7 }, Parity::Even, true, false),
        ] {
            set_up(&port, Serial { baud: 9600, parity, stop_bits: 1 }, content).unwrap();
            let modes = rustix::termios::tcgetattr(&port).unwrap().input_modes;
            let found = (modes.contains(InputModes::INPCK), modes.contains(InputModes::IGNPAR));
            assert_eq!(found, (checks, discards), "{content:?}, {parity:?}");
        }
    }
}

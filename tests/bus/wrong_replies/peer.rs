//! Device end of one connection, or of a serial port.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use rustix::pty::OpenptFlags;
use rustix::termios::OptionalActions;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::unix::pipe::Receiver;

use crate::wrong_replies::question::{Kind, Question};
use crate::wrong_replies::rig::Lane;

/// Time after which sent bytes have certainly arrived at the other end.
const HANDED_ON: Duration = Duration::from_millis(30);

pub(crate) struct Peer {
    end: End,
    received: Vec<u8>,
    pub(crate) lane: Arc<Lane>,
    /// Number of the connection on its lane, from 0.
    pub(crate) connection: usize,
}

enum End {
    Socket(TcpStream),
    /// End for reading, end for writing, and the end of the gateway.
    Port(Receiver, OwnedFd, std::fs::File),
}

/// Both ends of a pseudo-terminal. The end of the gateway stays open, so that the port exists before and after the
/// gateway.
pub(crate) struct Plug {
    hardware: OwnedFd,
    kept: std::fs::File,
    pub(crate) path: String,
}

impl Plug {
    pub(crate) fn new() -> Plug {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let hardware = rustix::pty::openpt(flags).unwrap();
        rustix::pty::grantpt(&hardware).unwrap();
        rustix::pty::unlockpt(&hardware).unwrap();
        let mut termios = rustix::termios::tcgetattr(&hardware).unwrap();
        termios.make_raw();
        rustix::termios::tcsetattr(&hardware, OptionalActions::Now, &termios).unwrap();
        let status = rustix::fs::fcntl_getfl(&hardware).unwrap();
        rustix::fs::fcntl_setfl(&hardware, status | OFlags::NONBLOCK).unwrap();
        let path = rustix::pty::ptsname(&hardware, Vec::new()).unwrap().into_string().unwrap();
        let noctty = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let kept = rustix::fs::open(path.as_str(), noctty, rustix::fs::Mode::empty()).unwrap();
        Plug { hardware, kept: kept.into(), path }
    }

    /// Returns the device on this port, and a file that keeps the port in existence.
    pub(crate) fn peer(self, lane: Arc<Lane>) -> (Peer, std::fs::File) {
        // For the runtime, a port is like the end of a pipe.
        let other = self.hardware.try_clone().unwrap();
        let receiver = Receiver::from_owned_fd_unchecked(other).unwrap();
        let end = End::Port(receiver, self.hardware, self.kept.try_clone().unwrap());
        (Peer { end, received: Vec::new(), lane, connection: 0 }, self.kept)
    }
}

impl Peer {
    pub(crate) fn of(stream: TcpStream, lane: Arc<Lane>, connection: usize) -> Peer {
        stream.set_nodelay(true).unwrap();
        Peer { end: End::Socket(stream), received: Vec::new(), lane, connection }
    }

    pub(crate) fn kind(&self) -> Kind {
        self.lane.kind
    }

    /// Waits for the next request. It first checks the effect of the attempt before.
    pub(crate) async fn asked(&mut self) -> io::Result<Question> {
        loop {
            if let Some((asked, end)) = Question::find(self.kind(), &self.received) {
                self.received.drain(..end);
                self.lane.look();
                return Ok(asked);
            }
            let mut bytes = [0; 512];
            let count = self.end.read(&mut bytes).await?;
            if count == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            self.received.extend(&bytes[..count]);
        }
    }

    /// Sends bytes in one piece. A port without a reader accepts no more bytes at some time.
    pub(crate) async fn say(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.end {
            End::Socket(stream) => stream.write_all(bytes).await,
            End::Port(_, port, others) => {
                let _ = rustix::io::write(port, bytes);
                // Polling the other end makes the kernel move the bytes there.
                let _ = is_readable(others);
                Ok(())
            }
        }
    }

    /// Sends a false reply that must arrive before the next request. If the request came first, the attempt is void,
    /// because the reply cannot be distinguished from an answer. A pseudo-terminal moves bytes with a delay in both
    /// directions. On a busy computer, a gateway may send its request long after its check for waiting input.
    pub(crate) async fn lies_before(&mut self, lie: &[u8]) -> io::Result<()> {
        if self.lane.is_void() || self.is_asked() {
            return Ok(());
        }
        self.lane.tries();
        self.lane.leaves_open(true);
        let said = self.say(lie).await;
        let turned = self.lane.turned();
        tokio::time::sleep(HANDED_ON).await;
        while self.lane.turned() == turned {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        if self.is_asked() {
            self.lane.spoils();
        }
        self.lane.leaves_open(false);
        said
    }

    /// Returns whether a request waits, or the other end is gone. Bytes that are sent now would follow the request.
    pub(crate) fn is_asked(&self) -> bool {
        !self.received.is_empty()
            || match &self.end {
                End::Socket(stream) => is_readable(stream),
                End::Port(_, port, _) => is_readable(port),
            }
    }

    /// Sends the correct answer.
    pub(crate) async fn answer(&mut self, asked: &Question) -> io::Result<()> {
        self.lane.is_answered(asked);
        self.say(&asked.right()).await
    }
}

impl End {
    async fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            End::Socket(stream) => stream.read(bytes).await,
            End::Port(port, ..) => port.read(bytes).await,
        }
    }
}

/// Returns whether there is input now, or the other end is gone.
fn is_readable(end: &impl AsFd) -> bool {
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut [PollFd::new(end, PollFlags::IN)], Some(&at_once)).unwrap() > 0
}

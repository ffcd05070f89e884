//! The device's end of one connection, or of a serial port.

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

/// After so long what was said or asked has surely come to the other end.
const HANDED_ON: Duration = Duration::from_millis(30);

pub(crate) struct Peer {
    end: End,
    received: Vec<u8>,
    pub(crate) lane: Arc<Lane>,
    /// Which connection of its lane this is, from 0.
    pub(crate) connection: usize,
}

enum End {
    Socket(TcpStream),
    /// To read from, to write to, and the gateway's end.
    Port(Receiver, OwnedFd, std::fs::File),
}

/// Both ends of a pseudo-terminal. The gateway's is kept open, so that the port is there before and after it.
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

    /// The device that lives there, and what keeps the port in being.
    pub(crate) fn peer(self, lane: Arc<Lane>) -> (Peer, std::fs::File) {
        // To the runtime a port is like the end of a pipe.
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

    /// The next question. What came of the one before it is looked at first.
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

    /// In one piece. A port that nobody reads from takes no more at some time.
    pub(crate) async fn say(&mut self, bytes: &[u8]) -> io::Result<()> {
        match &mut self.end {
            End::Socket(stream) => stream.write_all(bytes).await,
            End::Port(_, port, others) => {
                let _ = rustix::io::write(port, bytes);
                // Whoever polls the other end has the kernel hand the bytes on first.
                let _ = is_readable(others);
                Ok(())
            }
        }
    }

    /// A lie that must come before the next question. Where that came first after all, the attempt is none: the lie has
    /// become an answer, which nobody can tell. A pseudo-terminal hands bytes on when the kernel finds the time, either way;
    /// and on a busy computer a gateway may be kept from asking for long after its look at what has come.
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

    /// Whether a question waits, or the other end has gone: what is said now would come after the question.
    pub(crate) fn is_asked(&self) -> bool {
        !self.received.is_empty()
            || match &self.end {
                End::Socket(stream) => is_readable(stream),
                End::Port(_, port, _) => is_readable(port),
            }
    }

    /// The right answer.
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

/// Whether there is something to read now, or the other end has gone.
fn is_readable(end: &impl AsFd) -> bool {
    let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
    poll(&mut [PollFd::new(end, PollFlags::IN)], Some(&at_once)).unwrap() > 0
}

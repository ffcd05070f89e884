//! The socket of a CAN interface, and the time in which its devices act.

use std::io;
use std::time::Duration;

use rustix::io::Errno;
use socketcan::{
    CanAddr, CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanFilter, EmbeddedFrame,
    ExtendedId, Frame as _, Id, Socket as _, SocketOptions, StandardId,
};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;
use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::clock::{Clock, Inlet, Sleeper};
use crate::virtual_machine::TICK;
use crate::virtual_machine::hardware::can::Sent;
use crate::virtual_machine::server::Shared;
use isotherm_core::codec::{CanId, Frame};
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

const EVERYTHING: Interest = Interest::READABLE.add(Interest::ERROR);
/// Between two attempts to put a frame into a full queue, and how many there are: a quarter of a second.
const PAUSE: Duration = Duration::from_millis(1);
const ATTEMPTS: u32 = 250;
/// Extended identifier; the frame asks for another (linux/can.h).
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
/// Bytes: some thousand frames, where the system lets us.
const BUFFER: usize = 4 << 20;

/// The devices of an interface.
#[derive(Debug)]
pub(crate) struct CanLine {
    pub(crate) devices: Vec<DeviceId>,
    pub(crate) shared: Shared,
    pub(crate) begin: Moment,
}

/// An interface. It may go down and be deleted: its devices go on, unheard, and are heard again when it is back.
#[derive(Debug)]
pub(crate) struct Port {
    interface: String,
    wanted: Vec<CanId>,
    clock: Clock,
    socket: Option<Open>,
}

#[derive(Debug)]
struct Open {
    fd: AsyncFd<CanFdSocket>,
    /// A virtual clock waits for frames that no device has taken.
    _inlet: Inlet,
}

/// Serves a line until `stop` changes or its sender is gone.
pub(crate) async fn serve(
    mut port: Port,
    line: CanLine,
    mut sleeper: Sleeper,
    mut stop: watch::Receiver<bool>,
) -> io::Result<()> {
    let mut late: JoinSet<Frame> = JoinSet::new();
    loop {
        let now = sleeper.now();
        let (sent, due) = {
            let mut hardware = line.shared.hardware();
            (hardware.can_tick(&line.devices, now), hardware.can_due(&line.devices))
        };
        port.send(sent, &mut late).await;
        let tick = now.next_tick(line.begin, TICK);
        tokio::select! {
            biased;
            _ = stop.changed() => return Ok(()),
            Some(frame) = late.join_next() => {
                let frame = frame.map_err(io::Error::other)?;
                port.send(vec![Sent::Frame(frame, None)], &mut late).await;
            }
            () = port.ready() => {
                while let Some(frame) = port.hear() {
                    let sent = line.shared.hardware().can_take(&line.devices, &frame, sleeper.now());
                    port.send(sent, &mut late).await;
                }
            }
            _ = sleeper.sleep_until(due.map_or(tick, |due| due.min(tick))) => {}
        }
    }
}

impl Port {
    /// The interface of this name, of which these identifiers are heard.
    ///
    /// # Errors
    /// No such interface, none of CAN, no CAN in the kernel.
    pub(crate) fn open(interface: &str, wanted: Vec<CanId>, clock: &Clock) -> io::Result<Port> {
        let socket = Some(open(interface, &wanted, clock)?);
        Ok(Port { interface: interface.to_owned(), wanted, clock: clock.clone(), socket })
    }

    /// There is something to be heard, be it an error.
    async fn ready(&self) {
        match &self.socket {
            Some(open) => {
                if let Ok(mut guard) = open.fd.ready(EVERYTHING).await {
                    guard.retain_ready();
                }
            }
            None => std::future::pending().await,
        }
    }

    /// The next frame, if one has come.
    fn hear(&mut self) -> Option<Frame> {
        loop {
            let socket = self.socket.as_ref()?;
            // One after the other: of two at once `try_io` thinks that neither is ready, and never reads.
            let read = match socket.fd.try_io(Interest::READABLE, CanFdSocket::read_frame) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    socket.fd.try_io(Interest::ERROR, CanFdSocket::read_frame)
                }
                read => read,
            };
            match read {
                Ok(frame) => {
                    if let Some(frame) = unpacked(&frame) {
                        return Some(frame);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return None,
                Err(error) => self.suffer(&error),
            }
        }
    }

    async fn send(&mut self, sent: Vec<Sent>, late: &mut JoinSet<Frame>) {
        if self.socket.is_none() && !sent.is_empty() {
            self.socket = open(&self.interface, &self.wanted, &self.clock).ok();
        }
        for sent in sent {
            let packed = match sent {
                Sent::Frame(frame, Some(delay)) => {
                    late.spawn(async move {
                        tokio::time::sleep(delay).await;
                        frame
                    });
                    continue;
                }
                Sent::Frame(frame, None) => packed(&frame),
                Sent::Error(error) => {
                    CanErrorFrame::new_error(error.class, &error.data).ok().map(CanAnyFrame::Error)
                }
            };
            if let Some(packed) = packed {
                self.put(&packed).await;
            }
        }
    }

    /// A frame that cannot be put into the interface's queue is lost, as on any bus.
    async fn put(&mut self, frame: &CanAnyFrame) {
        let mut was_down = false;
        for _ in 0..ATTEMPTS {
            let Some(open) = &self.socket else { return };
            let Err(error) = open.fd.get_ref().write_frame(frame) else { return };
            match Errno::from_io_error(&error) {
                // What was left behind by the last time it was down.
                Some(Errno::NETDOWN) if !was_down => was_down = true,
                Some(Errno::NETDOWN) => return,
                Some(Errno::NOBUFS | Errno::AGAIN) => tokio::time::sleep(PAUSE).await,
                _ => return self.suffer(&error),
            }
        }
        tracing::warn!(interface = self.interface, "a frame was lost: the interface's queue stays full");
    }

    fn suffer(&mut self, error: &io::Error) {
        match Errno::from_io_error(error) {
            Some(Errno::NETDOWN) => {}
            // A frame that the interface cannot carry.
            Some(Errno::INVAL | Errno::MSGSIZE) => {
                tracing::warn!(interface = self.interface, %error, "a frame was refused: no CAN FD?");
            }
            _ => {
                tracing::debug!(interface = self.interface, %error, "the interface is gone");
                self.socket = None;
            }
        }
    }
}

fn open(interface: &str, wanted: &[CanId], clock: &Clock) -> io::Result<Open> {
    let address = CanAddr::from_iface(interface).map_err(|_| {
        let make = format!("ip link add dev {interface} type vcan && ip link set {interface} up");
        io::Error::other(format!("there is no such interface; a virtual one is made by: {make}"))
    })?;
    let socket = CanFdSocket::open_addr(&address).map_err(|error| match Errno::from_io_error(&error) {
        Some(Errno::AFNOSUPPORT | Errno::PROTONOSUPPORT) => io::Error::other("this kernel has no CAN"),
        Some(Errno::NODEV) => io::Error::other("this is no CAN interface"),
        _ => error,
    })?;
    socket.set_nonblocking(true)?;
    let filters: Vec<_> = wanted.iter().map(filter).collect();
    if filters.is_empty() {
        socket.set_filter_drop_all()?
    } else {
        socket.set_filters(&filters)?
    }
    socket2::SockRef::from(&socket).set_recv_buffer_size(BUFFER)?;
    let inlet = clock.inlet(&socket)?;
    #[allow(deprecated, reason = "what replaces it is unsafe")]
    let fd = AsyncFd::with_interest(socket, EVERYTHING)?;
    Ok(Open { fd, _inlet: inlet })
}

/// The same number with the other length is another identifier.
fn filter(id: &CanId) -> CanFilter {
    let (length, mask) =
        if id.is_extended() { (EXTENDED, CanId::LARGEST_EXTENDED) } else { (0, CanId::LARGEST_STANDARD) };
    CanFilter::new(id.raw() | length, mask | EXTENDED | REMOTE)
}

fn unpacked(frame: &CanAnyFrame) -> Option<Frame> {
    let id = || {
        let raw = frame.raw_id();
        if frame.is_extended() { CanId::extended(raw) } else { CanId::standard(raw) }
    };
    match frame {
        CanAnyFrame::Normal(data) => Frame::classic(id()?, data.data()),
        CanAnyFrame::Fd(data) => Frame::fd(id()?, data.data()),
        CanAnyFrame::Remote(_) | CanAnyFrame::Error(_) => None,
    }
}

fn packed(frame: &Frame) -> Option<CanAnyFrame> {
    let raw = frame.id().raw();
    let id = if frame.id().is_extended() {
        Id::Extended(ExtendedId::new(raw)?)
    } else {
        Id::Standard(StandardId::new(u16::try_from(raw).ok()?)?)
    };
    if frame.is_fd() {
        CanFdFrame::new(id, frame.data()).map(CanAnyFrame::Fd)
    } else {
        CanDataFrame::new(id, frame.data()).map(CanAnyFrame::Normal)
    }
}

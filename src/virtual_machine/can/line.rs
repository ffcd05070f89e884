//! Socket of a CAN interface, and the times at which its virtual devices act.

use std::io;
use std::time::Duration;

use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::clock::{Clock, Sleeper, SocketGate};
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use crate::fieldbus::kinds::can::socket::{ReceivedFrame, Socket};
use crate::virtual_machine::TICK;
use crate::virtual_machine::hardware::can::Sent;
use crate::virtual_machine::server::Shared;
use isotherm_core::codec::{CanMatch, Frame};
use isotherm_core::quantity::Moment;

/// Pause between two attempts to add a frame to a full send queue. [`ATTEMPTS`] pauses take a quarter of a second.
const PAUSE: Duration = Duration::from_millis(1);
const ATTEMPTS: u32 = 250;

/// Virtual devices on one CAN interface, with the state that they share.
#[derive(Debug)]
pub(crate) struct CanLine {
    pub(crate) places: Vec<usize>,
    pub(crate) shared: Shared,
    pub(crate) begin: Moment,
}

/// CAN interface of the virtual machine. If the interface goes down or is deleted, its devices continue to run, and use
/// the interface again when it is back.
#[derive(Debug)]
pub(crate) struct Port {
    interface: String,
    wanted: Vec<CanMatch>,
    clock: Clock,
    /// Socket, and its registration with a virtual clock, which does not advance while a received frame is unread.
    socket: Option<(Socket, SocketGate)>,
}

/// Serves the devices of an interface until `stop` changes or its sender is dropped.
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
            (hardware.can_tick(&line.places, now), hardware.can_due(&line.places))
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
                while let Some(frame) = port.receive() {
                    let sent = line.shared.hardware().can_take(&line.places, &frame, sleeper.now());
                    port.send(sent, &mut late).await;
                }
            }
            _ = sleeper.sleep_until(due.map_or(tick, |due| due.min(tick))) => {}
        }
    }
}

impl Port {
    /// Opens the interface of this name, and receives the frames that match `wanted`.
    ///
    /// # Errors
    /// The interface does not exist or is no CAN interface, or the kernel does not support CAN.
    pub(crate) fn open(interface: &str, wanted: Vec<CanMatch>, clock: &Clock) -> io::Result<Port> {
        let interface = interface.to_owned();
        let mut port = Port { interface, wanted, clock: clock.clone(), socket: None };
        port.reopen()?;
        Ok(port)
    }

    fn reopen(&mut self) -> io::Result<()> {
        let interface = &self.interface;
        let socket = Socket::open(interface, &self.wanted).map_err(|fault| {
            io::Error::other(match fault {
                Fault::Link(LinkFault::Can(CanFault::NoInterface)) => format!(
                    "there is no such interface; create a virtual one with: ip link add dev {interface} type \
                     vcan && ip link set {interface} up"
                ),
                Fault::Link(LinkFault::Can(CanFault::NoKernel)) => {
                    "this kernel does not support CAN: run `modprobe can-raw` as root".to_owned()
                }
                Fault::Link(LinkFault::Can(CanFault::NotCan)) => {
                    "this is not a CAN interface: name one, such as \"can0\" or \"vcan0\"".to_owned()
                }
                fault => fault.to_string(),
            })
        })?;
        let gate = self.clock.gate(&socket)?;
        self.socket = Some((socket, gate));
        Ok(())
    }

    /// Waits until a frame or an error can be received.
    async fn ready(&self) {
        match &self.socket {
            Some((socket, _)) => socket.ready().await,
            None => std::future::pending().await,
        }
    }

    /// Returns the next frame; `None` if no frame has been received.
    fn receive(&mut self) -> Option<Frame> {
        loop {
            match self.socket.as_ref()?.0.receive_now() {
                Ok(Some(ReceivedFrame::Frame(frame))) => return Some(frame),
                Ok(Some(ReceivedFrame::Error(_))) => {}
                Ok(None) => return None,
                Err(fault) => self.failed(fault),
            }
        }
    }

    async fn send(&mut self, sent: Vec<Sent>, late: &mut JoinSet<Frame>) {
        if self.socket.is_none() && !sent.is_empty() {
            let _ = self.reopen();
        }
        for sent in sent {
            if let Sent::Frame(frame, Some(delay)) = sent {
                late.spawn(async move {
                    tokio::time::sleep(delay).await;
                    frame
                });
            } else {
                self.put(sent).await;
            }
        }
    }

    /// Adds a frame to the send queue of the interface. If the queue stays full, the frame is lost, as on a real bus.
    async fn put(&mut self, sent: Sent) {
        for _ in 0..ATTEMPTS {
            let Some((socket, _)) = &self.socket else { return };
            let sent = match sent {
                Sent::Frame(frame, _) => socket.send_now(&frame),
                Sent::Error(error) => socket.send_error_now(error.class, &error.data),
            };
            match sent {
                Ok(()) => return,
                Err(Fault::Link(LinkFault::Can(CanFault::Full))) => tokio::time::sleep(PAUSE).await,
                Err(fault) => return self.failed(fault),
            }
        }
        tracing::warn!(interface = self.interface, "a frame was lost: the interface's queue stays full");
    }

    fn failed(&mut self, fault: Fault) {
        match fault {
            Fault::Link(LinkFault::Can(CanFault::Down)) => {}
            Fault::Link(LinkFault::Can(CanFault::TooLong)) => {
                tracing::warn!(
                    interface = self.interface,
                    "the interface refused a frame: does it support CAN FD?"
                );
            }
            _ => {
                tracing::debug!(interface = self.interface, %fault, "the interface no longer exists");
                self.socket = None;
            }
        }
    }
}

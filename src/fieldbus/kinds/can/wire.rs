//! Wire (open connection) of a CAN line: the gateway reads and writes objects by SDO, and sends process data
//! in frames.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;

use super::link::Link;
use super::socket::Socket;
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::error::{CallerFault, CanFault, Fault, LinkFault, PeerFault};
use crate::fieldbus::kinds::can::canopen::NodeId;
use crate::fieldbus::kinds::can::canopen::sdo::{ANSWER, Client, Data, Progress};
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Boxed, Call, CanRequest, Ending, Request, Wire};
use isotherm_core::codec::Frame;

/// Opener of the connection of a CAN line. Another task receives the frames of the interface.
#[derive(Debug)]
pub struct CanDial {
    link: Arc<Link>,
    timeout: Duration,
}

impl CanDial {
    /// Returns a connection opener for the interface of `link`. If the send queue is full, a frame waits for room for
    /// at most half of `timeout`.
    pub fn new(link: Arc<Link>, timeout: Duration) -> CanDial {
        CanDial { link, timeout }
    }
}

impl Dial for CanDial {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let wire = match (self.link.fault(), self.link.socket()) {
            (None, Some(socket)) => Ok(Connection::Other(Box::new(CanWire {
                passing: self.link.ask(),
                link: self.link.clone(),
                socket,
                patience: self.timeout / 2,
                asked: None,
                tap: tap.clone(),
            }))),
            (fault, _) => Err(fault.unwrap_or(Fault::Link(LinkFault::Down))),
        };
        Box::pin(std::future::ready(wire))
    }
}

/// Pause between two attempts to send. The kernel does not report when a full queue has room again.
const PAUSE: Duration = Duration::from_millis(1);

struct CanWire {
    link: Arc<Link>,
    socket: Arc<Socket>,
    /// Queue of received SDO frames in the order of the bus: answers, and the gateway's own requests.
    passing: mpsc::Receiver<Frame>,
    patience: Duration,
    /// Node from which an answer is expected; `None` while no request is open.
    asked: Option<NodeId>,
    tap: Tap,
}

impl Wire for CanWire {
    fn exchange<'a>(&'a mut self, unit: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a> {
        Box::pin(async move {
            let Request::Can(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
            match request {
                CanRequest::Read { object } => {
                    let node = node(unit)?;
                    self.discard_unasked(node);
                    send_guard.leave()?;
                    let first = self.link.client(node, |client| client.read(object.entry));
                    let data = self.transfer(node, first, send_guard).await?;
                    let bytes = data.as_ref().ok_or(Fault::Peer(PeerFault::Malformed))?;
                    let bytes = bytes.of_width(object.size())?;
                    let registers = object.registers(bytes).ok_or(Fault::Caller(CallerFault::Extent))?;
                    self.link.images(|images| images.was_read(unit, object, registers.registers()));
                    Ok(Answer::Registers(registers.registers().to_vec()))
                }
                CanRequest::Write { object, values } => {
                    let node = node(unit)?;
                    let bytes = object.bytes(values);
                    self.discard_unasked(node);
                    send_guard.leave()?;
                    let first = self.link.client(node, |client| client.write(object.entry, &bytes));
                    self.transfer(node, first, send_guard).await.map(|_| Answer::Done)
                }
                CanRequest::Send { id, bits, values } => {
                    // A value that may not be sent now must not be sent later with another value of the same frame
                    // either.
                    send_guard.leave()?;
                    let frame = self.link.images(|images| images.put(id, bits, values))?;
                    self.send(&frame, Some(send_guard)).await.map(|()| Answer::Done)
                }
            }
        })
    }

    /// Returns [`Ending::Kept`], because the end of a connection does not show that a node was exchanged. Another task
    /// receives the frames, and detects lost and restarted nodes.
    fn ending(&mut self) -> Ending {
        Ending::Kept
    }

    fn missed(&mut self) -> Fault {
        let given_up = self.asked.take().and_then(|node| self.link.client(node, Client::timed_out));
        if let Some(abort) = given_up {
            // If the abort cannot be sent, the next transfer first waits until no old answer is under way.
            let _ = self.socket.send_now(&abort);
        }
        Fault::Timeout
    }
}

impl CanWire {
    /// Discards SDO frames that arrived before the request, and reports each discarded frame to the SDO client of the
    /// node. After such a frame, more unexpected answers may follow.
    fn discard_unasked(&mut self, node: NodeId) {
        while let Ok(passed) = self.passing.try_recv() {
            self.show(&passed);
            self.link.client(node, |client| client.was_not_asked(&passed));
        }
    }

    /// Sends a frame of a transfer, and waits until this frame was sent on the bus. SDO frames received before that are
    /// discarded, because they cannot be the answer.
    async fn ask(
        &mut self,
        node: NodeId,
        question: &Frame,
        send_guard: Option<&mut SendGuard>,
    ) -> Result<(), Fault> {
        self.send(question, send_guard).await?;
        loop {
            let passed = self.next().await?;
            if passed == *question {
                return Ok(());
            }
            self.link.client(node, |client| client.was_not_asked(&passed));
        }
    }

    async fn next(&mut self) -> Result<Frame, Fault> {
        let passed = self.passing.recv().await.ok_or(Fault::Link(LinkFault::Broken))?;
        self.show(&passed);
        Ok(passed)
    }

    /// Writes a received answer to the frame log. Requests are already in the log, because they are logged when they
    /// are sent.
    fn show(&self, passed: &Frame) {
        if NodeId::sender(passed, ANSWER).is_some() {
            self.tap.pass(passed.data(), false);
        }
    }

    /// Transfers one object, frame by frame. Returns the data that was read; `None` if the object was written.
    async fn transfer(
        &mut self,
        node: NodeId,
        first: Frame,
        send_guard: &mut SendGuard,
    ) -> Result<Option<Data>, Fault> {
        self.asked = Some(node);
        self.ask(node, &first, Some(send_guard)).await?;
        let end = loop {
            let progress = loop {
                let answer = self.next().await?;
                if let Some(progress) = self.link.client(node, |client| client.take(&answer)) {
                    break progress;
                }
            };
            match progress {
                Progress::Send(next) => self.ask(node, &next, None).await?,
                // Only now is the actual request sent, if it is not too late for it.
                Progress::Begin(first) => {
                    send_guard.leave()?;
                    self.ask(node, &first, Some(send_guard)).await?;
                }
                Progress::Read(data) => break Ok(Some(data)),
                Progress::Written => break Ok(None),
                Progress::Failed(why, last) => {
                    if let Some(last) = last {
                        self.send(&last, None).await?;
                    }
                    break Err(why);
                }
            }
        };
        self.asked = None;
        end
    }

    /// Puts a frame into the send queue, and waits a limited time for room if the queue is full. Checks `send_guard`
    /// (the send deadline) again after each wait, because the request can become too old.
    async fn send(&self, frame: &Frame, mut send_guard: Option<&mut SendGuard>) -> Result<(), Fault> {
        self.tap.pass(frame.data(), true);
        let mut pauses = self.patience.as_millis() / PAUSE.as_millis();
        let sent = loop {
            match self.socket.send_now(frame) {
                Err(Fault::Link(LinkFault::Can(CanFault::Full))) if pauses > 0 => pauses -= 1,
                sent => break sent,
            }
            tokio::time::sleep(PAUSE).await;
            if let Some(send_guard) = &mut send_guard {
                send_guard.leave()?;
            }
        };
        if let Err(fault @ Fault::Link(LinkFault::Can(CanFault::Down | CanFault::NoInterface))) = sent {
            self.link.failed(fault);
        }
        sent
    }
}

fn node(unit: u8) -> Result<NodeId, Fault> {
    NodeId::new(unit).ok_or(Fault::Caller(CallerFault::Extent))
}

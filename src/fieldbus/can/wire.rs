//! A CAN interface as a line: objects are read and written by SDO, process data is written in frames.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;

use super::link::Link;
use super::socket::Socket;
use crate::fieldbus::canopen::NodeId;
use crate::fieldbus::canopen::sdo::{ANSWER, Client, Data, Progress};
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::departure::Departure;
use crate::fieldbus::error::{CallerFault, CanFault, Fault, LinkFault, PeerFault};
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Boxed, CanRequest, Ending, Request, Wire};
use isotherm_core::codec::Frame;

/// Opens the line of an interface that somebody listens to.
#[derive(Debug)]
pub struct CanDial {
    link: Arc<Link>,
    timeout: Duration,
}

impl CanDial {
    /// On this interface; a full queue is given half of the line's timeout.
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

/// A full queue never says that there is room again.
const PAUSE: Duration = Duration::from_millis(1);

struct CanWire {
    link: Arc<Link>,
    socket: Arc<Socket>,
    /// Answers, and our own questions, in the order of the bus.
    passing: mpsc::Receiver<Frame>,
    patience: Duration,
    /// The node whose answer is awaited.
    asked: Option<NodeId>,
    tap: Tap,
}

impl Wire for CanWire {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        departure: &'a mut Departure,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(async move {
            let Request::Can(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
            match request {
                CanRequest::Read { object } => {
                    let node = node(unit)?;
                    self.discard_unasked(node);
                    departure.leave()?;
                    let first = self.link.client(node, |client| client.read(object.entry));
                    let data = self.transfer(node, first, departure).await?;
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
                    departure.leave()?;
                    let first = self.link.client(node, |client| client.write(object.entry, &bytes));
                    self.transfer(node, first, departure).await.map(|_| Answer::Done)
                }
                CanRequest::Send { id, bits, values } => {
                    // What does not leave must not leave with another value of the same frame either.
                    departure.leave()?;
                    let frame = self.link.images(|images| images.put(id, bits, values))?;
                    self.send(&frame, Some(departure)).await.map(|()| Answer::Done)
                }
            }
        })
    }

    /// The listener of the interface notices which nodes come and go.
    fn ending(&mut self) -> Ending {
        Ending::Kept
    }

    fn missed(&mut self) -> Fault {
        let given_up = self.asked.take().and_then(|node| self.link.client(node, Client::timed_out));
        if let Some(abort) = given_up {
            // Where it does not leave the house, the next transfer settles the matter.
            let _ = self.socket.send_now(&abort);
        }
        Fault::Timeout
    }
}

impl CanWire {
    /// What has come before the question answers an older one, or none: whatever else of that kind is under way must not be
    /// taken for the answer to this one.
    fn discard_unasked(&mut self, node: NodeId) {
        while let Ok(passed) = self.passing.try_recv() {
            self.show(&passed);
            self.link.client(node, |client| client.was_not_asked(&passed));
        }
    }

    /// Sends a frame of a transfer and waits until it has passed. What passes before it came before it, wherever in the
    /// computer it waited meanwhile, and answers nothing.
    async fn ask(
        &mut self,
        node: NodeId,
        question: &Frame,
        departure: Option<&mut Departure>,
    ) -> Result<(), Fault> {
        self.send(question, departure).await?;
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

    /// What is asked was shown when it was sent.
    fn show(&self, passed: &Frame) {
        if NodeId::sender(passed, ANSWER).is_some() {
            self.tap.pass(passed.data(), false);
        }
    }

    /// One object, one frame at a time. `None`: it was written.
    async fn transfer(
        &mut self,
        node: NodeId,
        first: Frame,
        departure: &mut Departure,
    ) -> Result<Option<Data>, Fault> {
        self.asked = Some(node);
        self.ask(node, &first, Some(departure)).await?;
        let end = loop {
            let progress = loop {
                let answer = self.next().await?;
                if let Some(progress) = self.link.client(node, |client| client.take(&answer)) {
                    break progress;
                }
            };
            match progress {
                Progress::Send(next) => self.ask(node, &next, None).await?,
                // Only now does the question itself leave, if it still may.
                Progress::Begin(first) => {
                    departure.leave()?;
                    self.ask(node, &first, Some(departure)).await?;
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

    /// Puts a frame into the interface's queue; a full one is given its time, in which the question that begins with the
    /// frame, where one does, may become too late.
    async fn send(&self, frame: &Frame, mut departure: Option<&mut Departure>) -> Result<(), Fault> {
        self.tap.pass(frame.data(), true);
        let mut pauses = self.patience.as_millis() / PAUSE.as_millis();
        let sent = loop {
            match self.socket.send_now(frame) {
                Err(Fault::Link(LinkFault::Can(CanFault::Full))) if pauses > 0 => pauses -= 1,
                sent => break sent,
            }
            tokio::time::sleep(PAUSE).await;
            if let Some(departure) = &mut departure {
                departure.leave()?;
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

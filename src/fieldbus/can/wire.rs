//! A CAN interface as a line: objects are read and written by SDO, process data is written in frames.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;

use super::link::Link;
use super::socket::Socket;
use crate::codec::Frame;
use crate::fieldbus::canopen::sdo::{Client, Data, Progress, SdoError};
use crate::fieldbus::canopen::{Entry, NodeId};
use crate::fieldbus::error::{CallerFault, CanFault, Fault, LinkFault, PeerFault};
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::{Answer, Boxed, CanRequest, Connection, Dial, Request, Wire};
use crate::profile::Object;

/// Opens the line of an interface that somebody listens to.
#[derive(Debug)]
pub struct CanDial {
    link: Arc<Link>,
    timeout: Duration,
    tap: Tap,
}

impl CanDial {
    /// On this interface; a full queue is given half of the line's timeout.
    pub fn new(link: Arc<Link>, timeout: Duration) -> CanDial {
        CanDial { link, timeout, tap: Tap::default() }
    }
}

impl Dial for CanDial {
    fn dial(&mut self) -> Boxed<'_, Result<Connection, Fault>> {
        let wire = match (self.link.fault(), self.link.socket()) {
            (None, Some(socket)) => Ok(Connection::Other(Box::new(CanWire {
                answers: self.link.ask(),
                link: self.link.clone(),
                socket,
                patience: self.timeout / 2,
                asked: None,
                tap: self.tap.clone(),
            }))),
            (fault, _) => Err(fault.unwrap_or(Fault::Link(LinkFault::Down))),
        };
        Box::pin(std::future::ready(wire))
    }

    fn tap(&mut self, tap: &Tap) {
        self.tap = tap.clone();
    }
}

struct CanWire {
    link: Arc<Link>,
    socket: Arc<Socket>,
    answers: mpsc::Receiver<Frame>,
    patience: Duration,
    /// The node whose answer is awaited.
    asked: Option<NodeId>,
    tap: Tap,
}

impl Wire for CanWire {
    fn call<'a>(&'a mut self, unit: u8, request: Request<'a>) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.exchange(unit, request))
    }

    fn missed(&mut self) -> Fault {
        let given_up = self.asked.take().and_then(|node| self.link.client(node, Client::timed_out));
        if let Some((_, abort)) = given_up {
            // Where it does not leave the house, the next transfer settles the matter.
            let _ = self.socket.send_now(&abort);
        }
        Fault::Timeout
    }
}

impl CanWire {
    async fn exchange(&mut self, unit: u8, request: Request<'_>) -> Result<Answer, Fault> {
        let Request::Can(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
        match request {
            CanRequest::Read { object } => {
                let node = node(unit)?;
                let first = self.link.client(node, |client| client.read(entry(object)));
                let data = self.transfer(node, first).await?;
                let bytes = data.as_ref().ok_or(Fault::Peer(PeerFault::Malformed))?;
                let bytes = bytes.of_width(object.size(), entry(object)).map_err(fault)?;
                let words = object.words(bytes).ok_or(Fault::Caller(CallerFault::Extent))?;
                self.link.images(|images| images.found(unit, object, words.words()));
                Ok(Answer::Words(words.words().to_vec()))
            }
            CanRequest::Write { object, words } => {
                let node = node(unit)?;
                let bytes = object.bytes(words);
                let first = self.link.client(node, |client| client.write(entry(object), &bytes));
                self.transfer(node, first).await.map(|_| Answer::Done)
            }
            CanRequest::Send { id, bits, words } => {
                let frame = self.link.images(|images| images.put(id, bits, words))?;
                self.send(&frame).await.map(|()| Answer::Done)
            }
        }
    }

    /// One object, one frame at a time. `None`: it was written.
    async fn transfer(&mut self, node: NodeId, first: Frame) -> Result<Option<Data>, Fault> {
        self.asked = Some(node);
        let mut frame = first;
        let end = loop {
            self.send(&frame).await?;
            let progress = loop {
                let answer = self.answers.recv().await.ok_or(Fault::Link(LinkFault::Broken))?;
                self.tap.pass(answer.data(), false);
                if let Some(progress) = self.link.client(node, |client| client.take(&answer)) {
                    break progress;
                }
            };
            match progress {
                Progress::Send(next) => frame = next,
                Progress::Read(data) => break Ok(Some(data)),
                Progress::Written => break Ok(None),
                Progress::Failed(why, last) => {
                    if let Some(last) = last {
                        self.send(&last).await?;
                    }
                    break Err(fault(why));
                }
            }
        };
        self.asked = None;
        end
    }

    async fn send(&self, frame: &Frame) -> Result<(), Fault> {
        self.tap.pass(frame.data(), true);
        let sent = self.socket.send(frame, self.patience).await;
        if let Err(fault @ Fault::Link(LinkFault::Can(CanFault::Down | CanFault::NoInterface))) = sent {
            self.link.failed(fault);
        }
        sent
    }
}

fn node(unit: u8) -> Result<NodeId, Fault> {
    NodeId::new(unit).ok_or(Fault::Caller(CallerFault::Extent))
}

const fn entry(object: Object) -> Entry {
    Entry::new(object.index, object.sub)
}

const fn fault(error: SdoError) -> Fault {
    match error {
        SdoError::Refused(_, code) => Fault::Aborted(code),
        SdoError::TimedOut(_) => Fault::Timeout,
        SdoError::Width { .. } => Fault::Peer(PeerFault::Width),
        SdoError::Toggle(_) | SdoError::Announced { .. } | SdoError::TooLong(_) => {
            Fault::Peer(PeerFault::Malformed)
        }
    }
}

//! State of one interface while the gateway runs: its socket, which may be replaced, and what outlives the socket.
//!
//! One task receives frames ([`Link::socket`]) and passes SDO frames on ([`Link::passed`]). The line sends requests and
//! writes through [`super::wire`].

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::mpsc;

use super::image::Images;
use super::interface::Interface;
use super::socket::Socket;
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use crate::fieldbus::kinds::can::canopen::NodeId;
use crate::fieldbus::kinds::can::canopen::sdo::Client;
use isotherm_core::codec::{CanMatch, Frame};

/// Capacity of the queue of SDO frames. A node sends one answer at a time.
const UNREAD: usize = 64;

/// One CAN interface: its socket, and the state that outlives it.
#[derive(Debug)]
pub struct Link {
    interface: String,
    wanted: Vec<CanMatch>,
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    socket: Option<Arc<Socket>>,
    /// Reason why sending is impossible now.
    fault: Option<Fault>,
    passing: Option<mpsc::Sender<Frame>>,
    clients: BTreeMap<NodeId, Client>,
    images: Images,
    /// Full queues of closed sockets; `lost` counts on the same sockets.
    full: u64,
    lost: u64,
}

impl Link {
    /// Returns a link that is not opened yet. `wanted` selects the frames to receive; `images` are the frames to write.
    pub fn new(interface: &str, wanted: Vec<CanMatch>, images: Images) -> Link {
        let inner = Inner {
            socket: None,
            fault: Some(Fault::Link(LinkFault::Down)),
            passing: None,
            clients: BTreeMap::new(),
            images,
            full: 0,
            lost: 0,
        };
        Link { interface: interface.to_owned(), wanted, inner: Mutex::new(inner) }
    }

    /// Returns the name of the interface.
    pub fn interface(&self) -> &str {
        &self.interface
    }

    /// Opens a socket if there is none, and checks whether the interface is up.
    ///
    /// # Errors
    /// The reason why sending and receiving is impossible now.
    pub fn open(&self) -> Result<Arc<Socket>, Fault> {
        let mut inner = self.inner();
        let opened = match &inner.socket {
            Some(socket) => Ok(socket.clone()),
            None => Socket::open(&self.interface, &self.wanted)
                .and_then(Socket::receives_own_frames)
                .map(Arc::new),
        };
        let found = Interface::query(&self.interface).map_err(|fault| Fault::Link(LinkFault::Can(fault)));
        let (socket, fault) = match (opened, found) {
            (Err(fault), _) | (Ok(_), Err(fault)) => (None, Some(fault)),
            (Ok(socket), Ok(found)) if found.is_up => (Some(socket), None),
            (Ok(socket), Ok(_)) => (Some(socket), Some(Fault::Link(LinkFault::Can(CanFault::Down)))),
        };
        inner.give_up(socket.as_ref());
        (inner.socket, inner.fault) = (socket.clone(), fault);
        match (socket, fault) {
            (Some(socket), None) => Ok(socket),
            (_, fault) => Err(fault.unwrap_or(Fault::Link(LinkFault::Down))),
        }
    }

    /// Returns the socket, even if the interface is down.
    pub fn socket(&self) -> Option<Arc<Socket>> {
        self.inner().socket.clone()
    }

    /// Returns the reason why sending is impossible now.
    pub fn fault(&self) -> Option<Fault> {
        self.inner().fault
    }

    /// Records the fault of a call to the socket. Drops the socket if its interface is gone.
    pub fn failed(&self, fault: Fault) {
        let mut inner = self.inner();
        match fault {
            Fault::Link(LinkFault::Can(CanFault::Full | CanFault::TooLong)) => {}
            Fault::Link(LinkFault::Can(CanFault::Down)) => inner.fault = Some(fault),
            _ => {
                inner.fault = Some(fault);
                inner.give_up(None);
                inner.socket = None;
            }
        }
    }

    /// Returns true if the interface is down now. The error of a socket may be outdated. If the interface was down when
    /// the socket was opened, the socket returns that error even after the interface is up.
    pub fn is_down(&self) -> bool {
        !Interface::query(&self.interface).is_ok_and(|found| found.is_up)
    }

    /// Passes an SDO frame to the current requester: an answer, or its own request once that was on the bus.
    pub fn passed(&self, frame: &Frame) {
        if let Some(passing) = &self.inner().passing {
            // If the queue is full, no requester waits for this frame.
            let _ = passing.try_send(*frame);
        }
    }

    /// Returns how often a frame found the queue full since the start.
    pub fn full(&self) -> u64 {
        let inner = self.inner();
        inner.full + inner.socket.as_ref().map_or(0, |socket| socket.full())
    }

    /// Returns the number of frames lost since the start, because they were not read fast enough.
    pub fn lost(&self) -> u64 {
        let inner = self.inner();
        inner.lost + inner.socket.as_ref().map_or(0, |socket| socket.lost())
    }

    /// Registers a new requester, which replaces the one before.
    pub(super) fn ask(&self) -> mpsc::Receiver<Frame> {
        let (sender, receiver) = mpsc::channel(UNREAD);
        self.inner().passing = Some(sender);
        receiver
    }

    pub(super) fn client<T>(&self, node: NodeId, act: impl FnOnce(&mut Client) -> T) -> T {
        act(self.inner().clients.entry(node).or_insert_with(|| Client::new(node)))
    }

    pub(super) fn images<T>(&self, act: impl FnOnce(&mut Images) -> T) -> T {
        act(&mut self.inner().images)
    }

    /// Locks the state. A panic of another thread leaves it consistent.
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    /// Adds the counts of the present socket, unless `kept` is the same socket.
    fn give_up(&mut self, kept: Option<&Arc<Socket>>) {
        let is_kept = |socket: &&Arc<Socket>| kept.is_some_and(|kept| Arc::ptr_eq(kept, socket));
        if let Some(socket) = self.socket.as_ref().filter(|socket| !is_kept(socket)) {
            self.full += socket.full();
            self.lost += socket.lost();
        }
    }
}

//! State of one CAN interface while the gateway runs: its present socket, and the data that is kept when the socket is
//! replaced.
//!
//! One task receives all frames from [`Link::socket`], and hands SDO frames (reads and writes of node objects) to
//! [`Link::passed`]. The line sends requests and writes through [`super::wire`].

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

/// Capacity of the queue of SDO frames between the receiving task and the requester. A node sends one answer at a time,
/// so this is ample.
const UNREAD: usize = 64;

/// One CAN interface: its socket, and the data that is kept when the socket is replaced.
#[derive(Debug)]
pub struct Link {
    interface: String,
    wanted: Vec<CanMatch>,
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    socket: Option<Arc<Socket>>,
    /// Fault because of which no frame can be sent now; `None` if sending is possible.
    fault: Option<Fault>,
    passing: Option<mpsc::Sender<Frame>>,
    clients: BTreeMap<NodeId, Client>,
    images: Images,
    /// Number of frames that the closed sockets could not send, because the send queue was full. `lost`: number of
    /// received frames that the kernel dropped on the closed sockets.
    full: u64,
    lost: u64,
}

impl Link {
    /// Returns a link whose socket is not open yet. `wanted` selects the frames to receive. `images` contains the
    /// frames that the gateway writes.
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

    /// Returns the name of the CAN interface, for example `can0`.
    pub fn interface(&self) -> &str {
        &self.interface
    }

    /// Opens a socket if no socket is open, and checks whether the interface is up.
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

    /// Returns the open socket, even if the interface is down. Returns `None` if no socket is open.
    pub fn socket(&self) -> Option<Arc<Socket>> {
        self.inner().socket.clone()
    }

    /// Returns the reason why sending is impossible now; `None` if sending is possible.
    pub fn fault(&self) -> Option<Fault> {
        self.inner().fault
    }

    /// Records the fault of a call to the socket. Closes the socket, except if the interface is only down, the queue is
    /// full, or the frame is too long.
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

    /// Returns whether the kernel reports that the interface is down now, or is gone. An error from the socket can be
    /// outdated. A socket that was opened while the interface was down returns that error even after the interface is
    /// up.
    pub fn is_down(&self) -> bool {
        !Interface::query(&self.interface).is_ok_and(|found| found.is_up)
    }

    /// Passes an SDO frame to the task that has requested an SDO transfer. The frame is the answer of the
    /// node, or the task's request, which the socket receives back after it was sent on the bus.
    pub fn passed(&self, frame: &Frame) {
        if let Some(passing) = &self.inner().passing {
            // If the queue is full, no requester waits for this frame.
            let _ = passing.try_send(*frame);
        }
    }

    /// Returns how many frames the gateway could not send since its start, because the send queue was full.
    pub fn full(&self) -> u64 {
        let inner = self.inner();
        inner.full + inner.socket.as_ref().map_or(0, |socket| socket.full())
    }

    /// Returns how many received frames the kernel has dropped since the start of the gateway, because the gateway did
    /// not read them fast enough.
    pub fn lost(&self) -> u64 {
        let inner = self.inner();
        inner.lost + inner.socket.as_ref().map_or(0, |socket| socket.lost())
    }

    /// Registers the caller as the requester of SDO transfers, in place of the previous requester. Returns the queue
    /// from which the caller receives the SDO frames.
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

    /// Locks the state. The lock is also used after another thread has panicked, because the state stays consistent.
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    /// Adds the counters of the present socket to the sums of the closed sockets. Does nothing if `kept` is the present
    /// socket.
    fn give_up(&mut self, kept: Option<&Arc<Socket>>) {
        let is_kept = |socket: &&Arc<Socket>| kept.is_some_and(|kept| Arc::ptr_eq(kept, socket));
        if let Some(socket) = self.socket.as_ref().filter(|socket| !is_kept(socket)) {
            self.full += socket.full();
            self.lost += socket.lost();
        }
    }
}

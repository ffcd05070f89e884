//! What belongs to one interface while the gateway lives: its socket, which may come and go, and what outlives that.
//!
//! One task hears ([`Link::socket`]) and hands the frames of SDO on ([`Link::passed`]); the line asks and writes
//! through [`super::wire`].

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::mpsc;

use super::image::Images;
use super::interface::Interface;
use super::socket::Socket;
use crate::fieldbus::canopen::NodeId;
use crate::fieldbus::canopen::sdo::Client;
use crate::fieldbus::error::{CanFault, Fault, LinkFault};
use isotherm_core::codec::{CanMatch, Frame};

/// Frames of SDO that wait; a node has one answer under way.
const UNREAD: usize = 64;

/// One interface.
#[derive(Debug)]
pub struct Link {
    interface: String,
    wanted: Vec<CanMatch>,
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    socket: Option<Arc<Socket>>,
    /// Why nothing can be sent now.
    fault: Option<Fault>,
    passing: Option<mpsc::Sender<Frame>>,
    clients: BTreeMap<NodeId, Client>,
    images: Images,
    /// Of sockets that are no more.
    full: u64,
    lost: u64,
}

impl Link {
    /// The interface of this name, not opened yet: the frames that are wanted, and those that are written.
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

    /// Its name.
    pub fn interface(&self) -> &str {
        &self.interface
    }

    /// Opens a socket where there is none, and looks whether the interface is up.
    ///
    /// # Errors
    /// Why nothing can be sent or heard now.
    pub fn open(&self) -> Result<Arc<Socket>, Fault> {
        let mut inner = self.inner();
        let opened = match &inner.socket {
            Some(socket) => Ok(socket.clone()),
            None => Socket::open(&self.interface, &self.wanted).and_then(Socket::hears_itself).map(Arc::new),
        };
        let found = Interface::look(&self.interface).map_err(|fault| Fault::Link(LinkFault::Can(fault)));
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

    /// The socket, also of an interface that is down.
    pub fn socket(&self) -> Option<Arc<Socket>> {
        self.inner().socket.clone()
    }

    /// Why nothing can be sent now.
    pub fn fault(&self) -> Option<Fault> {
        self.inner().fault
    }

    /// What a call to the socket failed with. One whose interface is gone is given up.
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

    /// The interface went down, says the socket: whether it is so still. Opening one that is down leaves such a word behind,
    /// which comes when it has long been up.
    pub fn is_down(&self) -> bool {
        !Interface::look(&self.interface).is_ok_and(|found| found.is_up)
    }

    /// Hands a frame of SDO to whoever asks: an answer, or a question of ours that has passed itself.
    pub fn passed(&self, frame: &Frame) {
        if let Some(passing) = &self.inner().passing {
            // One that nobody takes is none that anybody waits for.
            let _ = passing.try_send(*frame);
        }
    }

    /// How often a frame found the queue full, since the beginning.
    pub fn full(&self) -> u64 {
        let inner = self.inner();
        inner.full + inner.socket.as_ref().map_or(0, |socket| socket.full())
    }

    /// Frames lost because they were not taken fast enough, since the beginning.
    pub fn lost(&self) -> u64 {
        let inner = self.inner();
        inner.lost + inner.socket.as_ref().map_or(0, |socket| socket.lost())
    }

    /// Whoever asks from now on.
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

    /// Nothing behind this lock is left half done by a panic.
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Inner {
    /// Keeps the counts of a socket that is not to be kept.
    fn give_up(&mut self, kept: Option<&Arc<Socket>>) {
        let is_kept = |socket: &&Arc<Socket>| kept.is_some_and(|kept| Arc::ptr_eq(kept, socket));
        if let Some(socket) = self.socket.as_ref().filter(|socket| !is_kept(socket)) {
            self.full += socket.full();
            self.lost += socket.lost();
        }
    }
}

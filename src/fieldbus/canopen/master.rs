//! The master of an interface: its nodes are started after every boot-up and missed when they fall silent, and SYNC is
//! sent in its time.
//!
//! A node that resets falls back to pre-operational and sends nothing until it is started again; and one that was never
//! heard of is as lost as one that is heard of no more. A node that somebody else has stopped is not fought for.
//!
//! Give every frame of [`Master::identifiers`] to [`Master::take`], and call [`Master::tick`] at once and whenever
//! [`Master::due`] has come.

use std::fmt;
use std::time::Duration;

use super::NodeId;
use super::emergency::{self, Emergency};
use super::node::{self, HEARTBEAT, NodeState};
use isotherm_core::codec::{CanId, Frame};
use isotherm_core::quantity::Moment;
use isotherm_profile::Sync;
use isotherm_profile::duration_text;

/// How a node is led.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Care {
    /// Lost when nothing has been heard of it for so long; `None`: it is not missed.
    pub heartbeat: Option<Duration>,
    /// When it is started.
    pub start: Start,
}

/// When a node is started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// Never: it starts by itself, or another master starts it.
    Never,
    /// At the beginning and after every boot-up.
    AtOnce,
    /// Likewise, but not before its setup list is written: whenever [`Master::set_up`] is called.
    WhenSetUp,
}

/// What the master does, in its order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// A frame to be sent.
    Send(Frame),
    /// Something to be told.
    Tell(NodeId, NodeEvent),
}

/// What happens to a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeEvent {
    /// It has come up. Whatever was set up in it is as after power-on.
    BootedUp {
        /// It was heard of before: it has been reset.
        again: bool,
    },
    /// It was operational, and has gone back to pre-operational by itself.
    FellBack,
    /// Somebody has stopped it.
    Stopped,
    /// Nothing was heard of it for so long.
    Lost {
        /// Not since the beginning either.
        never_seen: bool,
        /// The patience that is at an end.
        after: Duration,
    },
    /// It was lost and is heard of again.
    Back {
        /// For so long.
        after: Duration,
    },
    /// It complains of something.
    Emergency(Emergency),
}

/// The nodes of an interface.
#[derive(Clone, Debug)]
pub struct Master {
    nodes: Vec<Node>,
    sync: Option<(Sync, Moment)>,
}

#[derive(Clone, Debug)]
struct Node {
    id: NodeId,
    care: Care,
    state: Option<NodeState>,
    /// When it was heard of last; before the first time, when listening began.
    heard: Moment,
    was_heard: bool,
    is_lost: bool,
    /// It was told to start since its last boot-up.
    is_started: bool,
}

impl Master {
    /// A master that begins to listen now.
    pub fn new(nodes: impl IntoIterator<Item = (NodeId, Care)>, sync: Option<Sync>, now: Moment) -> Master {
        let nodes = nodes.into_iter().map(|(id, care)| Node {
            id,
            care,
            state: None,
            heard: now,
            was_heard: false,
            is_lost: false,
            is_started: false,
        });
        Master { nodes: nodes.collect(), sync: sync.map(|sync| (sync, now)) }
    }

    /// What it has to hear: the heartbeats and the emergencies of its nodes.
    pub fn identifiers(&self) -> impl Iterator<Item = CanId> {
        let both = |node: &Node| [node.id.identifier(emergency::SERVICE), node.id.identifier(HEARTBEAT)];
        self.nodes.iter().flat_map(both)
    }

    /// Nothing was heard of it within its patience.
    pub fn is_lost(&self, id: NodeId) -> bool {
        self.nodes.iter().any(|node| node.id == id && node.is_lost)
    }

    /// Takes a frame; one that is none of its own changes nothing.
    pub fn take(&mut self, frame: &Frame, now: Moment, outputs: &mut Vec<Output>) {
        if let Some((id, state)) = NodeState::of(frame) {
            self.with(id, |node| {
                node.is_heard(now, outputs);
                node.is_in(state, outputs);
            });
        } else if let Some((id, emergency)) = Emergency::of(frame) {
            self.with(id, |_| outputs.push(Output::Tell(id, NodeEvent::Emergency(emergency))));
        }
    }

    /// Lets time pass: starts the nodes, misses those that are silent, sends SYNC.
    pub fn tick(&mut self, now: Moment, outputs: &mut Vec<Output>) {
        for node in &mut self.nodes {
            if node.care.start == Start::AtOnce && !node.is_started {
                node.start(outputs);
            }
            if let (Some(due), Some(after)) = (node.due(), node.care.heartbeat)
                && due <= now
            {
                node.is_lost = true;
                node.state = None;
                let never_seen = !node.was_heard;
                outputs.push(Output::Tell(node.id, NodeEvent::Lost { never_seen, after }));
            }
        }
        if let Some((sync, due)) = &mut self.sync
            && *due <= now
        {
            outputs.push(Output::Send(Frame::short(sync.id, [])));
            *due = now.next_tick(*due, sync.every);
        }
    }

    /// When it has something to do at the latest.
    pub fn due(&self) -> Option<Moment> {
        let sync = self.sync.map(|(_, due)| due);
        self.nodes.iter().filter_map(Node::due).chain(sync).min()
    }

    /// The setup list of a node is written: it is started.
    pub fn set_up(&mut self, id: NodeId, outputs: &mut Vec<Output>) {
        self.with(id, |node| {
            if node.care.start == Start::WhenSetUp {
                node.start(outputs);
            }
        });
    }

    fn with(&mut self, id: NodeId, act: impl FnOnce(&mut Node)) {
        if let Some(node) = self.nodes.iter_mut().find(|node| node.id == id) {
            act(node);
        }
    }
}

impl Node {
    fn due(&self) -> Option<Moment> {
        let patience = self.care.heartbeat.filter(|_| !self.is_lost)?;
        Some(self.heard.after(patience))
    }

    fn is_heard(&mut self, now: Moment, outputs: &mut Vec<Output>) {
        if std::mem::take(&mut self.is_lost) {
            let after = now.since(self.heard);
            outputs.push(Output::Tell(self.id, NodeEvent::Back { after }));
        }
        self.heard = now;
    }

    fn is_in(&mut self, state: NodeState, outputs: &mut Vec<Output>) {
        let before = self.state.replace(state);
        let again = std::mem::replace(&mut self.was_heard, true);
        match state {
            NodeState::BootedUp => {
                self.is_started = false;
                outputs.push(Output::Tell(self.id, NodeEvent::BootedUp { again }));
                self.start_at_once(outputs);
            }
            NodeState::PreOperational if before == Some(NodeState::Operational) => {
                self.is_started = false;
                outputs.push(Output::Tell(self.id, NodeEvent::FellBack));
                self.start_at_once(outputs);
            }
            // The command to start was lost, or came while the node was not listening.
            NodeState::PreOperational if self.is_started => self.start(outputs),
            NodeState::Stopped if before != Some(NodeState::Stopped) => {
                outputs.push(Output::Tell(self.id, NodeEvent::Stopped));
            }
            _ => {}
        }
    }

    fn start_at_once(&mut self, outputs: &mut Vec<Output>) {
        if self.care.start == Start::AtOnce {
            self.start(outputs);
        }
    }

    fn start(&mut self, outputs: &mut Vec<Output>) {
        self.is_started = true;
        outputs.push(Output::Send(node::start(self.id)));
    }
}

impl fmt::Display for NodeEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NodeEvent::BootedUp { again: false } => write!(f, "has booted up"),
            NodeEvent::BootedUp { again: true } => write!(f, "was reset: it has booted up again"),
            NodeEvent::FellBack => write!(f, "has gone back to pre-operational by itself"),
            NodeEvent::Stopped => write!(f, "was stopped by somebody else"),
            NodeEvent::Lost { never_seen: true, after } => {
                write!(f, "was never heard of: no heartbeat for {}", duration_text(*after))
            }
            NodeEvent::Lost { never_seen: false, after } => {
                write!(f, "is silent: no heartbeat for {}", duration_text(*after))
            }
            NodeEvent::Back { after } => {
                write!(f, "is heard of again after {:.1} s", after.as_secs_f64())
            }
            NodeEvent::Emergency(emergency) => write!(f, "emergency {emergency}"),
        }
    }
}

//! Master of a CANopen interface. The master starts its nodes after every boot-up, detects missing heartbeats, and
//! sends SYNC (the message that triggers process data).
//!
//! A node that resets returns to the pre-operational state, and sends no process data before the master starts it
//! again. A node that was never detected counts as lost, just as a node whose heartbeat stopped. The master does not
//! restart a node that another master has stopped.
//!
//! The caller passes every frame of [`Master::identifiers`] to [`Master::take`]. It calls [`Master::tick`] at once
//! after creation, and then each time that [`Master::due`] is reached.

use std::fmt;
use std::time::Duration;

use super::NodeId;
use super::emergency::{self, Emergency};
use super::node::{self, HEARTBEAT, NodeState};
use isotherm_core::codec::{CanId, Frame};
use isotherm_core::quantity::Moment;
use isotherm_profile::Sync;
use isotherm_profile::duration_text;

/// Supervision settings of a node: its heartbeat timeout, and the condition on which the master starts the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervision {
    /// Heartbeat timeout, after which the node counts as lost; `None`: its heartbeat is not supervised.
    pub heartbeat: Option<Duration>,
    /// Condition on which the master starts the node.
    pub start: Start,
}

/// Condition on which the master starts a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The master never starts the node: the node starts by itself, or another master starts it.
    Never,
    /// The master starts the node when the master itself begins, and after every boot-up of the node.
    AtOnce,
    /// The master starts the node after its setup list (start values of its objects) was written, that is, after each
    /// call of [`Master::set_up`].
    WhenSetUp,
}

/// Result of the master for its caller: a frame to send, or an event. The caller must keep the order of the results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// Frame to send on the bus.
    Send(Frame),
    /// Event of this node, which the caller reports to the user.
    Tell(NodeId, NodeEvent),
}

/// Event of a node, for example a boot-up or a missing heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeEvent {
    /// The node has booted. Its objects now have the values that they have after power-on.
    BootedUp {
        /// Whether the master has received a heartbeat or boot-up of the node before. If so, the node was reset.
        again: bool,
    },
    /// The node was operational, and returned to pre-operational by itself.
    FellBack,
    /// Another master has stopped the node.
    Stopped,
    /// No heartbeat arrived within the timeout.
    Lost {
        /// Whether no heartbeat has arrived since the master began to listen.
        never_seen: bool,
        /// Length of the timeout that has expired.
        after: Duration,
    },
    /// The heartbeat of a lost node is present again.
    Back {
        /// Time during which no heartbeat arrived.
        after: Duration,
    },
    /// The node sent an emergency message.
    Emergency(Emergency),
}

/// CANopen master that supervises the nodes of one interface.
#[derive(Clone, Debug)]
pub struct Master {
    nodes: Vec<Node>,
    sync: Option<(Sync, Moment)>,
}

#[derive(Clone, Debug)]
struct Node {
    id: NodeId,
    care: Supervision,
    state: Option<NodeState>,
    /// Time of the last heartbeat. Before the first heartbeat, this is the time at which the master began to listen.
    received: Moment,
    was_heard: bool,
    is_lost: bool,
    /// Whether the master has sent a start command since the last boot-up of the node.
    is_started: bool,
}

impl Master {
    /// Returns a master of these nodes that begins to listen at `now`.
    pub fn new(
        nodes: impl IntoIterator<Item = (NodeId, Supervision)>,
        sync: Option<Sync>,
        now: Moment,
    ) -> Master {
        let nodes = nodes.into_iter().map(|(id, care)| Node {
            id,
            care,
            state: None,
            received: now,
            was_heard: false,
            is_lost: false,
            is_started: false,
        });
        Master { nodes: nodes.collect(), sync: sync.map(|sync| (sync, now)) }
    }

    /// Returns the CAN identifiers of the frames to receive: heartbeats and emergency messages of the nodes.
    pub fn identifiers(&self) -> impl Iterator<Item = CanId> {
        let both = |node: &Node| [node.id.identifier(emergency::SERVICE), node.id.identifier(HEARTBEAT)];
        self.nodes.iter().flat_map(both)
    }

    /// Returns whether the heartbeat timeout of a node has expired.
    pub fn is_lost(&self, id: NodeId) -> bool {
        self.nodes.iter().any(|node| node.id == id && node.is_lost)
    }

    /// Processes a received frame, and adds the resulting frames and events to `outputs`. Frames of other nodes or
    /// services change nothing.
    pub fn take(&mut self, frame: &Frame, now: Moment, outputs: &mut Vec<Output>) {
        if let Some((id, state)) = NodeState::of(frame) {
            self.with(id, |node| {
                node.is_received(now, outputs);
                node.is_in(state, outputs);
            });
        } else if let Some((id, emergency)) = Emergency::of(frame) {
            self.with(id, |_| outputs.push(Output::Tell(id, NodeEvent::Emergency(emergency))));
        }
    }

    /// Does the work that is due at `now`: starts nodes, checks heartbeat timeouts, sends SYNC. Adds the frames and
    /// events to `outputs`.
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

    /// Returns the latest moment at which [`Master::tick`] must be called; `None` if no call is necessary.
    pub fn due(&self) -> Option<Moment> {
        let sync = self.sync.map(|(_, due)| due);
        self.nodes.iter().filter_map(Node::due).chain(sync).min()
    }

    /// Records that the setup list of a node was written. The master then starts the node, if its start condition is
    /// [`Start::WhenSetUp`].
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
        Some(self.received.after(patience))
    }

    fn is_received(&mut self, now: Moment, outputs: &mut Vec<Output>) {
        if std::mem::take(&mut self.is_lost) {
            let after = now.since(self.received);
            outputs.push(Output::Tell(self.id, NodeEvent::Back { after }));
        }
        self.received = now;
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
            // The start command was lost, or the node was not ready to receive it.
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
            NodeEvent::Stopped => write!(f, "was stopped, but not by this gateway"),
            NodeEvent::Lost { never_seen: true, after } => {
                write!(f, "was never seen: no heartbeat for {}", duration_text(*after))
            }
            NodeEvent::Lost { never_seen: false, after } => {
                write!(f, "is silent: no heartbeat for {}", duration_text(*after))
            }
            NodeEvent::Back { after } => {
                write!(f, "is back after {:.1} s", after.as_secs_f64())
            }
            NodeEvent::Emergency(emergency) => write!(f, "emergency {emergency}"),
        }
    }
}

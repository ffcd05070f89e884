//! Second pure step: from a decision and the register value to the next exchange. Pure: no I/O, no clock, no allocation
//! in a step.
//!
//! [`step`] decides every write to an offset register. The line, the device, the operator or the clock may fail, and
//! the process may be killed. Even then the register never moves by more than one step, and never beyond its limit. The
//! operator offset never changes. All values are whole counts of the register.
//!
//! # Theory of operation
//! A write without an answer may have been carried out, may still be carried out, or never will be. The knowledge about
//! a register is therefore not one value. It is the last value read, and **every copy of a value that may still
//! arrive** ([`InFlightWrites`]). A value is sent only directly after a read that showed nothing new. The value must be
//! at most one step from the value read and from each of these copies. Whichever copy arrives, the register then moves
//! by one step at most. If no such value is nearer to the requested one, the change waits until the copies can no
//! longer arrive.
//!
//! A value that appears in the register is the gateway's only if it was under way. The register value is repeated
//! (`refresh`) under the same rule, and never while a change waits. One decision moves the register once, by one step
//! at most. The rate of the changes is decided by the axis.
//!
//! ```text
//!            change requested        nothing new             (shared) promise kept
//!   Nothing ──────────────► Read ──────────────► Keep ──────────────► Read ─────► Write
//!      ▲                     │ ▲                                                    │
//!      │  nothing to be done │ └────────── done · unknown: read the register again ─┤
//!      └─────────────────────┴──────────────────────────────── refused · not sent ──┘
//! ```
//!
//! A decision has the offset, and the **target** that the offset approaches. The target is the value that the model,
//! the fault action, the stop or the sign check requests. A value that is sent lies between the verified value and the
//! target. The guard may have continued while the register waited, but the register still never moves away from the
//! target. One count beyond the target is sent only if the target itself is a zero that must be avoided.
//!
//! A **shared** register holds the sum of the operator offset (base) and the gateway share. Before a value is sent, it
//! is on disk as a promise, as the absolute register value. The register is then read once more to detect an edit in
//! between. Whenever the process dies, the register holds base + share, one of the promises, or a value of the
//! operator.
//!
//! For an output that **cannot be read**, only the answers of the device are known. The last acknowledged value
//! replaces the last value read. Copies without an answer end when a later write, begun after their time, is
//! acknowledged. For this purpose the last acknowledged value is sent again.
//!
//! An output **in a set** is sent in one request with others. When one of them or the heartbeat is written, the
//! register values of the others are sent with it, in every state ([`Fact::PiggybackAsked`]). Such a value is a copy
//! under way like any other.
//!
//! # Meaning of a read
//! The value read is compared with the last value that was answered as done, or else with the last verified one.
//!
//! | the read shows | whole register | shared register |
//! |---|---|---|
//! | the same | nothing new | nothing new |
//! | the same, after another client has made as many small changes as the gateway, each soon after one of its own | | doubt: a second gateway |
//! | the value before a write that was answered as done | not taken: tried again | not taken: tried again |
//! | a value under way | gateway's; returned step by step | gateway's: the share changes; zero with a base, or more than the limit from it: doubt |
//! | a value whose time is over | gateway's, very late | doubt: the operator's or the gateway's |
//! | zero | CNC restarted: resumes from zero | CNC restarted: base 0, share 0 |
//! | anything else | another client wrote: off | the operator's change: the base moves by it |
//! | anything else, and a write of the gateway may have arrived unseen before | | doubt |
//! | anything else within `late` after a start without an orderly stop | perhaps the gateway's: resumes from it | doubt, if a promise was open |
//! | anything else, after a reported restart of the CNC | resumes from it, if within the limit | doubt, if the register contained a share |
//! | anything, while in doubt | | nothing: the operator decides |
//!
//! A doubt disarms the output until the operator arms it again. The gateway shows the register value, and the share
//! that it assumes. The operator corrects the register and arms. The gateway then reads the register once more. If the
//! value is still the one that was shown, the rest of it is the operator offset.
//!
//! # Effect of each fact
//! | fact | pending write | decision |
//! |---|---|---|
//! | `Done` | is under way until a read shows it | was dropped when the write was requested |
//! | `Unknown` | is under way until a pair of reads or time ends it | is dropped |
//! | `Refused`, `NotSent` | ends | is dropped |
//! | `NoAnswer`, `Paused`, `Interlocked`, `Restarted`, `Off` | | is dropped |
//! | a wait for copies that may still arrive | | is dropped |

use serde::{Deserialize, Serialize};

use crate::quantity::{Counts, Moment, Shift, Shifted};

mod applied;
mod controller;
mod demand;
mod event;
mod facts;
mod follow;
mod handshake;
mod heartbeat;
mod in_flight;
mod interpretation;
mod numbers;
mod plan;
mod position;
mod position_cz;
mod reports;
mod saved_output;
mod sequence;
mod set;
mod set_controller;
mod set_members;
mod set_phase;
mod settings;
mod slots;
mod state;
mod state_parts;
mod strobe;
mod transaction;
mod turns;

pub use controller::{Controller, MOST_EVENTS, Policy};
pub use demand::{Condition, Demand, Input, Mode, NotSent, OutputDecision, SetCommit};
pub use event::{Doubt, Event};
pub use follow::{Cause, Follow, OutputHealth, Trouble};
pub use handshake::HandshakeFault;
pub use heartbeat::{Beat, HeartbeatController};
pub use in_flight::{
    ExpiredWrite, InFlightWrite, InFlightWrites, MOST_REMEMBERED, MOST_UNDER_WAY, SendRange,
};
pub use position::{
    PositionAction, PositionController, PositionDecision, PositionDemand, PositionEvent, PositionResult,
    PositionTurn,
};
pub use position_cz::{PositionCz, farthest_behind};
pub use saved_output::{Account, Promise, SavedOutput};
pub use set::{
    ControlWord, MemberDemand, OutputAnswer, OwnWords, SetAction, SetDemand, SetInput, SetSettings, SetValue,
    SetWords, StandaloneWrite, StrobeResult, WriteResult,
};
pub use set_controller::SetController;
pub use settings::{AppliedSettings, Rule, Rules, Settings, Verify};
pub use slots::Slots;
pub use state::State;
pub use state_parts::{ArmState, OutputView, TimedValue};
pub use strobe::{Awaited, Strobe, StrobeLevel};
pub use transaction::CommitTrigger;

/// Input of [`step`]: something that has happened to the register, its axis or its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fact {
    /// Call at the requested time, without a new event.
    Look,
    /// New decision of the axis.
    Decided {
        /// Counts from the bias; in a shared register the gateway share.
        offset: Counts,
        /// Target of the offset within the limit: the value that the model, the fault action, the stop or the sign
        /// check requests. If it is `None`, the register may reach the offset from either side.
        target: Option<Counts>,
        /// Last moment for a change to this offset.
        not_after: Moment,
    },
    /// Another value of the same request is about to be sent. The register value may be sent with that value.
    PiggybackAsked,
    /// The register value, as it was just read, was sent in one request with others.
    Piggybacked {
        /// Value that was sent.
        value: Counts,
        /// Time after the last byte of the request was sent.
        left: Moment,
        /// Whether the request was answered as done. If not, the result of the request is unknown.
        is_done: bool,
    },
    /// The register was read, on request or together with others.
    Read {
        /// Register value that was read.
        found: Counts,
        /// Time before the first byte of the request was sent.
        asked: Moment,
    },
    /// The read was not answered.
    NoAnswer,
    /// The write was answered as done.
    Done {
        /// Time after the last byte of the request was sent.
        left: Moment,
    },
    /// The write was sent, but its result is unknown.
    Unknown {
        /// Time after the last byte of the request was sent.
        left: Moment,
    },
    /// The device answered that it did not carry out the write.
    Refused,
    /// No byte of the write was sent: the last moment for the write had passed, or there was no connection.
    NotSent,
    /// The document was written to disk.
    Kept,
    /// The document was not written to disk, or that is unknown.
    NotKept,
    /// Another source reported a restart of the CNC.
    Restarted,
    /// The interlock opened. Nothing is written.
    Interlocked,
    /// The interlock closed again.
    Released,
    /// The output is armed. Give this fact after the first read of the register.
    Armed {
        /// Whether the operator or the profile has armed the output.
        by: Who,
    },
    /// The output is disarmed. The register value stays.
    Off,
    /// The decision is void: the last moment for sending it has passed, or the axis has made another decision.
    Lapsed,
    /// The computer was paused, and earlier decisions are void. This fact comes before the result of a pending
    /// exchange.
    Paused,
}

/// Who armed the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Who {
    /// The operator, who has seen the register value.
    Person,
    /// The profile. It cannot arm an output that waits for the operator.
    Policy,
}

/// Next action: at most one exchange. The result of the exchange is the next fact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// Nothing until a fact arrives, or until this moment.
    Nothing {
        /// Time of the next [`Fact::Look`].
        until: Moment,
    },
    /// Read the register. [`Fact::Read`] or [`Fact::NoAnswer`] is the result.
    Read,
    /// Write [`State::kept`] to disk.
    Keep,
    /// Write to the register.
    Write {
        /// Value to write to the register.
        value: Counts,
        /// Last moment for the first byte. After that moment, the write is not sent.
        not_after: Moment,
        /// Whether the register already holds the value.
        is_repeat: bool,
    },
}

impl Default for Action {
    fn default() -> Action {
        Action::Nothing { until: Moment::default() }
    }
}

impl Action {
    /// Returns a copy in which `to` is applied to the moment of the action.
    fn moved(self, to: impl Fn(Moment) -> Moment) -> Action {
        match self {
            Action::Nothing { until } => Action::Nothing { until: to(until) },
            Action::Write { value, not_after, is_repeat } => {
                Action::Write { value, not_after: to(not_after), is_repeat }
            }
            Action::Read | Action::Keep => self,
        }
    }
}

impl Shifted for Action {
    fn shift(&mut self, by: Shift) {
        *self = self.moved(|moment| moment.shifted(by));
    }
}

/// Processes a fact and returns the next action. While an action is pending, the result is [`Action::Nothing`].
pub fn step(state: &mut State, settings: &Settings, fact: Fact, now: Moment) -> Action {
    let fresh = facts::take(state, settings, fact, now);
    match fact {
        Fact::PiggybackAsked => plan::piggyback(state, settings, now),
        _ => plan::act(state, settings, fresh, now),
    }
}

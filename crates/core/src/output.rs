//! From a decision and what the register said to the next exchange. Pure: no I/O, no clock, no allocation in a step.
//!
//! [`step`] is what stands between a decision and a register. Whatever the link, the device, an operator, the clock or a
//! kill does in between, the register is never moved by more than one step, never beyond its limit, and what belongs to
//! an operator stays his. Numbers are whole counts of the register here.
//!
//! # Theory of operation
//! A write whose answer did not come may have been carried out, may still be, or never will. So what is known of a
//! register is not one value, but what the last read showed and **every copy of a value that may still arrive**
//! ([`Copies`]). A value is sent only directly after a read that showed nothing new, and only if it is at most one step
//! from what that read showed and from each of these copies: then whatever arrives when, the register moves by one step
//! at most. Where no such value is nearer to what is wanted, the change waits until the copies cannot arrive any more.
//! What appears in the register and was under way is ours; nothing else is. What stands there is sent again
//! (`refresh`) under the same rule, and never while a change waits. One decision moves the register once, by one step at
//! most: how fast it goes is decided elsewhere.
//!
//! ```text
//!            change wanted           nothing new             (shared) promise kept
//!   Nothing ──────────────► Read ──────────────► Keep ──────────────► Read ─────► Write
//!      ▲                     │ ▲                                                    │
//!      │  nothing to be done │ └──────────── done · unknown: what stands there? ────┤
//!      └─────────────────────┴──────────────────────────────── refused · not sent ──┘
//! ```
//!
//! A decision has the **target** that its offset is on its way to: what the model, the fault action, the stop or the sign check
//! requests. A value that is sent lies between the verified value and the target, so that a guard that went on while the register
//! waited never moves it away from the target. One count beyond is sent only if the target itself is a zero that is avoided.
//!
//! A **shared** register holds the operator's part (base) and ours (share), and shows only the sum. Before a value is
//! sent it is on disk as a promise, absolute as the register would hold it; after that the register is read once more, so
//! that an edit in between is seen. Whenever the process dies, what stands in the register is base + share, or one of the
//! promises, or an operator's work.
//!
//! An output that **cannot be read** has nothing but the device's answers: what was acknowledged last takes the place of
//! what was read last. Copies that nobody answered are over when a write that was begun after their time was
//! acknowledged; what was acknowledged last is sent again for that.
//!
//! An output **in a set** leaves in one request with others. When one of those is to be written, or the heartbeat beside
//! them, what stands there goes along ([`Fact::GoesAlong`]) in every state, as it was just read; it is a copy under way
//! like any other.
//!
//! # What a read means
//! It is compared with what was answered as done last, else with what was verified last.
//!
//! | it shows | whole register | shared register |
//! |---|---|---|
//! | the same | nothing new | nothing new |
//! | the same, after somebody else has made as many small changes as we, each soon after ours | | doubt: a second gateway |
//! | what stood before a write that was answered as done | not taken: tried again | not taken: tried again |
//! | a value under way | ours; walked back step by step | ours: the share changes; zero with a base, or more than the limit from it: doubt |
//! | a value lately sent | ours, very late | doubt: the operator's, or ours |
//! | zero | CNC restarted: from there on | CNC restarted: base 0, share 0 |
//! | anything else | somebody else wrote: off | the operator's change: the base moves by it |
//! | anything else, and a write of ours may have arrived unseen before it | | doubt |
//! | anything else within `late` of a start that follows no orderly stop | perhaps ours: from there on | doubt, if a promise was open |
//! | anything else, after the CNC was said to have restarted | from there on, if it is within the limit | doubt, if anything of ours was in it |
//! | anything at all, while in doubt | | nothing: a person decides |
//!
//! Doubt switches off until a person arms. He is shown what stands there and what of it is taken to be ours; when he has
//! made that right, the register is read once more, and if it still holds what he saw, the rest is the operator's part.
//!
//! # What ends what
//! | fact | the write that was asked for | the decision |
//! |---|---|---|
//! | `Done` | is under way until a read shows it | was dropped when it was asked for |
//! | `Unknown` | is under way until a read pair or time ends it | is dropped |
//! | `Refused`, `NotSent` | is none | is dropped |
//! | `NoAnswer`, `Paused`, `Interlocked`, `Restarted`, `Off` | | is dropped |
//! | a wait for what may still arrive | | is dropped |

use serde::{Deserialize, Serialize};

use crate::quantity::{Counts, Moment, Shift, Shifted};

mod applied;
mod controller;
mod copies;
mod demand;
mod event;
mod facts;
mod follow;
mod handshake;
mod heartbeat;
mod inside;
mod judge;
mod kept;
mod numbers;
mod plan;
mod position;
mod reports;
mod sequence;
mod set;
mod set_controller;
mod set_members;
mod set_phase;
mod settings;
mod slots;
mod standing;
mod state;
mod strobe;
mod transaction;
mod turns;

pub use controller::{Controller, MOST_EVENTS, Policy};
pub use copies::{Copies, LatelySent, MOST_REMEMBERED, MOST_UNDER_WAY, Room, Sent};
pub use demand::{Condition, Demand, Demanded, Input, Mode, NotSent, SetCommit};
pub use event::{Doubt, Event};
pub use follow::{Cause, Follow, OutputHealth, Trouble};
pub use handshake::HandshakeFault;
pub use heartbeat::{Beat, HeartbeatController};
pub use inside::{Inside, farthest_behind};
pub use kept::{Account, Kept, Promise};
pub use position::{
    PositionAction, PositionController, PositionDecision, PositionDemand, PositionEvent, PositionResult,
    PositionTurn,
};
pub use set::{
    Alone, ControlWord, MemberDemand, OutputAnswer, OwnWords, SetAction, SetDemand, SetInput, SetSettings,
    SetValue, SetWords, StrobeResult, WriteResult,
};
pub use set_controller::SetController;
pub use settings::{AppliedSettings, Rules, Settings, Verify};
pub use slots::Slots;
pub use standing::{ArmState, Seen, Shown};
pub use state::State;
pub use strobe::{Awaited, Strobe, StrobeLevel};
pub use transaction::Taking;

/// What has happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Fact {
    /// Nothing: the moment has come at which it wanted to be asked again.
    Look,
    /// What is wanted.
    Decided {
        /// Counts from the bias; of a shared register our share.
        offset: Counts,
        /// Target of the offset within the limit: the value that the model, the fault action, the stop or the sign check requests.
        /// `None` if the target is not known: then the register may reach the offset from either side.
        target: Option<Counts>,
        /// A change to it may be sent until then.
        not_after: Moment,
    },
    /// What shares a request with it is about to leave: what stands there goes along.
    GoesAlong,
    /// What stood there, whatever it was, went along in one request with others.
    WentAlong {
        /// What that was.
        value: Counts,
        /// When it had left: looked at after its last byte.
        left: Moment,
        /// It was answered as done; else nobody knows.
        is_done: bool,
    },
    /// The register was read, because that was asked for or in one with others.
    Read {
        /// What stands there.
        found: Counts,
        /// When the question was sent: looked at before its first byte.
        asked: Moment,
    },
    /// The read was not answered.
    NoAnswer,
    /// The write was answered as done.
    Done {
        /// When it had left: looked at after its last byte.
        left: Moment,
    },
    /// Whether the write was carried out is not known.
    Unknown {
        /// When it had left: looked at after its last byte.
        left: Moment,
    },
    /// The device says that it did not carry the write out.
    Refused,
    /// Nothing of the write has left: its moment was over, or there was no connection.
    NotSent,
    /// What was to be kept is on disk.
    Kept,
    /// It is not, or nobody knows.
    NotKept,
    /// Something else than the register says that the CNC was restarted.
    Restarted,
    /// Its interlock opened: nothing is written.
    Interlocked,
    /// Its interlock closed again.
    Released,
    /// It may be written from now on. Give it after the register was read for the first time.
    Armed {
        /// Who says so.
        by: Who,
    },
    /// It is not written any more; what stands there stays.
    Off,
    /// The decision is not sent: its last moment has passed, or the axis decided otherwise.
    Lapsed,
    /// The computer stood still: nothing from before counts. It comes before the end of an exchange that was asked for.
    Paused,
}

/// Who arms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Who {
    /// A person, who has seen what stands there.
    Person,
    /// The profile: not where a person has to decide something.
    Policy,
}

/// What is to be done next: at most one exchange, whose end is the next fact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// Nothing, until a fact comes or this moment.
    Nothing {
        /// Then it wants a [`Fact::Look`].
        until: Moment,
    },
    /// Read the register.
    Read,
    /// Put [`State::kept`] on disk.
    Keep,
    /// Write to the register.
    Write {
        /// What it shall hold.
        value: Counts,
        /// Its first byte may leave until then; else it is not sent.
        not_after: Moment,
        /// It is what stands there already.
        is_repeat: bool,
    },
}

impl Default for Action {
    fn default() -> Action {
        Action::Nothing { until: Moment::default() }
    }
}

impl Action {
    /// Moves its moment by `to`.
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

/// Takes a fact in and says what to do next. While what was asked for is under way, that is nothing.
pub fn step(state: &mut State, settings: &Settings, fact: Fact, now: Moment) -> Action {
    let fresh = facts::take(state, settings, fact, now);
    match fact {
        Fact::GoesAlong => plan::go_along(state, settings, now),
        _ => plan::act(state, settings, fresh, now),
    }
}

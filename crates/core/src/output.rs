//! Outputs: from the decision of an axis and the value of its register, [`step`] chooses the next exchange with the
//! device. The step is pure: no I/O, no clock, no memory allocation.
//!
//! [`step`] decides every write to an offset register. The bus line, the device, the operator or the clock may fail,
//! and the process may be killed. Even then the register never moves by more than one step at a time, and never beyond
//! its limit. The gateway never changes the operator offset, which is the operator's part of a shared register. All
//! values are whole counts of the register.
//!
//! # Theory of operation
//! A write without an answer may have been carried out, may still be carried out, or never will be. The
//! gateway therefore does not keep a single value for a register. It keeps the last value read, and **every
//! copy of a value that may still arrive** ([`InFlightWrites`]). A value is sent only directly after a read
//! that showed nothing new. The value must be at most one step from the value read and from each of these
//! copies. Whichever copy arrives, the register then moves by one step at most. If no permitted value is
//! nearer to the requested value than the value read, the change waits until the copies can no longer arrive.
//!
//! A value that appears in the register counts as written by the gateway only if a copy of this value was
//! under way. The gateway sends the register value again at the period `refresh`, under the same rule, and
//! never while a change waits. One decision moves the register once, by one step at most. The axis determines
//! the time between its decisions.
//!
//! ```text
//!            change requested        nothing new         shared: promise saved
//!   Nothing ──────────────► Read ──────────────► Keep ──────────────► Read ─────► Write
//!      ▲                     │ ▲                                                    │
//!      │  nothing to be done │ └────────── done · unknown: read the register again ─┤
//!      └─────────────────────┴──────────────────────────────── refused · not sent ──┘
//! ```
//!
//! A decision has the offset, and the **target** that the offset approaches. The target is the value that the model,
//! the fault action, the stop or the sign check requests. A value that is sent lies between the verified value and the
//! target. While the register waits for late writes, the axis may have made further decisions. Even then the register
//! never moves away from the target. One count beyond the target is sent only if the target itself is a zero that must
//! be avoided.
//!
//! A **shared** register holds the sum of the operator offset (base) and the gateway share. Before a value is sent, the
//! absolute register value is saved on disk as a **promise**. The register is then read once more to detect an edit in
//! between. Whenever the process dies, the register holds base + share, one of the promises, or a value of the
//! operator.
//!
//! For an output that **cannot be read**, only the answers of the device are known. The last acknowledged
//! value replaces the last value read. An unanswered write counts as under way until a later write is
//! acknowledged. The later write must have begun after the longest delay of the unanswered write. For this
//! purpose, the gateway sends the last acknowledged value again.
//!
//! An output **in a set** is sent in one request with others. When one of them or the heartbeat is written, the
//! register values of the others are sent with it, in every state ([`Fact::PiggybackAsked`]). Such a value is a write
//! under way like any other.
//!
//! # Meaning of a read
//! The value read is compared with the value of the last acknowledged write. If there is none, it is compared with the
//! last verified value.
//!
//! | the read shows | whole register | shared register |
//! |---|---|---|
//! | the same | nothing new | nothing new |
//! | the same, after another client has made as many small changes as the gateway, each soon after a change of the gateway | | doubt: a second gateway |
//! | the value before a write that was acknowledged | the device did not apply the write: sent again | the same |
//! | a value under way | the gateway's write: the axis resumes from it | the gateway's write: the share changes. Doubt: a zero with a base, or a value more than the limit from the base |
//! | a value that should no longer arrive | the gateway's write, very late | doubt: the operator's or the gateway's |
//! | zero | CNC restarted: the axis resumes from zero | CNC restarted: base 0, share 0 |
//! | anything else | another client wrote: the output is disarmed | the operator's change: the base moves by it |
//! | anything else, and a write of the gateway may have arrived unseen before | | doubt |
//! | anything else within `late` after a start, if the last run was not stopped cleanly | perhaps the gateway's: the axis resumes from it | doubt, if a promise was open |
//! | anything else, after a reported restart of the CNC | the axis resumes from it, if within the limit | doubt, if the register contained a share |
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

mod action;
mod applied;
mod controller;
mod demand;
mod event;
mod fact;
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
mod set_words;
mod settings;
mod slots;
mod state;
mod state_parts;
mod strobe;
mod transaction;
mod turns;
mod update;

pub use action::Action;
pub use controller::{Controller, MOST_EVENTS, Policy};
pub use demand::{Condition, Demand, Input, Mode, NotSent, OutputDecision, SetCommit};
pub use event::{Doubt, Event};
pub use fact::{Fact, Who};
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
pub use update::step;

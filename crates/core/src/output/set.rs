//! Input and actions of the controller of an output set ([`SetController`](super::SetController)). An output set is a
//! group of outputs that are written together.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::Fact;
use super::demand::{Demand, Input, NotSent};
use super::heartbeat::Beat;
use super::settings::Settings;
use super::transaction::CommitTrigger;
use crate::quantity::{Counts, Moment, Shift, Shifted, shifted};

/// Settings of a set of outputs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetSettings {
    /// Settings of each output.
    pub members: Vec<Settings>,
    /// Event at which the control takes over the values of the output set.
    pub taking: CommitTrigger,
    /// Whether the output set has a register for its number.
    pub has_number: bool,
    /// Timeout for each answer to the strobe signal. `None` without a handshake.
    pub timeout: Option<Duration>,
    /// Period after which the output set is sent again without a change.
    pub refresh: Option<Duration>,
    /// Whether the output set has a heartbeat and a control word, and whether these can be written alone.
    pub words: SetWords,
}

/// Presence of a heartbeat and a control word in an output set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetWords {
    /// The output set has neither heartbeat nor control word.
    None,
    /// The output set has a heartbeat.
    Heartbeat(StandaloneWrite),
    /// The output set has a control word, and perhaps a heartbeat.
    Control(StandaloneWrite),
}

/// Whether heartbeat and control word can be written without the values of the outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StandaloneWrite {
    /// Heartbeat and control word cannot be written alone: the control takes the output set as a whole or not at all.
    No,
    /// Heartbeat and control word can be written alone, in a request without the values.
    Yes,
}

impl SetWords {
    pub(super) fn can_leave_alone(self) -> bool {
        matches!(self, SetWords::Heartbeat(StandaloneWrite::Yes) | SetWords::Control(StandaloneWrite::Yes))
    }

    pub(super) fn has_control(self) -> bool {
        matches!(self, SetWords::Control(_))
    }
}

/// Bits of the control word, which shows the control the states of the axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ControlWord;

impl ControlWord {
    /// Every axis of the output set is armed.
    pub const ENABLE: u16 = 1;
    /// An axis is frozen: it keeps its last Cz (compensation value).
    pub const HOLD: u16 = 2;
    /// An axis carries out its fault action.
    pub const FAULT: u16 = 4;
    /// An axis follows a fallback model, or its preferred model with an estimate for a frozen or lost sensor.
    pub const DEGRADED: u16 = 8;
}

/// Demand on an output set: present requirements for its outputs, control word and heartbeat.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetDemand {
    /// Demand on each output.
    pub members: Vec<MemberDemand>,
    /// Control word to send: bits with the states of the axes.
    pub control: u16,
    /// Change of the heartbeat count in the next request.
    pub beat: Beat,
    /// Whether the gateway is about to end. The output set then drops the strobe signal and does not wait for the
    /// control.
    pub is_leaving: bool,
}

/// Demand on one output of an output set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MemberDemand {
    /// Demand on the output from its axis, its interlock and the operator.
    pub demand: Demand,
    /// Last moment at which an earlier value may be sent again, to complete an output set of which only a part was
    /// written. `None` if the axis is off.
    pub again_until: Option<Moment>,
}

/// Number, heartbeat and control word of an output set, which are sent with the values of the outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct OwnWords {
    /// Number of the output set. `None` if the set has no number.
    pub number: Option<u16>,
    /// Count of the heartbeat.
    pub beat: u16,
    /// Control word: bits with the states of the axes.
    pub control: u16,
}

/// Value of one output in a request that writes the whole output set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetValue {
    /// Value that differs from the register value: the output changes.
    New(Counts),
    /// Register value as it was just read. The output does not change.
    AsRead(Counts),
}

impl SetValue {
    /// Returns the value in counts of the register.
    pub fn counts(self) -> Counts {
        match self {
            SetValue::New(value) | SetValue::AsRead(value) => value,
        }
    }
}

/// Input of the controller of an output set.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum SetInput {
    /// The turn of the output set begins: the task of the bus line works on the set until [`SetInput::TurnEnds`].
    Demand(SetDemand),
    /// The computer was paused for a while (for example suspended), so that values may be too old.
    Paused,
    /// The disk or the control has answered for one of the outputs.
    Member {
        /// Index of the output in the output set.
        place: usize,
        /// Answer of the disk or the control.
        answer: OutputAnswer,
    },
    /// The disk has not yet confirmed that the state of an output is saved. The next turn asks again.
    DiskNotYet,
    /// The registers of the output set were read.
    Read {
        /// Register value of each output, in counts.
        values: Vec<Counts>,
        /// Number of the output set. `None` if the set has no number.
        number: Option<u16>,
        /// Count of the heartbeat.
        beat: Option<u16>,
        /// Time at which the read request was sent.
        asked: Moment,
    },
    /// The device did not answer the read.
    NoAnswer,
    /// Result of the write of the values, or of heartbeat and control word alone.
    Sent {
        /// Result of the write of the values, or of heartbeat and control word.
        result: WriteResult,
        /// Time after the last byte was sent.
        left: Moment,
    },
    /// The last check before the write rejected a value, because the control would apply another value or exceed the
    /// limit. Nothing was sent.
    NotAdmitted,
    /// Result of a write of the strobe signal.
    Strobe(StrobeResult),
    /// The acknowledge signal was read. `None` if the read was not answered.
    Acknowledge(Option<bool>),
    /// The turn of the output set (the work of the bus line's task on it) ends.
    TurnEnds,
}

/// Answer of the disk or of the control for one output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutputAnswer {
    /// The state of the output is saved on disk.
    OnDisk,
    /// Nothing needs to be saved on disk.
    Kept,
    /// The state of the output cannot be saved on disk.
    NotKept,
    /// Applied value in thousandths of a count, with the time of the request. `None` if the value is not a number.
    Applied(Option<i64>, Moment),
    /// The read of the applied value was not answered.
    AppliedNoAnswer(Moment),
}

impl OutputAnswer {
    /// Returns the answer as an input for the controller of the output.
    pub fn input(self) -> Input {
        match self {
            OutputAnswer::OnDisk => Input::OnDisk,
            OutputAnswer::Kept => Input::Fact(Fact::Kept),
            OutputAnswer::NotKept => Input::Fact(Fact::NotKept),
            OutputAnswer::Applied(found, asked) => Input::Applied { found, asked },
            OutputAnswer::AppliedNoAnswer(asked) => Input::AppliedNoAnswer { asked },
        }
    }
}

/// Result of a write request: what is known about whether the device has carried it out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WriteResult {
    /// The device answered that it has carried out the write.
    Done,
    /// The request was not answered, or was carried out only in part.
    Unknown,
    /// The device refused the write.
    Refused,
    /// The request was not sent: the last moment for it had passed.
    TooLate,
    /// The request was not sent, for another reason.
    NotSent,
    /// The request was not sent: the device could not be reached.
    Unreachable,
    /// The request was not sent, because it cannot be built.
    Rejected,
}

impl WriteResult {
    /// Returns whether the request may have arrived at the device.
    pub(super) fn may_have_arrived(self) -> bool {
        matches!(self, WriteResult::Done | WriteResult::Unknown)
    }

    /// Returns the result as an input for the controller of an output whose value was to be written. `left`: time after
    /// the last byte was sent.
    pub fn input(self, left: Moment) -> Input {
        match self {
            WriteResult::Done => Input::Fact(Fact::Done { left }),
            WriteResult::Unknown => Input::Fact(Fact::Unknown { left }),
            WriteResult::Refused => Input::Fact(Fact::Refused),
            WriteResult::TooLate => Input::NotSent(NotSent::TooLate),
            WriteResult::NotSent => Input::Fact(Fact::NotSent),
            WriteResult::Unreachable => Input::NotSent(NotSent::Unreachable),
            WriteResult::Rejected => Input::NotSent(NotSent::Rejected),
        }
    }
}

/// Result of a write of the strobe signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StrobeResult {
    /// The device answered that it has carried out the write.
    Done,
    /// The write was refused or not sent, so the strobe signal has not changed.
    NotDone,
    /// The write was sent and not answered. The strobe signal may have changed.
    Unknown,
}

/// Next exchange of an output set with the device or the disk.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SetAction {
    /// Do nothing until this moment.
    Nothing {
        /// Time at which the controller must be called next.
        until: Moment,
    },
    /// Save the state of the output with this index to disk.
    Keep(usize),
    /// Read all registers of the output set.
    Read,
    /// Write all registers of the output set.
    Write {
        /// Value to write for each output, in counts.
        values: Vec<SetValue>,
        /// Number, heartbeat and control word of the set, which are written with the values.
        own: OwnWords,
        /// Last moment for sending the first byte of the request.
        not_after: Moment,
    },
    /// Write only the heartbeat and the control word.
    WriteOwn(OwnWords),
    /// Read the acknowledge signal of the control.
    Acknowledge,
    /// Set the strobe signal, so that the control takes the output set.
    Raise,
    /// Reset the strobe signal: after the control has acknowledged, after a failure, or at the end.
    Drop,
}

impl SetAction {
    /// Returns the name of the action in a log.
    pub const fn name(&self) -> &'static str {
        match self {
            SetAction::Nothing { .. } => "nothing",
            SetAction::Keep(_) => "keep",
            SetAction::Read => "read",
            SetAction::Write { .. } => "write",
            SetAction::WriteOwn(_) => "write-own",
            SetAction::Acknowledge => "acknowledge",
            SetAction::Raise => "raise",
            SetAction::Drop => "drop",
        }
    }
}

shifted!(MemberDemand: demand, again_until);
shifted!(SetDemand: members);

impl Shifted for SetInput {
    fn shift(&mut self, by: Shift) {
        match self {
            SetInput::Demand(demand) => demand.shift(by),
            SetInput::Read { asked, .. } => asked.shift(by),
            SetInput::Sent { left, .. } => left.shift(by),
            SetInput::Member { answer, .. } => match answer {
                OutputAnswer::Applied(_, asked) | OutputAnswer::AppliedNoAnswer(asked) => asked.shift(by),
                OutputAnswer::OnDisk | OutputAnswer::Kept | OutputAnswer::NotKept => {}
            },
            SetInput::Paused
            | SetInput::DiskNotYet
            | SetInput::NoAnswer
            | SetInput::NotAdmitted
            | SetInput::Strobe(_)
            | SetInput::Acknowledge(_)
            | SetInput::TurnEnds => {}
        }
    }
}

impl Shifted for SetAction {
    fn shift(&mut self, by: Shift) {
        match self {
            SetAction::Nothing { until: moment } | SetAction::Write { not_after: moment, .. } => {
                moment.shift(by)
            }
            SetAction::Keep(_)
            | SetAction::Read
            | SetAction::WriteOwn(_)
            | SetAction::Acknowledge
            | SetAction::Raise
            | SetAction::Drop => {}
        }
    }
}

//! Events as one enum. The log line, the counter and the list of the web page come from the same variant.
//!
//! An event is reported once, when a state begins or ends. It contains the number of occurrences that were not reported
//! in between.

use std::borrow::Cow;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::requester::Channel;
use super::status::DialDirection;
use crate::clock::Correction;
use data::{both_in_text, in_seconds, in_text};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::one_line;
use isotherm_profile::safe_file::cut;

mod alarms;
mod broker;
#[cfg(feature = "opcua")]
mod certificate;
mod comparison;
mod data;
mod delivery;
pub mod file;
mod journal;
mod page;
mod sentences;
mod stand_in;

pub use alarms::{Acknowledgement, Alarm, Change};
pub use broker::Broker;
#[cfg(feature = "opcua")]
pub use certificate::{CertificateOwner, Expiry};
pub use comparison::Comparison;
pub(crate) use comparison::found_worse;
pub use delivery::Delivery;
pub use isotherm_core::output::HandshakeFault;
pub use journal::{Entry, EventListener, Journal, ReportedEvent};
pub use page::{PagePort, PageToken};
pub use stand_in::StandIn;
pub(crate) use stand_in::others;

/// Event, in the names of the profile. Its fields are its data for programs.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[allow(
    missing_docs,
    reason = "each field is what its name says: a name of the profile, or a figure in its unit"
)]
pub enum Event {
    /// The gateway has started.
    Started { machine: String, bus_requests: usize },
    /// The gateway was asked to stop. It runs the fault actions, or `holds` the register values.
    Stopping {
        holds: bool,
        #[serde(rename = "within_s", serialize_with = "in_seconds")]
        within: Duration,
    },
    /// The gateway has stopped. `left`: values that stay in the registers.
    Stopped { left: String },
    /// A connection could not be made, or was lost.
    LinkDown { bus: String, address: String, fault: Explained },
    /// A connection works again.
    LinkUp { bus: String, address: String, attempts: u64 },
    /// A device does not answer properly any more.
    DeviceLost { device: String, at: String, fault: Explained },
    /// A device answers again.
    DeviceBack { device: String, at: String, missed: u64 },
    /// A device is not set as the profile expects. Nothing that depends on it is armed.
    NotAsExpected { device: String, found: Explained },
    /// A device is set as the profile expects again.
    AsExpected { device: String },
    /// A signal cannot be used any more.
    SignalBad { signal: String, reason: Explained },
    /// A signal can be used again.
    SignalGood {
        signal: String,
        #[serde(rename = "bad_for_s", serialize_with = "in_seconds")]
        bad_for: Duration,
    },
    /// A counter was set, referenced or restarted. Nothing moved.
    Rereferenced { signal: String, unit: String, from: f64, to: f64 },
    /// The state of an axis has changed, or the cause of its state. In that case `from` and `to` are the same.
    AxisState {
        axis: String,
        from: &'static str,
        to: &'static str,
        why: Explained,
        /// The gateway was asked to stop. The change is no fault.
        #[serde(skip)]
        stopping: bool,
    },
    /// A command was carried out. `axes` is empty if it concerns no axis.
    Command { command: String, axes: Vec<String>, way: Channel, who: String, answer: String },
    /// A command was refused.
    CommandRefused { command: String, axes: Vec<String>, way: Channel, who: String, why: Explained },
    /// A command was dropped, because its sender did not wait for it any more. It will not be carried out.
    CommandDropped { command: String, axes: Vec<String>, way: Channel, who: String, why: String },
    /// An axis to be armed now waits for another condition.
    WaitsToArm { axis: String, why: Explained },
    /// A request to arm was withdrawn or has expired.
    ArmEnded { axis: String, why: Explained },
    /// An axis is armed. `from`: register value at that time.
    Armed {
        axis: String,
        #[serde(rename = "from_um")]
        from: Micron,
        way: Channel,
        who: String,
    },
    /// An armed axis resumes from its register value after a restart of the control.
    GoesOn {
        axis: String,
        #[serde(rename = "from_um")]
        from: Micron,
        way: Channel,
    },
    /// The operator has reported in which direction a gauge moved when Cz increased.
    SignChecked { axis: String, moved: DialDirection, way: Channel, who: String },
    /// A check of the sign has ended without an answer. Cz goes back.
    SignEnded { axis: String, why: Explained },
    /// An axis was switched off.
    Disarmed { axis: String, why: Explained },
    /// An axis cannot be armed.
    ArmRefused { axis: String, why: Explained },
    /// The model requests more than the limit.
    AtLimit {
        axis: String,
        #[serde(rename = "wanted_um")]
        wanted: Micron,
        #[serde(rename = "limit_um")]
        limit: Micron,
    },
    /// The absolute value of Cz is above the warning level.
    Warned {
        axis: String,
        #[serde(rename = "cz_um")]
        cz: Micron,
        #[serde(rename = "warn_um")]
        warn: Micron,
    },
    /// The model requests more than the error level, and is not used any more.
    BeyondError {
        axis: String,
        #[serde(rename = "wanted_um")]
        wanted: Micron,
        #[serde(rename = "error_um")]
        error: Micron,
    },
    /// The inputs are outside the region on which the axis's model was identified.
    Extrapolating { axis: String, how: Explained },
    /// The inputs are inside the region again, or no model is in use.
    Interpolating { axis: String },
    /// The axis has learned from a measured error.
    Probed {
        axis: String,
        #[serde(rename = "error_um")]
        error: Micron,
        #[serde(rename = "residual_um")]
        residual: Micron,
        #[serde(rename = "correction_um")]
        correction: Micron,
    },
    /// A measured error was refused.
    ProbeRefused {
        axis: String,
        #[serde(rename = "error_um")]
        error: Option<Micron>,
        why: Explained,
    },
    /// The correction from measured errors was discarded.
    ProbeForgotten { axis: String },
    /// The error of a model was above the warning level.
    ModelAges {
        axis: String,
        #[serde(rename = "residual_um")]
        residual: Micron,
        #[serde(rename = "warn_um")]
        warn: Micron,
    },
    /// A value exceeded the range of its register and was limited.
    Saturated { output: String, wanted: f64 },
    /// The value that was read back differs from the written one.
    VerifyFailed {
        output: String,
        wrote: String,
        found: String,
        /// The value is in a node of an OPC UA server.
        #[serde(skip)]
        is_in_a_node: bool,
    },
    /// The control applies another value than the register value.
    NotApplied { output: String, stands: String, applies: String, register: String },
    /// A write has failed.
    WriteFailed { output: String, fault: Explained },
    /// The register of an output cannot be read.
    ReadFailed { output: String, fault: Explained },
    /// The heartbeat of the gateway is not written. `place`: its register or node.
    HeartbeatFailed { device: String, place: String, fault: Explained },
    /// The heartbeat of the gateway is written again.
    HeartbeatWritten { device: String, place: String },
    /// A write was verified after failures.
    Verified { output: String, failures: u64 },
    /// An external write has changed the register.
    ForeignChange { output: String, expected: String, found: String },
    /// A write of the gateway arrived long after it was sent.
    OwnWriteLate { output: String, value: String, sent: String },
    /// A value appeared after a start. It may be a write of the gateway from before the start.
    PerhapsFromBefore { output: String, value: String },
    /// A late write may still arrive, and the next change would be too far from it.
    WaitsForLateWrite { output: String, seconds: u64 },
    /// Writes are acknowledged, but the register cannot be read.
    NotReadBack { output: String },
    /// The operator has changed the operator offset in a shared register.
    OperatorChange { output: String, from: String, to: String, share: String },
    /// The division of a shared register is recorded: operator offset and gateway share.
    LedgerOpened { output: String, base: String, share: String },
    /// A register to be shared has an unknown value that is not zero. The operator must confirm that it is an operator
    /// offset.
    FirstAccount { output: String, holds: String },
    /// The gateway share of a register is uncertain. The operator must confirm it.
    LedgerDoubt { output: String, why: Explained },
    /// The place, scale or owner of an output's register differs from the last run. Its axis is off.
    OutputMoved { output: String, why: Explained },
    /// A register that belongs to no output any more contains a verified value of the gateway.
    RegisterLeft {
        output: String,
        register: String,
        #[serde(rename = "held_um")]
        held: Micron,
        #[serde(skip)]
        hint: String,
    },
    /// A register that belonged to no output was returned to its base value at the operator's request, and verified.
    RegisterReleased { output: String, register: String },
    /// The operator has armed the axis, and so confirmed the place of this output.
    PlaceConfirmed { output: String },
    /// The place of a signal differs from the last run. Its references are captured again.
    ReferenceForgotten { signal: String, why: Explained },
    /// The URI of a namespace index in the profile is recorded.
    NamespaceRecorded { bus: String, index: u16, uri: String },
    /// A namespace has another index on the server than in the profile. The server's index is used.
    NamespaceMoved { bus: String, uri: String, from: u16, to: u16 },
    /// The Cz of a corrected position is unknown. It starts at zero.
    PositionFromZero { output: String },
    /// The register was back at zero, because the CNC was restarted.
    CncRestarted { output: String, expected: String },
    /// A device template differs from the one of the last run.
    TemplateChanged { template: String, changes: String },
    /// The boot counter of a control changed.
    CncBooted { device: String, from: f64, to: f64 },
    /// A control did not take a written value. `set` is "output cnc_z" or "set plc".
    Handshake { set: String, fault: HandshakeFault, register: String, cause: String },
    /// A CAN node was reset, or has stopped for another reason. It is set up and started again.
    NodeReset { device: String, node: u8, what: String },
    /// A CAN node reports an emergency.
    Emergency { device: String, what: Explained },
    /// An emergency has ended. `count`: number of messages.
    EmergencyOver { device: String, count: u64 },
    /// A CAN line has a fault in its controller, queue or receiver, or another master is on a serial line.
    BusTrouble { bus: String, address: String, what: Explained },
    /// The fault of a line has ended.
    BusWell {
        bus: String,
        address: String,
        count: u64,
        what: &'static str,
        #[serde(rename = "within_s", serialize_with = "in_seconds")]
        within: Duration,
    },
    /// The interlock of an output is open. Nothing is written.
    Interlocked { output: String, when: String },
    /// The interlock of an output is closed again.
    Released { output: String },
    /// The machine was started. Its running time is counted from now on.
    MachineStarted,
    /// The "zero" references are captured from now on.
    Zeroed,
    /// A line has more exchanges than it can carry: one of them was late. It is reported once, and again after the line
    /// was fast enough in between.
    Overrun {
        bus: String,
        what: String,
        #[serde(rename = "late_s", serialize_with = "in_seconds")]
        late: Duration,
    },
    /// A device does not support two requests at a time: requests to it are sent one by one.
    PipelineGivenUp { bus: String, fault: String },
    /// A server does not support a requested subscription, or not as requested.
    Subscription { device: String, what: String },
    /// The gateway did not run for this time: the computer was stopped, suspended or overloaded.
    StoodStill {
        #[serde(rename = "span_s", serialize_with = "in_seconds")]
        span: Duration,
    },
    /// A task of the gateway failed. Its axes run the fault action.
    TaskFailed { task: String, why: String },
    /// The computer's clock was set. Displayed times follow it, counted times do not.
    ClockSet(#[serde(serialize_with = "both_in_text")] Correction),
    /// The computer's clock does not continue from the end of the last run. The time since then is unknown.
    ClockDoubtful {
        #[serde(serialize_with = "in_text")]
        last: Moment,
    },
    /// Logs were deleted.
    LogsDeleted { names: Vec<String>, why: String },
    /// Other gateways on this computer cannot be detected. A second writer of a register would not be rejected.
    NotExclusive { why: String },
    /// The state or the log could not be stored on disk.
    NotKept { what: String, why: Explained },
    /// The state or the ledger was rejected: it is damaged, was changed, or is a copy from elsewhere.
    NotBelieved { why: String },
    /// The handover of the program before this one in the same process was rejected.
    HandoverRefused { why: String },
    /// The checked profile runs, but these of its files, variables or settings have changed since.
    ProfileDiffers { profile: String, files: Vec<String> },
    /// The state or the ledger of an earlier version of the program is used.
    TakenFromEarlier { what: &'static str, version: u32, kept: String },
    /// Events are missing on disk.
    EventsLost { count: u64 },
    /// The file of a day's events is full.
    EventsFull { bytes: usize },
    /// The state or the log can be stored again.
    KeptAgain { what: String },
    /// A sensor has a stand-in, or has none any more.
    StandIn(StandIn),
    /// Probings show that an axis is worse with its model than without compensation, or do not show it any more.
    Comparison(Comparison),
    /// The port of the web page is in use, or can be used again.
    Page(PagePort),
    /// A token of the web page has changed or is missing.
    Token(PageToken),
    /// State of publishing to the broker of `[mqtt]`.
    Broker(Broker),
    /// State of messages to a server of `[[notify]]`.
    Delivery(Delivery),
    /// A certificate of an OPC UA line expires soon, or has expired.
    #[cfg(feature = "opcua")]
    Certificate(Expiry),
}

/// Severity of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Information.
    Info,
    /// Trouble that the operator should know of.
    Warning,
    /// Trouble that requires an action.
    Error,
}

/// Description of an event.
struct EventDescription {
    /// Kind, as a word for programs.
    kind: &'static str,
    level: Level,
    /// Subject of the event, without the cause.
    about: String,
    /// Cause and hint; `None` if nothing is wrong.
    why: Option<Explained>,
}

const fn info(kind: &'static str, about: String) -> EventDescription {
    EventDescription { kind, level: Level::Info, about, why: None }
}

/// Describes trouble that the operator should know of. `about` is empty if the cause contains the subject.
fn warning(kind: &'static str, about: impl Into<String>, why: Explained) -> EventDescription {
    EventDescription { kind, level: Level::Warning, about: about.into(), why: Some(why) }
}

/// Describes trouble that requires an action. `about` is empty if the cause contains the subject.
fn error(kind: &'static str, about: impl Into<String>, why: Explained) -> EventDescription {
    EventDescription { level: Level::Error, ..warning(kind, about, why) }
}

impl EventDescription {
    /// Returns the text: subject, cause and hint.
    fn text(&self) -> String {
        let why = self.why.iter().map(ToString::to_string).filter(|why| !why.is_empty());
        let about = Some(&self.about).filter(|about| !about.is_empty()).cloned();
        about.into_iter().chain(why).collect::<Vec<_>>().join(": ")
    }

    /// Adds cause and hint to the data for programs.
    fn explain(&self, data: &mut Value) {
        let (Some(Explained { cause, hint }), Some(fields)) = (&self.why, data.as_object_mut()) else {
            return;
        };
        fields.insert("cause".to_owned(), cause.as_str().into());
        if let Some(hint) = hint {
            fields.insert("hint".to_owned(), hint.as_ref().into());
        }
    }
}

impl Event {
    /// Returns the log entry of the event at this time.
    pub fn entry(&self, at: Moment) -> Entry {
        let described = self.described();
        // Numbers and texts always have a JSON form.
        let mut data = serde_json::to_value(self).unwrap_or_default();
        described.explain(&mut data);
        data::bound(&mut data);
        let text = cut(&one_line(&described.text()), data::LONGEST).into_owned();
        Entry { at: at.to_string(), kind: Cow::Borrowed(described.kind), level: described.level, text, data }
    }

    /// Returns the kind, as a word for programs.
    fn kind(&self) -> &'static str {
        self.described().kind
    }
}

#[cfg(test)]
mod tests;

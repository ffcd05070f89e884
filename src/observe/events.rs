//! What happened, as one enum: the log line, the counter and the page's list come from the same variant.
//!
//! An event is reported once, when a state begins or ends, with a count of what was not reported in between.

use std::borrow::Cow;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::asker::Way;
use super::status::Moved;
use crate::clock::Correction;
use data::{both_in_text, in_seconds, in_text};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::one_line;
use isotherm_profile::regular::cut;

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

pub use alarms::{Alarm, Change, Seen};
pub use broker::Broker;
#[cfg(feature = "opcua")]
pub use certificate::{Expiry, Whose};
pub use comparison::Comparison;
pub(crate) use comparison::found_worse;
pub use delivery::Delivery;
pub use isotherm_core::output::HandshakeFault;
pub use journal::{Entry, EventListener, Happened, Journal};
pub use page::{PagePort, PageToken};
pub use stand_in::StandIn;
pub(crate) use stand_in::others;

/// Something that happened, in the names of the profile. Its fields are its data for programs.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[allow(
    missing_docs,
    reason = "each field is what its name says: a name of the profile, or a figure in its unit"
)]
pub enum Event {
    /// The gateway runs.
    Started { machine: String, bus_requests: usize },
    /// It was asked to stop, and runs the fault actions or `holds` what stands in the registers.
    Stopping {
        holds: bool,
        #[serde(rename = "within_s", serialize_with = "in_seconds")]
        within: Duration,
    },
    /// It has stopped; `left` says what stays in the registers.
    Stopped { left: String },
    /// A connection could not be made, or broke.
    LinkDown { bus: String, address: String, fault: Explained },
    /// A connection is back.
    LinkUp { bus: String, address: String, attempts: u64 },
    /// A device stopped answering properly.
    DeviceLost { device: String, at: String, fault: Explained },
    /// It answers again.
    DeviceBack { device: String, at: String, missed: u64 },
    /// A device is not set as the profile expects it; nothing that depends on it is armed.
    NotAsExpected { device: String, found: Explained },
    /// It is now.
    AsExpected { device: String },
    /// A signal became unusable.
    SignalBad { signal: String, reason: Explained },
    /// It is usable again.
    SignalGood {
        signal: String,
        #[serde(rename = "bad_for_s", serialize_with = "in_seconds")]
        bad_for: Duration,
    },
    /// A counter was set anew, referenced or restarted: nothing moved.
    Rereferenced { signal: String, unit: String, from: f64, to: f64 },
    /// An axis changed its state, or the cause of the state: `from` and `to` are then the same.
    AxisState {
        axis: String,
        from: &'static str,
        to: &'static str,
        why: Explained,
        /// The gateway was asked to stop: what the axis does is no fault.
        #[serde(skip)]
        stopping: bool,
    },
    /// What somebody asked for, and what came of it; `axes` is empty where it concerns none.
    Command { command: String, axes: Vec<String>, way: Way, who: String, answer: String },
    /// It was not done.
    CommandRefused { command: String, axes: Vec<String>, way: Way, who: String, why: Explained },
    /// Nobody waited for it any more when its turn came: it will never be done.
    CommandDropped { command: String, axes: Vec<String>, way: Way, who: String, why: String },
    /// An axis that is to be armed waits for something else now.
    WaitsToArm { axis: String, why: Explained },
    /// Nobody wants it to be armed any more.
    ArmEnded { axis: String, why: Explained },
    /// An axis is armed; `from` is what stood in its register.
    Armed {
        axis: String,
        #[serde(rename = "from_um")]
        from: Micron,
        way: Way,
        who: String,
    },
    /// An armed axis goes on from what stands in its register after the control was restarted.
    GoesOn {
        axis: String,
        #[serde(rename = "from_um")]
        from: Micron,
        way: Way,
    },
    /// A person looked which way a gauge moved when Cz went to plus.
    SignChecked { axis: String, moved: Moved, way: Way, who: String },
    /// Cz goes back, and nobody has said which way the gauge moved.
    SignEnded { axis: String, why: Explained },
    /// An axis is off.
    Disarmed { axis: String, why: Explained },
    /// An axis cannot be armed.
    ArmRefused { axis: String, why: Explained },
    /// The model asks for more than the limit.
    AtLimit {
        axis: String,
        #[serde(rename = "wanted_um")]
        wanted: Micron,
        #[serde(rename = "limit_um")]
        limit: Micron,
    },
    /// |Cz| passed the level at which people are warned.
    Warned {
        axis: String,
        #[serde(rename = "cz_um")]
        cz: Micron,
        #[serde(rename = "warn_um")]
        warn: Micron,
    },
    /// The model asks for more than the level at which it is not believed any more.
    BeyondError {
        axis: String,
        #[serde(rename = "wanted_um")]
        wanted: Micron,
        #[serde(rename = "error_um")]
        error: Micron,
    },
    /// The inputs left the region that the axis's model was identified on.
    Extrapolating { axis: String, how: Explained },
    /// They are inside again, or no model is in use.
    Interpolating { axis: String },
    /// A measured error was learned from.
    Probed {
        axis: String,
        #[serde(rename = "error_um")]
        error: Micron,
        #[serde(rename = "residual_um")]
        residual: Micron,
        #[serde(rename = "correction_um")]
        correction: Micron,
    },
    /// It was not.
    ProbeRefused {
        axis: String,
        #[serde(rename = "error_um")]
        error: Option<Micron>,
        why: Explained,
    },
    /// What measured errors have taught was taken back.
    ProbeForgotten { axis: String },
    /// A model was wrong by more than the level at which people are warned.
    ModelAges {
        axis: String,
        #[serde(rename = "residual_um")]
        residual: Micron,
        #[serde(rename = "warn_um")]
        warn: Micron,
    },
    /// A value did not fit its register and was cut.
    Saturated { output: String, wanted: f64 },
    /// What was read back is not what was written.
    VerifyFailed {
        output: String,
        wrote: String,
        found: String,
        /// It is in a node of an OPC UA server.
        #[serde(skip)]
        is_in_a_node: bool,
    },
    /// The control applies something else than what stands in its register.
    NotApplied { output: String, stands: String, applies: String, register: String },
    /// A write failed on its way.
    WriteFailed { output: String, fault: Explained },
    /// The register of an output cannot be read.
    ReadFailed { output: String, fault: Explained },
    /// The heartbeat of the gateway is not written; `place` is its register or node.
    HeartbeatFailed { device: String, place: String, fault: Explained },
    /// It is again.
    HeartbeatWritten { device: String, place: String },
    /// A write was verified again.
    Verified { output: String, failures: u64 },
    /// Somebody else wrote to our register.
    ForeignChange { output: String, expected: String, found: String },
    /// A write of ours arrived long after it was sent.
    OwnWriteLate { output: String, value: String, sent: String },
    /// What appeared after a start may be our own, from before it.
    PerhapsFromBefore { output: String, value: String },
    /// A late write may still arrive, and the next change would be too far from it.
    WaitsForLateWrite { output: String, seconds: u64 },
    /// What is written is acknowledged, and cannot be read.
    NotReadBack { output: String },
    /// An operator changed his part of a register of which we own a share.
    OperatorChange { output: String, from: String, to: String, share: String },
    /// What of a register is the operator's and what is ours, from now on.
    LedgerOpened { output: String, base: String, share: String },
    /// Nothing is known of a register that is to be shared and is not zero; a person has to say that it is his.
    FirstAccount { output: String, holds: String },
    /// What of a register is ours is not certain; a person has to say.
    LedgerDoubt { output: String, why: Explained },
    /// An output has another place, scale or owner of its register than in the last run: its axis is off.
    OutputMoved { output: String, why: Explained },
    /// A value of ours was verified in a register that is no output's any more.
    RegisterLeft {
        output: String,
        register: String,
        #[serde(rename = "held_um")]
        held: Micron,
        #[serde(skip)]
        hint: String,
    },
    /// A register that was no output's any more was read back at its base, where a person wanted it.
    RegisterReleased { output: String, register: String },
    /// A person has armed the axis and so confirmed the place of this output.
    PlaceConfirmed { output: String },
    /// A signal has another place than in the last run: what was captured from it is captured again.
    ReferenceForgotten { signal: String, why: Explained },
    /// The URI behind an index of the profile is remembered from now on.
    NamespaceRecorded { bus: String, index: u16, uri: String },
    /// A namespace has another index at the server than in the profile. It is read and written there.
    NamespaceMoved { bus: String, uri: String, from: u16, to: u16 },
    /// No state says which Cz a corrected position had: it begins at zero.
    PositionFromZero { output: String },
    /// The register was back at zero: the CNC was restarted.
    CncRestarted { output: String, expected: String },
    /// A device template is not as the last run had it.
    TemplateChanged { template: String, changes: String },
    /// The boot counter of a control changed.
    CncBooted { device: String, from: f64, to: f64 },
    /// A control did not take what was written; `set` is "output cnc_z" or "set plc".
    Handshake { set: String, fault: HandshakeFault, register: String, cause: String },
    /// A CAN node was reset, or has left its work for another reason; it is set up and started again.
    NodeReset { device: String, node: u8, what: String },
    /// A CAN node complains of something.
    Emergency { device: String, what: Explained },
    /// It does not any more; so many messages came.
    EmergencyOver { device: String, count: u64 },
    /// The controller, the queue or the receiver of a CAN line is in trouble, or another master is on a serial line.
    BusTrouble { bus: String, address: String, what: Explained },
    /// It is over.
    BusWell {
        bus: String,
        address: String,
        count: u64,
        what: &'static str,
        #[serde(rename = "within_s", serialize_with = "in_seconds")]
        within: Duration,
    },
    /// The output's interlock opened; nothing is written.
    Interlocked { output: String, when: String },
    /// It closed again.
    Released { output: String },
    /// The machine was started: the time since then is counted.
    MachineStarted,
    /// The "zero" references are captured from now on.
    Zeroed,
    /// More is asked of a line than it can carry: something was this late when its turn came. Reported once, and again when the
    /// line had been quick enough in between.
    Overrun {
        bus: String,
        what: String,
        #[serde(rename = "late_s", serialize_with = "in_seconds")]
        late: Duration,
    },
    /// A device does not bear two questions at a time: this came of them.
    PipelineGivenUp { bus: String, fault: String },
    /// A server does not do what a subscription asks it for, or not as it is asked.
    Subscription { device: String, what: String },
    /// Nobody looked at the clock for this long: the computer was stopped, suspended or had no time for us.
    StoodStill {
        #[serde(rename = "span_s", serialize_with = "in_seconds")]
        span: Duration,
    },
    /// A task of the gateway failed inside; its axes take the fault action.
    TaskFailed { task: String, why: String },
    /// The computer's clock was set: stamps follow it, and nothing that is counted does.
    ClockSet(#[serde(serialize_with = "both_in_text")] Correction),
    /// It does not go on where the last run ended: how long that is ago is not known.
    ClockDoubtful {
        #[serde(serialize_with = "in_text")]
        last: Moment,
    },
    /// Logs were deleted.
    LogsDeleted { names: Vec<String>, why: String },
    /// Other gateways of this computer cannot be seen, so a second writer of a register would not be refused.
    NotExclusive { why: String },
    /// The state or the log could not be kept on disk.
    NotKept { what: String, why: Explained },
    /// The state or the ledger is damaged, was changed, or is a copy from elsewhere: a sentence.
    NotBelieved { why: String },
    /// The program before this one in the same process handed nothing over that is accepted.
    HandoverRefused { why: String },
    /// The profile that was checked runs, and these of its files, variables or settings are different now.
    ProfileDiffers { profile: String, files: Vec<String> },
    /// The state or the ledger of an earlier version of the program is used.
    TakenFromEarlier { what: &'static str, version: u32, kept: String },
    /// So many events are not on disk.
    EventsLost { count: u64 },
    /// The file of a day's events is full.
    EventsFull { bytes: usize },
    /// The state or the log is kept again.
    KeptAgain { what: String },
    /// Others say what a sensor would read, or do not any more.
    StandIn(StandIn),
    /// Touches show that an axis is worse with its model than without compensation, or do not any more.
    Comparison(Comparison),
    /// The page's port is taken, or free at last.
    Page(PagePort),
    /// A token of the page is another one, or none.
    Token(PageToken),
    /// Whether what is published arrives at the broker of `[mqtt]`.
    Broker(Broker),
    /// Whether messages to a server of `[[notify]]` arrive.
    Delivery(Delivery),
    /// A certificate of an OPC UA line expires soon, or has.
    #[cfg(feature = "opcua")]
    Certificate(Expiry),
}

/// How much an event matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// For the record.
    Info,
    /// Somebody should know.
    Warning,
    /// Somebody should act.
    Error,
}

/// Description of an event.
struct Described {
    /// One word for programs.
    kind: &'static str,
    level: Level,
    /// What happened and where, without the cause.
    about: String,
    /// Cause and hint; `None` if nothing is wrong.
    why: Option<Explained>,
}

const fn info(kind: &'static str, about: String) -> Described {
    Described { kind, level: Level::Info, about, why: None }
}

/// Describes trouble that somebody should know of. `about` is empty if the cause says what happened.
fn warning(kind: &'static str, about: impl Into<String>, why: Explained) -> Described {
    Described { kind, level: Level::Warning, about: about.into(), why: Some(why) }
}

/// Describes trouble that somebody should mend. `about` is empty if the cause says what happened.
fn error(kind: &'static str, about: impl Into<String>, why: Explained) -> Described {
    Described { level: Level::Error, ..warning(kind, about, why) }
}

impl Described {
    /// The sentence: what happened and where, the cause, and what to do.
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
    /// The event as it is logged at this moment.
    pub fn entry(&self, at: Moment) -> Entry {
        let described = self.described();
        // Numbers and texts always have a JSON form.
        let mut data = serde_json::to_value(self).unwrap_or_default();
        described.explain(&mut data);
        data::bound(&mut data);
        let text = cut(&one_line(&described.text()), data::LONGEST).into_owned();
        Entry { at: at.to_string(), kind: Cow::Borrowed(described.kind), level: described.level, text, data }
    }

    /// One word for programs.
    fn kind(&self) -> &'static str {
        self.described().kind
    }
}

#[cfg(test)]
mod tests;

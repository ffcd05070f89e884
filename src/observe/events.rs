//! What happened, as one enum: the log line, the counter and the page's list come from the same variant.
//!
//! An event is reported once, when a state begins or ends, with a count of what was not reported in between.

use std::borrow::Cow;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::asker::Way;
use super::status::Moved;
use crate::clock::Correction;
use data::{both_in_text, in_seconds, in_text};
use isotherm_core::compensation::AxisState;
use isotherm_core::quantity::{Micron, Moment};
use isotherm_profile::one_line;

mod alarms;
mod data;
pub mod file;
mod handshake;
mod journal;
mod page;

pub use alarms::{Alarm, Seen};
pub use handshake::HandshakeFault;
pub use journal::{Entry, Journal};
pub use page::PagePort;

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
    /// It was asked to stop and runs the fault actions.
    Stopping {
        #[serde(rename = "within_s", serialize_with = "in_seconds")]
        within: Duration,
    },
    /// It has stopped; `left` says what stays in the registers.
    Stopped { left: String },
    /// A connection could not be made, or broke.
    LinkDown { bus: String, address: String, fault: String },
    /// A connection is back.
    LinkUp { bus: String, address: String, attempts: u64 },
    /// A device stopped answering properly.
    DeviceLost { device: String, at: String, fault: String },
    /// It answers again.
    DeviceBack { device: String, at: String, missed: u64 },
    /// A device is not set as the profile expects it; nothing that depends on it is armed.
    NotAsExpected { device: String, found: String },
    /// It is now.
    AsExpected { device: String },
    /// A signal became unusable.
    SignalBad { signal: String, reason: String },
    /// It is usable again.
    SignalGood {
        signal: String,
        #[serde(rename = "bad_for_s", serialize_with = "in_seconds")]
        bad_for: Duration,
    },
    /// A counter was set anew, referenced or restarted: nothing moved.
    Rereferenced { signal: String, unit: String, from: f64, to: f64 },
    /// An axis changed its state.
    AxisState {
        axis: String,
        from: &'static str,
        to: &'static str,
        why: String,
        /// The gateway was asked to stop: what the axis does is no fault.
        #[serde(skip)]
        stopping: bool,
    },
    /// What somebody asked for, and what came of it; `axes` is empty where it concerns none.
    Command { command: String, axes: Vec<String>, way: Way, who: String, answer: String },
    /// It was not done.
    CommandRefused { command: String, axes: Vec<String>, way: Way, who: String, why: String },
    /// Nobody waited for it any more when its turn came: it will never be done.
    CommandDropped { command: String, axes: Vec<String>, way: Way, who: String, why: String },
    /// An axis that is to be armed waits for something else now.
    WaitsToArm { axis: String, why: String },
    /// Nobody wants it to be armed any more.
    ArmEnded { axis: String, why: String },
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
    SignEnded { axis: String, why: String },
    /// An axis is off.
    Disarmed { axis: String, why: String },
    /// An axis cannot be armed.
    ArmRefused { axis: String, why: String },
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
    Extrapolating { axis: String, how: String },
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
        why: String,
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
    VerifyFailed { output: String, wrote: String, found: String },
    /// The control applies something else than what stands in its register.
    NotApplied { output: String, stands: String, applies: String, register: String },
    /// A write failed on its way.
    WriteFailed { output: String, fault: String },
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
    LedgerDoubt { output: String, why: String },
    /// The register was back at zero: the CNC was restarted.
    CncRestarted { output: String, expected: String },
    /// The boot counter of a control changed.
    CncBooted { device: String, from: f64, to: f64 },
    /// A control did not take what was written; `set` is "output cnc_z" or "set plc".
    Handshake { set: String, fault: HandshakeFault, register: String, cause: String },
    /// A CAN node was reset, or has left its work for another reason; it is set up and started again.
    NodeReset { device: String, node: u8, what: String },
    /// A CAN node complains of something.
    Emergency { device: String, what: String },
    /// It does not any more; so many messages came.
    EmergencyOver { device: String, count: u64 },
    /// The controller, the queue or the receiver of a CAN line is in trouble.
    BusTrouble { bus: String, address: String, what: String },
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
    /// The state or the log could not be kept on disk.
    NotKept { what: String, why: String },
    /// The state or the ledger is damaged, was changed, or is a copy from elsewhere: a sentence.
    NotBelieved { why: String },
    /// The state or the ledger of an earlier version of the program is used.
    TakenFromEarlier { what: &'static str, version: u32, kept: String },
    /// So many events are not on disk.
    EventsLost { count: u64 },
    /// The file of a day's events is full.
    EventsFull { bytes: usize },
    /// The state or the log is kept again.
    KeptAgain { what: String },
    /// The page's port is taken, or free at last.
    Page(PagePort),
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

/// One word for programs, how much it matters, and the sentence.
type Described = (&'static str, Level, String);

const fn info(kind: &'static str, text: String) -> Described {
    (kind, Level::Info, text)
}

const fn warning(kind: &'static str, text: String) -> Described {
    (kind, Level::Warning, text)
}

const fn error(kind: &'static str, text: String) -> Described {
    (kind, Level::Error, text)
}

fn seconds(span: &Duration) -> humantime::FormattedDuration {
    humantime::format_duration(Duration::from_secs(span.as_secs()))
}

/// A few of them by name, the others by their number.
fn listed(names: &[String]) -> String {
    let named = names.iter().take(5).map(String::as_str).collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(5) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}

impl Event {
    /// The event as it is logged at this moment.
    pub fn entry(&self, at: Moment) -> Entry {
        let (kind, level, text) = self.described();
        // Numbers and texts always have a JSON form.
        let data = serde_json::to_value(self).unwrap_or_default();
        let text = one_line(&text).into_owned();
        Entry { at: at.to_string(), kind: Cow::Borrowed(kind), level, text, data }
    }

    /// One word for programs.
    fn kind(&self) -> &'static str {
        self.described().0
    }

    fn described(&self) -> Described {
        match self {
            Event::Started { machine, bus_requests } => {
                info("started", format!("{machine}: the gateway runs, {bus_requests} read requests a round"))
            }
            Event::Stopping { within } => {
                info("stopping", format!("stopping: the fault actions run, at most {}", seconds(within)))
            }
            Event::Stopped { left } => info("stopped", format!("stopped; {left}")),
            Event::LinkDown { bus, address, fault } => {
                warning("link-down", format!("bus {bus} ({address}): {fault}"))
            }
            Event::LinkUp { bus, address, attempts } => {
                info("link-up", format!("bus {bus} ({address}): connected after {attempts} attempts"))
            }
            Event::DeviceLost { device, at, fault } => {
                warning("device-lost", format!("device {device}{at}: {fault}"))
            }
            Event::DeviceBack { device, at, missed } => info(
                "device-back",
                format!("device {device}{at}: is there again, {missed} failures since it was lost"),
            ),
            Event::NotAsExpected { device, found } => {
                error("not-as-expected", format!("device {device}: {found}"))
            }
            Event::AsExpected { device } => {
                info("as-expected", format!("device {device}: set as the profile expects it"))
            }
            Event::SignalBad { signal, reason } => {
                warning("signal-bad", format!("signal {signal}: {reason}"))
            }
            Event::SignalGood { signal, bad_for } => {
                info("signal-good", format!("signal {signal}: good again after {}", seconds(bad_for)))
            }
            Event::Rereferenced { signal, unit, from, to } => warning(
                "rereferenced",
                format!(
                    "signal {signal}: re-referenced, {from:.4} {unit} is {to:.4} {unit} now; a step that the axis \
                     cannot make is no motion"
                ),
            ),
            Event::AxisState { axis, from, to, why, stopping } => {
                let is_well = *stopping || !matches!(*to, "holding" | "ramping" | "degraded" | "zeroed");
                let [from, to] = [from, to].map(|name| AxisState::display_of(name));
                let why = if why.is_empty() { String::new() } else { format!(": {why}") };
                let level = if is_well { Level::Info } else { Level::Warning };
                ("axis-state", level, format!("axis {axis}: {from} → {to}{why}"))
            }
            Event::Command { command, way, who, answer, .. } => {
                info("command", format!("{command}, {}: {answer}", way.by(who)))
            }
            Event::CommandRefused { command, way, who, why, .. } => {
                warning("command-refused", format!("{command}, {}: refused: {why}", way.by(who)))
            }
            Event::CommandDropped { command, way, who, why, .. } => warning(
                "command-dropped",
                format!("{command}, {}: not done, and never will be: {why}", way.by(who)),
            ),
            Event::WaitsToArm { axis, why } => {
                info("waits-to-arm", format!("axis {axis}: waiting to arm: {why}"))
            }
            Event::ArmEnded { axis, why } => warning("arm-ended", format!("axis {axis}: not armed: {why}")),
            Event::Armed { axis, from, way, who } => {
                info("armed", format!("axis {axis}: armed, starting from {from}, {}", way.by(who)))
            }
            Event::GoesOn { axis, from, .. } => {
                info("goes-on", format!("axis {axis}: armed as before the restart, going on from {from}"))
            }
            Event::SignChecked { axis, moved, way, who } => {
                let text = format!("axis {axis}: {} ({})", moved.sentence(axis), way.by(who));
                if *moved == Moved::Plus { info("sign-checked", text) } else { error("sign-checked", text) }
            }
            Event::SignEnded { axis, why } => {
                warning("sign-ended", format!("axis {axis}: its sign check is over, Cz goes back: {why}"))
            }
            Event::Disarmed { axis, why } => warning("disarmed", format!("axis {axis}: off: {why}")),
            Event::ArmRefused { axis, why } => {
                error("arm-refused", format!("axis {axis}: cannot be armed: {why}"))
            }
            Event::AtLimit { axis, wanted, limit } => warning(
                "at-limit",
                format!("axis {axis}: the model asks for {wanted}, held at its limit of ±{limit}"),
            ),
            Event::Warned { axis, cz, warn } => {
                warning("warned", format!("axis {axis}: Cz is {cz}, beyond its warning level of ±{warn}"))
            }
            Event::BeyondError { axis, wanted, error: level } => error(
                "beyond-error",
                format!(
                    "axis {axis}: the model asks for {wanted}, beyond its error level of ±{level}; the fault action \
                     runs, and it stays off until it is armed"
                ),
            ),
            Event::Extrapolating { axis, how } => warning("extrapolating", format!("axis {axis}: {how}")),
            Event::Interpolating { axis } => {
                info("interpolating", format!("axis {axis}: extrapolates no more"))
            }
            Event::Probed { axis, error, residual, correction } => info(
                "probed",
                format!(
                    "axis {axis}: probed {error}; the model was wrong by {residual}, its correction is {correction} \
                     now"
                ),
            ),
            Event::ProbeRefused { axis, error: Some(error), why } => {
                warning("probe-refused", format!("axis {axis}: probed {error}, not learned from: {why}"))
            }
            Event::ProbeRefused { axis, error: None, why } => {
                warning("probe-refused", format!("axis {axis}: a probing is not learned from: {why}"))
            }
            Event::ProbeForgotten { axis } => {
                info("probe-forgotten", format!("axis {axis}: what probings have taught is taken back"))
            }
            Event::ModelAges { axis, residual, warn } => warning(
                "model-ages",
                format!(
                    "axis {axis}: the model was wrong by {residual}, beyond ±{warn}; where that repeats, identify it \
                     anew"
                ),
            ),
            Event::Saturated { output, wanted } => warning(
                "saturated",
                format!("output {output}: {wanted} does not fit the register and was cut"),
            ),
            Event::VerifyFailed { output, wrote, found } => {
                error("verify-failed", format!("output {output}: wrote {wrote}, read back {found}"))
            }
            Event::NotApplied { output, stands, applies, register } => error(
                "not-applied",
                format!(
                    "output {output}: {stands} stand in its register, the control applies {applies} ({register})"
                ),
            ),
            Event::WriteFailed { output, fault } => {
                warning("write-failed", format!("output {output}: not written: {fault}"))
            }
            Event::Verified { output, failures } => info(
                "verified",
                format!("output {output}: written and verified again after {failures} failures"),
            ),
            Event::ForeignChange { output, expected, found } => error(
                "foreign-change",
                format!("output {output}: somebody else wrote {found} where {expected} stood; left alone"),
            ),
            Event::OwnWriteLate { output, value, sent } => warning(
                "own-write-late",
                format!(
                    "output {output}: our own write of {value} from {sent} arrived late; going on from there"
                ),
            ),
            Event::PerhapsFromBefore { output, value } => warning(
                "perhaps-from-before",
                format!(
                    "output {output}: {value} appeared, perhaps our own from before the start; going on from there"
                ),
            ),
            Event::WaitsForLateWrite { output, seconds } => warning(
                "waits-for-late-write",
                format!(
                    "output {output}: waiting for a late write, {seconds} s at most: until then the next step could \
                     be more than one from it"
                ),
            ),
            Event::NotReadBack { output } => info(
                "not-read-back",
                format!("output {output}: acknowledged, not read back: its register cannot be read"),
            ),
            Event::OperatorChange { output, from, to, share } => info(
                "operator-change",
                format!(
                    "output {output}: the operator's part went from {from} to {to}; kept, our share stays {share}"
                ),
            ),
            Event::LedgerOpened { output, base, share } => info(
                "ledger-opened",
                format!("output {output}: {base} in its register are the operator's, {share} are ours"),
            ),
            Event::FirstAccount { output, holds } => warning(
                "first-account",
                format!(
                    "output {output}: its register holds {holds}, and nothing of ours is known in it: if all of that \
                     is your own value, arm the axis; if not, make it your own value first"
                ),
            ),
            Event::LedgerDoubt { output, why } => error("ledger-doubt", format!("output {output}: {why}")),
            Event::CncRestarted { output, expected } => warning(
                "cnc-restarted",
                format!("output {output}: back at zero where {expected} stood; the CNC was restarted"),
            ),
            Event::CncBooted { device, from, to } => warning(
                "cnc-booted",
                format!(
                    "device {device}: its boot counter went from {from} to {to}; the CNC was restarted, its registers \
                     are read anew"
                ),
            ),
            Event::Handshake { set, fault, register, cause } => {
                error(fault.kind(), fault.sentence(set, register, cause))
            }
            Event::NodeReset { device, node, what } => {
                warning("node-reset", format!("device {device} (node {node}): {what}"))
            }
            Event::Emergency { device, what } => {
                warning("emergency", format!("device {device}: emergency: {what}"))
            }
            Event::EmergencyOver { device, count } => info(
                "emergency-over",
                format!("device {device}: its emergencies are over, {count} messages came"),
            ),
            Event::BusTrouble { bus, address, what } => {
                warning("bus-trouble", format!("bus {bus} ({address}): {what}"))
            }
            Event::BusWell { bus, address, count, what, within } => {
                let span = seconds(&(*within).max(Duration::from_secs(1)));
                info("bus-well", format!("bus {bus} ({address}): well again: {count} {what} within {span}"))
            }
            Event::Interlocked { output, when } => {
                info("interlocked", format!("output {output}: held, because not {when}"))
            }
            Event::Released { output } => info("released", format!("output {output}: interlock released")),
            Event::MachineStarted => info(
                "machine-started",
                "the machine was started: the time since machine start begins".to_owned(),
            ),
            Event::Zeroed => info("zeroed", "zero: references are captured from now on".to_owned()),
            Event::Overrun { bus, what, late } => warning(
                "overrun",
                format!(
                    "bus {bus}: more is asked of it than it can carry: {what} was {} ms late; `isotherm check` shows \
                     the load of each line",
                    late.as_millis()
                ),
            ),
            Event::StoodStill { span } => warning(
                "stood-still",
                format!(
                    "this computer stood still for {:.1} s (stopped, suspended or too busy): nothing from before is \
                     used, and everything is read again",
                    span.as_secs_f64()
                ),
            ),
            Event::TaskFailed { task, why } => error("task-failed", format!("{task} failed: {why}")),
            Event::ClockSet(Correction { from, to }) => {
                warning("clock-set", format!("the computer's clock was set, from {from} to {to}"))
            }
            Event::ClockDoubtful { last } => warning(
                "clock-doubtful",
                format!(
                    "the computer's clock does not go on from {last}, the newest stamp in state and log: how long nothing \
                     was measured is not known, and it is taken for long"
                ),
            ),
            Event::LogsDeleted { names, why } => {
                info("logs-deleted", format!("deleted {}: {why}", listed(names)))
            }
            Event::NotKept { what, why } => warning("not-kept", format!("{what} cannot be kept: {why}")),
            Event::NotBelieved { why } => {
                error("not-believed", format!("{why}; every axis is off until a person arms it"))
            }
            Event::TakenFromEarlier { what, version, kept } => warning(
                "taken-from-earlier",
                format!("the {what} of an earlier version of the program (layout {version}) is used; {kept}"),
            ),
            Event::EventsLost { count } => warning(
                "events-lost",
                format!("{count} events were lost, because the disk did not keep them in time"),
            ),
            Event::EventsFull { bytes } => warning(
                "events-full",
                format!(
                    "the file of this day's events is full ({} MB): no more of them are kept",
                    bytes >> 20
                ),
            ),
            Event::KeptAgain { what } => info("kept-again", format!("{what} is kept again")),
            Event::Page(port) => port.described(),
        }
    }
}

//! State of the gateway at one moment, for `/api/status`, the web page, the metrics and the table of the demo.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use super::events::file::FileItem;
use super::events::{Alarm, Entry, Event};
use super::requester::Requester;
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::display::Display;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Remedy;
use isotherm_profile::{Language, Overridden};

mod broker;
mod dial;
mod former_registers;
mod learned;
mod probe;
mod profile_changes;
mod schema;

pub use broker::{BrokerFigures, BrokerStatus};
pub use dial::DialDirection;
pub use former_registers::{FormerRegisterStatus, ReleaseProgress, ReleaseRequest};
pub use learned::{CandidateStatus, LearnedStatus};
pub use probe::{GainStatus, ProbeStatus, ProbedStatus, WorseStatus};
pub use profile_changes::ProfileChanges;

/// Interface that returns the state of a running gateway and accepts commands. The interface can be used from
/// any thread, and never makes the bus lines wait.
pub trait GatewayApi: Send + Sync + 'static {
    /// Returns the present state.
    fn status(&self) -> Status;

    /// Carries out a command for one axis, or for all if `axis` is `None`. The answer contains a sentence for display.
    /// A command is dropped if its deadline has passed.
    ///
    /// # Errors
    /// The command is refused; the error is a sentence.
    fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String>;

    /// Returns the progress of the last [`Command::Arm`].
    ///
    /// # Errors
    /// An axis is not armed, and no request is waiting; the error is a sentence.
    fn arming(&self, axis: Option<&str>) -> Result<Answer, String>;

    /// Returns the progress of the last [`Command::Sign`]: [`Answer::Done`] when the register holds the offset.
    ///
    /// # Errors
    /// The check has ended; the error is a sentence.
    fn signing(&self, axis: Option<&str>) -> Result<Answer, String>;

    /// Uses a measured error for the correction of an axis. With `None`, removes the correction that earlier errors
    /// have made. The answer contains a sentence.
    ///
    /// # Errors
    /// The error is refused, for the reason in a sentence.
    fn measured(
        &self,
        axis: &str,
        report: Option<MeasuredReport>,
        requester: &Requester,
    ) -> Result<Answer, String>;

    /// Acknowledges an alarm, or all active alarms if `alarm` is `None`. The answer contains a sentence.
    ///
    /// # Errors
    /// No such alarm exists; the error is a sentence.
    fn acknowledge(&self, alarm: Option<&str>, requester: &Requester) -> Result<Answer, String>;

    /// Accepts a device that differs from its earlier state, because the operator has checked it. The answer contains a
    /// sentence.
    ///
    /// # Errors
    /// The confirmation is refused; the error is a sentence.
    fn confirm(&self, device: &str, requester: &Requester) -> Result<Answer, String>;

    /// Requests to release the registers of an output that was moved or removed in the profile, or withdraws this
    /// request. At the next start, the gateway begins to return the registers to their base values. The answer contains
    /// a sentence.
    ///
    /// # Errors
    /// The request is refused; the error is a sentence.
    fn release(
        &self,
        output: &str,
        wish: ReleaseRequest<'_>,
        requester: &Requester,
    ) -> Result<Answer, String>;

    /// Returns the decision logs that may contain rows of this time range. `None` if no logs are stored.
    fn logs(&self, from: Moment, to: Moment) -> Option<Vec<PathBuf>>;

    /// Reports a command that was rejected before the gateway received it.
    fn turned_away(&self, command: &str, requester: &Requester, why: &str);

    /// Reports an event of the web server or of the publisher.
    fn report(&self, event: &Event);

    /// Passes the events since `since` to `found`, oldest first, including the events of earlier runs. Stops when
    /// `found` returns `false`.
    ///
    /// # Errors
    /// Stored events cannot be read.
    fn events(&self, since: Moment, found: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()>;
}

/// Answer to a command, with a sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The command was carried out. The sentence describes the result.
    Done(String),
    /// The command waits for the condition in the sentence.
    Waits(String),
    /// The command was not carried out, because the same command was sent less than a second before.
    TooSoon(String),
}

impl Answer {
    /// Returns the text of the answer as a sentence.
    pub fn text(&self) -> &str {
        let (Answer::Done(text) | Answer::Waits(text) | Answer::TooSoon(text)) = self;
        text
    }
}

/// Command to a running gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Arms axes.
    Arm,
    /// Disarms axes. The registers keep their values.
    Disarm,
    /// Captures zero: the present values of the signals become the references for which the profile has
    /// `reference = "zero"`.
    Zero,
    /// Withdraws a waiting request to arm, and ends a sign check.
    Cancel,
    /// Increases the Cz of one axis a little, for a sign check with a dial gauge.
    Sign,
    /// Reports in which direction the dial gauge has moved.
    Signed(DialDirection),
    /// Adopts the learned model of one axis. Cz does not move.
    Adopt,
    /// Returns to the model that one axis preferred before. Cz does not move.
    AdoptBack,
}

impl Command {
    /// All commands with their names in the API and on the command socket.
    pub const ALL: [(&'static str, Command); 10] = [
        ("arm", Command::Arm),
        ("disarm", Command::Disarm),
        ("zero", Command::Zero),
        ("cancel", Command::Cancel),
        ("sign", Command::Sign),
        ("sign-plus", Command::Signed(DialDirection::Plus)),
        ("sign-minus", Command::Signed(DialDirection::Minus)),
        ("sign-none", Command::Signed(DialDirection::None)),
        ("adopt", Command::Adopt),
        ("adopt-back", Command::AdoptBack),
    ];

    /// Returns the name of the command in the API and on the command socket.
    pub fn name(self) -> &'static str {
        Command::ALL.into_iter().find(|(_, known)| *known == self).map_or("", |(name, _)| name)
    }
}

/// State of a gateway.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct Status {
    /// Name of the machine.
    pub machine: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// Description of the machine.
    pub description: String,
    /// Version of isotherm.
    pub version: &'static str,
    /// Time of the machine, RFC 3339. In a demo it differs from the time of the computer.
    pub now: String,
    /// Time zone of the computer, by its IANA name.
    pub zone: String,
    /// Synchronisation of the computer's clock: synchronised, not synchronised, not known; virtual in a demo.
    pub clock: &'static str,
    /// Seconds since the gateway started.
    pub uptime_s: f64,
    /// Seconds since machine start, without the time in which the gateway did not run; `None` if the gateway
    /// has never detected a machine start.
    pub machine_on_s: Option<f64>,
    /// Language of the web page; with `None`, the page uses that of the browser.
    #[serde(skip)]
    pub language: Option<Language>,
    /// Settings that a layer above the profile has changed.
    pub overridden: Vec<Overridden>,
    /// Files of the profile that have changed on disk since the gateway loaded them.
    pub profile_changed: Vec<String>,
    /// Whether the gateway writes nothing to a device.
    pub dry_run: bool,
    /// Whether the gateway is stopping. States of the axes are then no faults.
    pub stopping: bool,
    /// Whether every device has answered at least once, and every axis has made a decision.
    pub ready: bool,
    /// Axes, in the profile's order.
    pub axes: Vec<AxisStatus>,
    /// Signals, in the profile's order.
    pub signals: Vec<SignalStatus>,
    /// Buses, in the profile's order.
    pub buses: Vec<BusStatus>,
    /// Devices, in the profile's order.
    pub devices: Vec<DeviceStatus>,
    /// Outputs, in the profile's order.
    pub outputs: Vec<OutputStatus>,
    /// Registers that outputs no longer use, but that still contain a value of the gateway.
    pub left: Vec<FormerRegisterStatus>,
    /// Number of log rows that were lost because the queue for the disk was full.
    pub log_dropped: u64,
    /// Active alarms, newest first.
    pub alarms: Vec<Alarm>,
    /// Last events, oldest first.
    pub events: Vec<Entry>,
    /// Number of events of each kind.
    pub event_counts: BTreeMap<&'static str, u64>,
    /// State of publishing to an MQTT broker; `None` if nothing is published.
    pub mqtt: Option<BrokerStatus>,
    /// Histogram of the durations for which the lock of the shared state was held: upper bounds in seconds, with the
    /// number of durations.
    #[serde(skip)]
    pub lock_held: Vec<(f64, u64)>,
}

impl Status {
    /// Returns the reasons why the machine is not compensated at present, although the operator intends it. The list is
    /// empty if there are no reasons.
    pub fn missing(&self) -> Vec<String> {
        let sentence = |kind: &str, name: &str, state: &str, why: &str| match why {
            "" => format!("{kind} {name}: {state}"),
            why => format!("{kind} {name}: {state}: {why}"),
        };
        let devices = self.devices.iter().filter(|device| device.state != "ok");
        let is_held = |axis: &AxisStatus| matches!(axis.state, "active" | "degraded");
        let axes = self.axes.iter().filter(|axis| axis.is_wanted()).filter(|axis| !is_held(axis));
        let mut missing: Vec<String> = devices
            .map(|device| sentence("device", &device.name, device.state, &device.fault))
            .chain(axes.map(|axis| sentence("axis", &axis.name, axis.state, &axis.why.to_string())))
            .collect();
        if !self.ready {
            missing.insert(
                0,
                "a device has not answered since the start, or an axis has not made a decision".into(),
            );
        }
        missing
    }
}

impl AxisStatus {
    /// Returns whether the axis should compensate. `false` if the axis has no model, if the operator has switched the
    /// axis off, or if the axis releases a register.
    pub fn is_wanted(&self) -> bool {
        self.has_model && !self.arming.left_off && !self.arming.release
    }

    /// Returns the text that is displayed for the state.
    pub fn display(&self) -> &'static str {
        self.shown.words()
    }
}

impl DeviceStatus {
    /// Causes of failed requests, by their names in the status and in the metrics.
    pub const BLAMES: [&'static str; 5] = ["caller", "link", "peer", "exception", "timeout"];
}

impl OutputStatus {
    /// States of an output, by their names in the status and in the metrics.
    pub const STATES: [&'static str; 6] =
        ["off", "unknown", "verified", "unverified", "interlocked", "foreign"];

    /// Returns the unit of the output's value.
    pub fn unit(&self) -> &'static str {
        OutputStatus::unit_of(self.writes)
    }

    /// Returns the unit of the values of this kind of output.
    pub fn unit_of(writes: &str) -> &'static str {
        match writes {
            "corrected" | "reference" => "mm",
            "slope" => "µm/mm",
            _ => "µm",
        }
    }
}

/// Serializes an explanation as one sentence, and as its parts if it is not empty.
fn in_parts<S: Serializer>(why: &Explained, serializer: S) -> Result<S::Ok, S::Error> {
    let mut fields = serializer.serialize_map(None)?;
    fields.serialize_entry("why", why)?;
    if !why.cause.is_empty() {
        fields.serialize_entry("cause", &why.cause)?;
    }
    if let Some(hint) = &why.hint {
        fields.serialize_entry("hint", hint)?;
    }
    fields.end()
}

/// State of one axis.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct AxisStatus {
    /// Name of the axis in the profile.
    pub name: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// State of the axis's decision: off, waiting, active, degraded, holding, ramping, zeroed.
    pub state: &'static str,
    /// Displayed state, from the decision and the verified value. `shown` is one of the states in `state`, or
    /// unmodelled, sign-check or unreachable. `tone` is good, warn, bad or off.
    #[serde(flatten)]
    #[schemars(schema_with = "schema::shown")]
    pub shown: Display,
    /// Whether the profile has a model for the axis. Without a model the axis stays off.
    pub has_model: bool,
    /// Condition for which the axis waits, or reason why the preferred model cannot be used. `why` is one sentence,
    /// empty if there is none; `cause` and `hint` are its parts.
    #[serde(flatten, serialize_with = "in_parts")]
    #[schemars(schema_with = "schema::in_parts")]
    pub why: Explained,
    /// Waiting request to arm; `None` if there is none.
    pub waiting: Option<WaitingStatus>,
    /// Name of the model in use; `None` if no model is used.
    pub model: Option<String>,
    /// Cz that the model requests, µm.
    pub raw_um: Option<f64>,
    /// Expected residual error if the axis follows its model: one standard deviation, µm. `None` if the profile does
    /// not contain it, or if the inputs are outside the range on which the model was identified.
    pub expected_um: Option<f64>,
    /// Number of probings that have scaled the expected error, at most 24. 0 if only the identification determines the
    /// expected error.
    pub expected_touches: u32,
    /// Cz after the limits of the axis (limit, deadband, step, rate, rounding), µm. It is the target of the register.
    pub cz_um: f64,
    /// Last verified Cz in the register, µm; `None` if none was verified yet.
    pub verified_um: Option<f64>,
    /// Seconds since the request that read the verified value.
    pub verified_age_s: Option<f64>,
    /// Limits that changed the value: limit, deadband, step, rate, round.
    pub acted: Vec<&'static str>,
    /// Maximum absolute value of Cz, µm.
    pub limit_um: f64,
    /// Absolute Cz above which the axis has a warning, µm; `None` if the profile has no warning level.
    pub warn_um: Option<f64>,
    /// Whether |Cz| is above the warning level.
    pub warned: bool,
    /// Error level of the Cz that a model requests, µm; `None` if the profile has no error level.
    pub error_um: Option<f64>,
    /// Whether a model has requested more than the error level since the axis was armed.
    pub tripped: bool,
    /// Arming state: `armed`, `left_off`, `release`.
    #[serde(flatten)]
    pub arming: ArmingStatus,
    /// Running sign check with a dial gauge; `None` if there is none.
    pub sign: Option<SignStatus>,
    /// Last sign check: its time (RFC 3339), and the direction in which the gauge moved.
    pub sign_checked: Option<(String, DialDirection)>,
    /// True error of the axis, which only a virtual machine knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<TruthStatus>,
    /// Correction from measured errors; `None` if the profile has no probe.
    pub probe: Option<ProbeStatus>,
    /// Learned model, and its candidate; `None` if the axis does not learn.
    pub learned: Option<LearnedStatus>,
    /// Details if the inputs are outside the range on which the model in use was identified; `None` if they are inside.
    pub extrapolating: Option<ExtrapolationStatus>,
    /// Distance from the range on which the model was identified, as a share of its size: above 0 outside, negative
    /// inside. `None` if the model has no such range.
    pub excess: Option<f64>,
    /// Sensor of the model in use whose reading a stand-in replaces; `None` if there is none.
    pub stood_in: Option<SubstitutedSensorStatus>,
}

/// Arming state of one axis. Its fields are fields of the axis in JSON.
#[derive(Clone, Copy, Debug, JsonSchema, Serialize)]
pub struct ArmingStatus {
    /// Whether the axis is armed, so that it may write.
    pub armed: bool,
    /// Whether the axis is off because the operator has switched it off, or must arm it first.
    pub left_off: bool,
    /// Whether the axis only returns a register to its base value, because outputs no longer use the register. Such an
    /// axis does not compensate, and the logs have no columns for it.
    pub release: bool,
}

/// True error of an axis of a virtual machine.
#[derive(Clone, Copy, Debug, JsonSchema, Serialize)]
pub struct TruthStatus {
    /// Reported error without compensation, µm.
    pub error_um: f64,
    /// Residual error with the present Cz, µm.
    pub left_um: f64,
}

/// Running sign check of an axis.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct SignStatus {
    /// Requester of the sign check, with its channel.
    pub asked: String,
    /// Change of Cz for the sign check, µm.
    pub by_um: f64,
    /// Whether the register holds the changed Cz, so that the operator may read the gauge.
    pub there: bool,
    /// Seconds until the sign check ends, and the change of Cz is withdrawn.
    pub expires_s: f64,
    /// Movement of the gauge that is expected, in words.
    pub must: String,
}

/// Request to arm that waits for a condition.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct WaitingStatus {
    /// Requester, with its channel.
    pub asked: String,
    /// Seconds until the request to arm expires.
    pub expires_s: f64,
}

/// Inputs of a model that are outside the range on which the model was identified: how far, and the effect on Cz.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct ExtrapolationStatus {
    /// Mahalanobis distance of all inputs together from the center of the range; `None` beyond the end of a guideway.
    pub distance: Option<f64>,
    /// Mahalanobis distance at the edge of the range.
    pub reach: Option<f64>,
    /// Signal that is farthest outside its range; `None` if only the combination of the inputs is outside.
    pub signal: Option<String>,
    /// Distance of this signal from its range, in its unit; negative below the smallest value.
    pub beyond: Option<f64>,
    /// Setting of the axis for inputs outside the range: `agree`, `warn`, `hold` or `shrink`.
    pub outside: &'static str,
    /// Factor by which the model's Cz is multiplied.
    pub gain: f64,
    /// Difference between the Cz of the two models whose mean is used, µm; `None` if this difference has no effect.
    pub apart_um: Option<f64>,
    /// Description of the extrapolation, for display.
    pub text: String,
}

/// Sensor whose reading a stand-in replaces.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct SubstitutedSensorStatus {
    /// Name of the signal.
    pub signal: String,
    /// Whether the reading does not change. If `false`, the sensor is lost.
    pub frozen: bool,
    /// Time at which the sensor's reading last changed, or was last good.
    pub since: String,
    /// Number of sensors from which the stand-in is calculated.
    pub others: usize,
}

/// State of one signal.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct SignalStatus {
    /// Name of the signal in the profile.
    pub name: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// Name of the device in the profile.
    pub device: String,
    /// Last value; `None` if it must not be used.
    pub value: Option<f64>,
    /// Engineering unit of the value.
    pub unit: &'static str,
    /// Quality: `good`, or the code of the reason.
    pub quality: &'static str,
    /// Reason of the quality, for display.
    pub reason: String,
    /// Hint at the end of `reason`; `None` if there is no hint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// Location of the cause, where the operator corrects it: connection, device settings, sensor or profile.
    /// `None` if the value may be used.
    #[serde(skip)]
    pub remedy: Option<Remedy>,
    /// Seconds since the measurement; `None` if nothing was measured yet.
    pub age_s: Option<f64>,
}

/// State of one bus.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct BusStatus {
    /// Name of the bus in the profile.
    pub name: String,
    /// Host and port of a network bus, name of a serial port, or name of a CAN interface.
    pub address: String,
    /// Whether the bus has a connection.
    pub connected: bool,
    /// Number of cycles since the start.
    pub cycles: u64,
    /// Number of cycles that took longer than their period allows.
    pub overruns: u64,
    /// Histogram of the delays of cycle starts: number of delays between the previous upper bound and this one, in
    /// milliseconds. The last bound is infinite, which JSON shows as null.
    #[schemars(with = "Vec<(Option<f64>, u64)>")]
    pub jitter_ms: Vec<(f64, u64)>,
}

/// State of one device.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct DeviceStatus {
    /// Name of the device in the profile.
    pub name: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// Name of the bus in the profile.
    pub bus: String,
    /// Modbus unit identifier, or CANopen node identifier.
    pub unit: u8,
    /// Modbus unit or CANopen node, as text after the name: ` (unit 3)`, ` (node 5)`. Empty for a device that only
    /// sends CAN frames.
    #[serde(skip)]
    pub at: String,
    /// State: `ok`, `never-answered` or `lost`.
    pub state: &'static str,
    /// Fault, for display; empty if there is none.
    pub fault: String,
    /// Hint at the end of `fault`; `None` if there is no hint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// Number of requests since the start.
    pub requests: u64,
    /// Number of failed requests by cause: caller, link, peer, exception, timeout.
    pub failures: BTreeMap<&'static str, u64>,
}

/// State of one output.
#[derive(Clone, Debug, JsonSchema, Serialize)]
pub struct OutputStatus {
    /// Name of the output in the profile.
    pub name: String,
    /// Name of the axis in the profile.
    pub axis: String,
    /// Name of the device in the profile.
    pub device: String,
    /// Register of the output, in both notations.
    pub register: String,
    /// Kind of the output: `offset`, `intercept`, `slope`, `reference` or `corrected`.
    pub writes: &'static str,
    /// State: `off`, `unknown`, `verified`, `unverified`, `interlocked` or `foreign`.
    pub state: &'static str,
    /// Condition for which the handshake of the output waits, or last failure of the handshake. Empty if it does not
    /// wait and has not failed.
    pub handshake: String,
    /// Last verified value, in the output's unit (µm or µm/mm for an offset or slope, mm for a position).
    pub value: Option<f64>,
    /// Two parts of the value: operator offset and gateway share; `None` if the register is not shared with an
    /// operator.
    pub shares: Option<SharesStatus>,
    /// Value that the control reports as applied, in the output's unit; `None` if it reports none.
    pub applied: Option<f64>,
    /// Note on the value: the gateway waits for a late write, or the value was acknowledged and not read
    /// back. Empty without a note.
    pub note: String,
    /// Maximum time, in seconds, until the gateway changes the register, because an earlier write may still
    /// arrive. `None` if no change waits.
    pub waits_s: Option<f64>,
    /// Number of verified writes.
    pub writes_done: u64,
    /// Seconds since the request that read the value.
    pub age_s: Option<f64>,
}

/// Two parts of the value of a register that both the gateway and an operator write to.
#[derive(Clone, Copy, Debug, JsonSchema, Serialize)]
pub struct SharesStatus {
    /// Operator offset: part of the value that the operator entered, in the unit of the output.
    pub base: f64,
    /// Gateway share: part of the value that the gateway added, in the unit of the output.
    pub share: f64,
}

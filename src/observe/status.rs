//! State of the gateway at one moment, for `/api/status`, the web page, the metrics and the table of the demo.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use super::events::file::FileItem;
use super::events::{Alarm, Entry, Event};
use super::requester::Requester;
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::display::Display;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Language, Overridden};

mod broker;
mod former_registers;
mod probe;

pub use broker::{BrokerFigures, BrokerStatus};
pub use former_registers::{FormerRegisterStatus, ReleaseProgress, ReleaseRequest};
pub use probe::{GainStatus, ProbeStatus, ProbedStatus, WorseStatus};

/// Source of the state of a running gateway, and receiver of commands. It can be used from any thread, and never makes
/// the gateway wait.
pub trait GatewayApi: Send + Sync + 'static {
    /// Returns the present state.
    fn status(&self) -> Status;

    /// Carries out a command for one axis, or for all. The answer is a sentence for display. A command that has expired
    /// by then is dropped.
    ///
    /// # Errors
    /// Returns a sentence on why it was refused.
    fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String>;

    /// Returns the progress of the last [`Command::Arm`].
    ///
    /// # Errors
    /// Returns a sentence on why an axis is not armed, and will not be.
    fn arming(&self, axis: Option<&str>) -> Result<Answer, String>;

    /// Returns the progress of the last [`Command::Sign`]. It is done when the offset is reached.
    ///
    /// # Errors
    /// Returns a sentence on why the check has ended.
    fn signing(&self, axis: Option<&str>) -> Result<Answer, String>;

    /// Learns from a measured error of an axis; `None` discards everything that was learned. The answer is a sentence.
    ///
    /// # Errors
    /// Returns a sentence on why it was refused.
    fn measured(
        &self,
        axis: &str,
        report: Option<MeasuredReport>,
        requester: &Requester,
    ) -> Result<Answer, String>;

    /// Acknowledges an alarm, or all active alarms. The answer is a sentence.
    ///
    /// # Errors
    /// Returns a sentence on why it was refused.
    fn acknowledge(&self, alarm: Option<&str>, requester: &Requester) -> Result<Answer, String>;

    /// Accepts a device although it differs from the one before, because the operator has checked it. The answer is a
    /// sentence.
    ///
    /// # Errors
    /// Returns a sentence on why it was refused.
    fn confirm(&self, device: &str, requester: &Requester) -> Result<Answer, String>;

    /// Takes the operator's request to release the registers of an output that was moved or removed, or to withdraw it.
    /// The registers return to their base values from the next start on. The answer is a sentence.
    ///
    /// # Errors
    /// Returns a sentence on why it was refused.
    fn release(
        &self,
        output: &str,
        wish: ReleaseRequest<'_>,
        requester: &Requester,
    ) -> Result<Answer, String>;

    /// Returns the logs of decisions that may contain rows of this time span; `None` if no logs are stored.
    fn logs(&self, from: Moment, to: Moment) -> Option<Vec<PathBuf>>;

    /// Reports a command that was rejected before it reached the gateway.
    fn turned_away(&self, command: &str, requester: &Requester, why: &str);

    /// Reports an event of a server that shows the state.
    fn report(&self, event: &Event);

    /// Passes on the events since this time, oldest first, including those of earlier runs. Stops when `found` returns
    /// `false`.
    ///
    /// # Errors
    /// Returns the error of reading stored events.
    fn events(&self, since: Moment, found: &mut dyn FnMut(FileItem) -> bool) -> std::io::Result<()>;
}

/// Answer to a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The command was carried out.
    Done(String),
    /// The command waits for a condition that the sentence names.
    Waits(String),
    /// The command was not carried out, because the same one came a moment before.
    TooSoon(String),
}

impl Answer {
    /// Returns the sentence of the answer.
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
    /// Disarms axes. The register values stay.
    Disarm,
    /// Captures the "zero" references.
    Zero,
    /// Withdraws a request to arm that still waits, and ends a check of a sign.
    Cancel,
    /// Increases the Cz of one axis a little, for a dial gauge.
    Sign,
    /// Reports in which direction the gauge has moved.
    Signed(DialDirection),
}

/// Direction in which a dial gauge moved when Cz increased.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DialDirection {
    /// The gauge moved in the correct direction.
    Plus,
    /// The gauge moved in the opposite direction.
    Minus,
    /// The gauge did not move.
    None,
}

impl DialDirection {
    /// Each direction with its name.
    pub const ALL: [(&'static str, DialDirection); 3] =
        [("plus", DialDirection::Plus), ("minus", DialDirection::Minus), ("none", DialDirection::None)];

    /// Returns the meaning for an axis, and what to do.
    pub fn explained(self, axis: &str) -> Explained {
        match self {
            DialDirection::Plus => "the gauge moved to plus: the sign is right".into(),
            DialDirection::Minus => Explained::new(
                "the gauge moved to minus: the sign is WRONG, and every µm makes the error larger",
                format!(
                    "disarm {axis}, turn the sign of `scale` at its output (or the sign in the control), and check again"
                ),
            ),
            DialDirection::None => Explained::new(
                format!(
                    "the gauge did not move: the control does not apply the offset, or the gauge does not \
                     measure along {axis}"
                ),
                format!("disarm {axis} and look for the cause"),
            ),
        }
    }
}

impl Command {
    /// Each command with its name in the API and on the socket.
    pub const ALL: [(&'static str, Command); 8] = [
        ("arm", Command::Arm),
        ("disarm", Command::Disarm),
        ("zero", Command::Zero),
        ("cancel", Command::Cancel),
        ("sign", Command::Sign),
        ("sign-plus", Command::Signed(DialDirection::Plus)),
        ("sign-minus", Command::Signed(DialDirection::Minus)),
        ("sign-none", Command::Signed(DialDirection::None)),
    ];

    /// Returns the name in the API and on the socket.
    pub fn name(self) -> &'static str {
        Command::ALL.into_iter().find(|(_, known)| *known == self).map_or("", |(name, _)| name)
    }
}

/// The state of a gateway.
#[derive(Clone, Debug, Serialize)]
pub struct Status {
    /// Name of the machine.
    pub machine: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// Description of the machine.
    pub description: String,
    /// Version of the program.
    pub version: &'static str,
    /// Time of the machine, RFC 3339. In a demo it differs from the wall-clock time.
    pub now: String,
    /// Time zone of the computer, by its IANA name.
    pub zone: String,
    /// Synchronisation of the computer's clock: synchronised, not synchronised, not known; virtual in a demo.
    pub clock: &'static str,
    /// Seconds since the gateway started.
    pub uptime_s: f64,
    /// Seconds since machine start; `None` before the first one.
    pub machine_on_s: Option<f64>,
    /// Language of the web page; `None` means that of the browser.
    #[serde(skip)]
    pub language: Option<Language>,
    /// Settings from layers above the profile.
    pub overridden: Vec<Overridden>,
    /// The gateway writes nothing.
    pub dry_run: bool,
    /// The gateway was asked to stop. States of the axes are no faults then.
    pub stopping: bool,
    /// Every device has answered at least once, and every axis has decided.
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
    /// Registers that belong to no output any more and contain a value of the gateway.
    pub left: Vec<FormerRegisterStatus>,
    /// Number of log rows and states that were lost because the queue to the disk was full.
    pub log_dropped: u64,
    /// Active alarms, newest first.
    pub alarms: Vec<Alarm>,
    /// Last events, oldest first.
    pub events: Vec<Entry>,
    /// Number of events of each kind.
    pub event_counts: BTreeMap<&'static str, u64>,
    /// State of publishing; `None` if nothing is published.
    pub mqtt: Option<BrokerStatus>,
    /// Times for which the lock of the shared state was held: upper bounds in seconds, with their counts.
    #[serde(skip)]
    pub lock_held: Vec<(f64, u64)>,
}

impl Status {
    /// Returns what prevents compensation now, against the operator's intention; empty if nothing does.
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
                "since the start, not all devices have answered or not all axes have decided".into(),
            );
        }
        missing
    }
}

impl AxisStatus {
    /// Returns whether the axis should compensate. An axis without a model should not, and neither should one that the
    /// operator keeps off or that releases a register.
    pub fn is_wanted(&self) -> bool {
        self.has_model && !self.arming.left_off && !self.arming.release
    }

    /// Returns the displayed words for the state.
    pub fn display(&self) -> &'static str {
        self.shown.words()
    }
}

impl DeviceStatus {
    /// Words for the cause of a failed request.
    pub const BLAMES: [&'static str; 5] = ["caller", "link", "peer", "exception", "timeout"];
}

impl OutputStatus {
    /// Words for the state of an output.
    pub const STATES: [&'static str; 6] =
        ["off", "unknown", "verified", "unverified", "interlocked", "foreign"];

    /// Returns the unit of the value.
    pub fn unit(&self) -> &'static str {
        OutputStatus::unit_of(self.writes)
    }

    /// Returns the unit of this kind of output.
    pub fn unit_of(writes: &str) -> &'static str {
        match writes {
            "corrected" | "reference" => "mm",
            "slope" => "µm/mm",
            _ => "µm",
        }
    }
}

/// Serializes one sentence, and its parts if it is not empty.
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
#[derive(Clone, Debug, Serialize)]
pub struct AxisStatus {
    /// Name in the profile.
    pub name: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// State of the decision: off, waiting, active, degraded, holding, ramping, zeroed.
    pub state: &'static str,
    /// Displayed state, from the decision and the verified value. `shown`: the states above, and unmodelled,
    /// sign-check, unreachable. `tone`: good, warn, bad or off.
    #[serde(flatten)]
    pub shown: Display,
    /// The profile has a model for the axis. Without a model it stays off.
    pub has_model: bool,
    /// Condition for which the axis waits, or why the preferred model cannot be used. `why` is one sentence, empty if
    /// there is none; `cause` and `hint` are its parts.
    #[serde(flatten, serialize_with = "in_parts")]
    pub why: Explained,
    /// Request to arm that waits; `None` without one.
    pub waiting: Option<WaitingStatus>,
    /// Name of the model in use; `None` if no model is in use.
    pub model: Option<String>,
    /// Cz that the model requests, µm.
    pub raw_um: Option<f64>,
    /// Expected residual error if the model is followed: one standard deviation, µm. `None` if the profile does not
    /// give it, and outside the range on which the model was identified.
    pub expected_um: Option<f64>,
    /// Cz after the guard, µm. It is the target of the register.
    pub cz_um: f64,
    /// Last verified Cz in the register, µm; `None` before the first one.
    pub verified_um: Option<f64>,
    /// Seconds since the request that verified it.
    pub verified_age_s: Option<f64>,
    /// Guard stages that changed the value: limit, deadband, step, rate, round.
    pub acted: Vec<&'static str>,
    /// Largest absolute value of Cz, µm.
    pub limit_um: f64,
    /// Warning level of |Cz|, µm.
    pub warn_um: Option<f64>,
    /// Whether |Cz| is above the warning level.
    pub warned: bool,
    /// Error level of a model's Cz, µm.
    pub error_um: Option<f64>,
    /// A model has requested more than the error level since the axis was armed.
    pub tripped: bool,
    /// Arming: `armed`, `left_off`, `release`.
    #[serde(flatten)]
    pub arming: ArmingStatus,
    /// Running check of the sign with a dial gauge; `None` without one.
    pub sign: Option<SignStatus>,
    /// Time of the last check of the sign, RFC 3339, and direction in which the gauge moved.
    pub sign_checked: Option<(String, DialDirection)>,
    /// True error of the axis, which only a virtual machine knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<TruthStatus>,
    /// Correction from measured errors; `None` if the profile has no probe.
    pub probe: Option<ProbeStatus>,
    /// Position of the inputs outside the range on which the model in use was identified; `None` inside.
    pub extrapolating: Option<ExtrapolationStatus>,
    /// Distance from that range as a share: above 0 outside, negative inside. `None` if the model has no region.
    pub excess: Option<f64>,
    /// Sensor of the model in use that has a stand-in; `None` if there is none.
    pub stood_in: Option<SubstitutedSensorStatus>,
}

/// Arming of one axis. Its fields are fields of the axis in JSON.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ArmingStatus {
    /// The axis may write.
    pub armed: bool,
    /// The axis is off because the operator has switched it off, or must arm it first.
    pub left_off: bool,
    /// The axis does not compensate. It only returns a register to its base value, because no output uses that register
    /// any more. The logs have no columns for this axis.
    pub release: bool,
}

/// True error of an axis of a virtual machine.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TruthStatus {
    /// Error without compensation, µm.
    pub error_um: f64,
    /// Residual error with the present Cz, µm.
    pub left_um: f64,
}

/// Check of the sign of an axis.
#[derive(Clone, Debug, Serialize)]
pub struct SignStatus {
    /// Person or program that requested it, and channel.
    pub asked: String,
    /// Change of Cz for the check, µm.
    pub by_um: f64,
    /// The offset is reached. The operator may read the gauge.
    pub there: bool,
    /// Seconds until the offset is withdrawn.
    pub expires_s: f64,
    /// Expected movement, in words.
    pub must: String,
}

/// Request to arm that waits.
#[derive(Clone, Debug, Serialize)]
pub struct WaitingStatus {
    /// Person or program that requested it, and channel.
    pub asked: String,
    /// Seconds until it expires.
    pub expires_s: f64,
}

/// Position of a model's inputs outside the range on which it was identified.
#[derive(Clone, Debug, Serialize)]
pub struct ExtrapolationStatus {
    /// Mahalanobis distance of all inputs together; `None` beyond the end of a guideway.
    pub distance: Option<f64>,
    /// Largest distance that is inside.
    pub reach: Option<f64>,
    /// Signal that is farthest beyond its range; `None` if only the combination of the inputs is new.
    pub signal: Option<String>,
    /// Distance beyond the range, in the signal's unit; negative below the smallest value.
    pub beyond: Option<f64>,
    /// Action of the axis: `agree`, `warn`, `hold` or `shrink`.
    pub outside: &'static str,
    /// Factor of the model's Cz.
    pub gain: f64,
    /// Difference of the Cz of the two models whose mean is the model in use, µm; `None` if it has no effect.
    pub apart_um: Option<f64>,
    /// Description of the extrapolation, for display.
    pub text: String,
}

/// Sensor that has a stand-in.
#[derive(Clone, Debug, Serialize)]
pub struct SubstitutedSensorStatus {
    /// Name of the signal.
    pub signal: String,
    /// The reading does not change; else the sensor is lost.
    pub frozen: bool,
    /// Time at which its reading last changed, or was last good.
    pub since: String,
    /// Number of predictors of the stand-in.
    pub others: usize,
}

/// State of one signal.
#[derive(Clone, Debug, Serialize)]
pub struct SignalStatus {
    /// Name in the profile.
    pub name: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// Device in the profile.
    pub device: String,
    /// Last value; `None` if it must not be used.
    pub value: Option<f64>,
    /// Engineering unit of the value.
    pub unit: &'static str,
    /// Quality: `good`, or the code of the reason.
    pub quality: &'static str,
    /// Reason, for display.
    pub reason: String,
    /// Seconds since the measurement; `None` before the first one.
    pub age_s: Option<f64>,
}

/// State of one bus.
#[derive(Clone, Debug, Serialize)]
pub struct BusStatus {
    /// Name in the profile.
    pub name: String,
    /// Host and port, or the serial port or interface.
    pub address: String,
    /// The bus has a connection.
    pub connected: bool,
    /// Number of cycles since the start.
    pub cycles: u64,
    /// Number of cycles that ended later than their period allows.
    pub overruns: u64,
    /// Delays of cycle starts: counts for each upper bound in milliseconds, without those of lower bounds. The last
    /// bound is infinite, which JSON shows as null.
    pub jitter_ms: Vec<(f64, u64)>,
}

/// State of one device.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceStatus {
    /// Name in the profile.
    pub name: String,
    /// Displayed name; empty if the profile has none.
    pub label: String,
    /// Bus in the profile.
    pub bus: String,
    /// Modbus unit, or CANopen node.
    pub unit: u8,
    /// Unit or node as a suffix: ` (unit 3)`, ` (node 5)`; empty for a device that only sends CAN frames.
    #[serde(skip)]
    pub at: String,
    /// State: `ok`, `never-answered` or `lost`.
    pub state: &'static str,
    /// Fault, for display; empty without one.
    pub fault: String,
    /// Number of requests since the start.
    pub requests: u64,
    /// Number of failed requests by cause: timeout, link, peer, exception.
    pub failures: BTreeMap<&'static str, u64>,
}

/// State of one output.
#[derive(Clone, Debug, Serialize)]
pub struct OutputStatus {
    /// Name in the profile.
    pub name: String,
    /// Axis in the profile.
    pub axis: String,
    /// Device in the profile.
    pub device: String,
    /// Register in both notations.
    pub register: String,
    /// Kind of the output: `offset` or `corrected`.
    pub writes: &'static str,
    /// State: `off`, `unknown`, `verified`, `unverified`, `interlocked` or `foreign`.
    pub state: &'static str,
    /// Condition for which its handshake waits, or its last failure; empty if there is neither.
    pub handshake: String,
    /// Last verified value, in the output's unit (µm for an offset, mm for a corrected position).
    pub value: Option<f64>,
    /// Operator offset and gateway share in the value, if the register is shared with the operator.
    pub shares: Option<SharesStatus>,
    /// Value that the control reports as applied, in the output's unit; `None` if it reports none.
    pub applied: Option<f64>,
    /// Note on the value: it waits for a late write, or it is acknowledged and not read back. Empty without a note.
    pub note: String,
    /// Maximum remaining time for which a change waits for a late write, s.
    pub waits_s: Option<f64>,
    /// Number of verified writes.
    pub writes_done: u64,
    /// Seconds since the request that read the value.
    pub age_s: Option<f64>,
}

/// Parts of a shared register value.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SharesStatus {
    /// Operator offset, in the unit of the output.
    pub base: f64,
    /// Gateway share, in the unit of the output.
    pub share: f64,
}

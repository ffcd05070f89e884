//! The state of everything at one moment: what `/api/status`, the page, the metrics and the demo's table are made of.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use super::asker::Asker;
use super::events::file::Found;
use super::events::{Alarm, Entry, Event};
use isotherm_core::compensation::MeasuredReport;
use isotherm_core::display::Display;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Language, Overridden};

mod broker;
mod left;
mod probe;

pub use broker::{BrokerFigures, BrokerStatus};
pub use left::{LeftState, LeftStatus, Wish};
pub use probe::{GainStatus, ProbeStatus, ProbedStatus, WorseStatus};

/// Whoever shows the state of a running gateway, from any thread, without making it wait.
pub trait Source: Send + Sync + 'static {
    /// The state now.
    fn status(&self) -> Status;

    /// Does what somebody asks for, of one axis or of all; the answer is a sentence for a person. What has lapsed by then is
    /// not begun.
    ///
    /// # Errors
    /// A sentence that says why not.
    fn command(&self, command: Command, axis: Option<&str>, asker: &Arc<Asker>) -> Result<Answer, String>;

    /// What has become of the last [`Command::Arm`].
    ///
    /// # Errors
    /// A sentence that says why an axis is not armed, and will not be.
    fn arming(&self, axis: Option<&str>) -> Result<Answer, String>;

    /// What has become of the last [`Command::Sign`]: done when the offset is there.
    ///
    /// # Errors
    /// A sentence that says why it is over.
    fn signing(&self, axis: Option<&str>) -> Result<Answer, String>;

    /// Learns from an axis's measured error; `None` takes back everything that was learned. The answer is a sentence.
    ///
    /// # Errors
    /// A sentence that says why not.
    fn measured(&self, axis: &str, report: Option<MeasuredReport>, asker: &Asker) -> Result<Answer, String>;

    /// Somebody has seen an alarm, or all that stand. The answer is a sentence.
    ///
    /// # Errors
    /// A sentence that says why not.
    fn acknowledge(&self, alarm: Option<&str>, asker: &Asker) -> Result<Answer, String>;

    /// Accepts a device although it differs from the one before: a person has looked at it. The answer is a sentence.
    ///
    /// # Errors
    /// A sentence that says why not.
    fn confirm(&self, device: &str, asker: &Asker) -> Result<Answer, String>;

    /// Takes the wish of a person for the registers of an output that was moved or removed. They are taken back to their base from the
    /// next start on. The answer is a sentence.
    ///
    /// # Errors
    /// A sentence that says why not.
    fn release(&self, output: &str, wish: Wish<'_>, asker: &Asker) -> Result<Answer, String>;

    /// The logs of decisions that may have rows of this span; `None` where none are kept.
    fn logs(&self, from: Moment, to: Moment) -> Option<Vec<PathBuf>>;

    /// A command did not even come as far as that.
    fn turned_away(&self, command: &str, asker: &Asker, why: &str);

    /// Something happened to whoever shows it.
    fn report(&self, event: &Event);

    /// What happened since this moment, before this run too, oldest first, until no more is wanted.
    ///
    /// # Errors
    /// What is kept cannot be read.
    fn events(&self, since: Moment, found: &mut dyn FnMut(Found) -> bool) -> std::io::Result<()>;
}

/// What is said to whoever gave a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It is done.
    Done(String),
    /// It will be, once what the sentence names is over.
    Waits(String),
    /// It is not: the same was asked for a moment ago.
    TooSoon(String),
}

impl Answer {
    /// The sentence.
    pub fn text(&self) -> &str {
        let (Answer::Done(text) | Answer::Waits(text) | Answer::TooSoon(text)) = self;
        text
    }
}

/// What a person may ask of a running gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Let the axes write.
    Arm,
    /// Let them write no more; what stands in the registers stays.
    Disarm,
    /// Capture the "zero" references.
    Zero,
    /// Take back a request to arm that still waits, and a check of a sign.
    Cancel,
    /// Take the Cz of one axis a little way to plus, for a dial gauge.
    Sign,
    /// Say which way the gauge has moved.
    Signed(Moved),
}

/// Which way a dial gauge moved when Cz went to plus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Moved {
    /// As it must.
    Plus,
    /// The other way.
    Minus,
    /// Not at all.
    None,
}

impl Moved {
    /// Each by its name.
    pub const ALL: [(&'static str, Moved); 3] =
        [("plus", Moved::Plus), ("minus", Moved::Minus), ("none", Moved::None)];

    /// Meaning for an axis, and what to do.
    pub fn explained(self, axis: &str) -> Explained {
        match self {
            Moved::Plus => "the gauge moved to plus: the sign is right".into(),
            Moved::Minus => Explained::new(
                "the gauge moved to minus: the sign is WRONG, and every µm makes the error larger",
                format!(
                    "disarm {axis}, turn the sign of `scale` at its output (or the sign in the control), and check again"
                ),
            ),
            Moved::None => Explained::new(
                format!(
                    "the gauge did not move: the control does not apply the offset, or the gauge does not stand along {axis}"
                ),
                format!("disarm {axis} and look for the cause"),
            ),
        }
    }
}

impl Command {
    /// Each by its name in the API and at the socket.
    pub const ALL: [(&'static str, Command); 8] = [
        ("arm", Command::Arm),
        ("disarm", Command::Disarm),
        ("zero", Command::Zero),
        ("cancel", Command::Cancel),
        ("sign", Command::Sign),
        ("sign-plus", Command::Signed(Moved::Plus)),
        ("sign-minus", Command::Signed(Moved::Minus)),
        ("sign-none", Command::Signed(Moved::None)),
    ];

    /// Its name in the API and at the socket.
    pub fn name(self) -> &'static str {
        Command::ALL.into_iter().find(|(_, known)| *known == self).map_or("", |(name, _)| name)
    }
}

/// The state of a gateway.
#[derive(Clone, Debug, Serialize)]
pub struct Status {
    /// The machine's name.
    pub machine: String,
    /// What people call it; empty where the profile does not say.
    pub label: String,
    /// Its description.
    pub description: String,
    /// Program version.
    pub version: &'static str,
    /// RFC 3339; the machine's time, which in a demo is not the wall's.
    pub now: String,
    /// The zone of the computer's clock, by its IANA name.
    pub zone: String,
    /// Whether the computer's clock is held to the right time: synchronised, not synchronised, not known; virtual in a demo.
    pub clock: &'static str,
    /// Seconds since the gateway started.
    pub uptime_s: f64,
    /// Seconds since the machine was switched on, once it was.
    pub machine_on_s: Option<f64>,
    /// The language of the page; `None`: the browser's.
    #[serde(skip)]
    pub language: Option<Language>,
    /// What layers above the profile have set.
    pub overridden: Vec<Overridden>,
    /// Nothing is written.
    pub dry_run: bool,
    /// It was asked to stop: what the axes do now is no fault.
    pub stopping: bool,
    /// Every device answered at least once, and every axis has decided.
    pub ready: bool,
    /// In the profile's order.
    pub axes: Vec<AxisStatus>,
    /// In the profile's order.
    pub signals: Vec<SignalStatus>,
    /// In the profile's order.
    pub buses: Vec<BusStatus>,
    /// In the profile's order.
    pub devices: Vec<DeviceStatus>,
    /// In the profile's order.
    pub outputs: Vec<OutputStatus>,
    /// Registers that are no output's any more and keep a value of ours.
    pub left: Vec<LeftStatus>,
    /// Rows of the log and states that found the queue to the disk full, and are lost.
    pub log_dropped: u64,
    /// What went wrong and has not come to its end, the newest first.
    pub alarms: Vec<Alarm>,
    /// The last events, oldest first.
    pub events: Vec<Entry>,
    /// How often each kind of event happened.
    pub event_counts: BTreeMap<&'static str, u64>,
    /// How publishing goes; `None` where nothing is published.
    pub mqtt: Option<BrokerStatus>,
    /// Upper bounds in seconds, and how often the lock of the shared state was held for so long.
    #[serde(skip)]
    pub lock_held: Vec<(f64, u64)>,
}

impl Status {
    /// What keeps the machine from being held to its cold geometry now, against people's wish, in words; empty where nothing does.
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
    /// Returns whether the axis is to compensate. One without a model is not, nor one that a person keeps off or that takes a register
    /// back.
    pub fn is_wanted(&self) -> bool {
        self.has_model && !self.left_off && !self.release
    }

    /// The words for it that people see.
    pub fn display(&self) -> &'static str {
        self.shown.words()
    }
}

impl DeviceStatus {
    /// Every word for who is to blame for a request that failed.
    pub const BLAMES: [&'static str; 5] = ["caller", "link", "peer", "exception", "timeout"];
}

impl OutputStatus {
    /// Every word for its state.
    pub const STATES: [&'static str; 6] =
        ["off", "unknown", "verified", "unverified", "interlocked", "foreign"];

    /// The unit of its value.
    pub fn unit(&self) -> &'static str {
        OutputStatus::unit_of(self.writes)
    }

    /// The unit of what is written so.
    pub fn unit_of(writes: &str) -> &'static str {
        match writes {
            "corrected" | "reference" => "mm",
            "slope" => "µm/mm",
            _ => "µm",
        }
    }
}

/// One sentence, and its parts if there is something to say.
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

/// One axis.
#[derive(Clone, Debug, Serialize)]
pub struct AxisStatus {
    /// Name in the profile.
    pub name: String,
    /// What people call it; empty where the profile does not say.
    pub label: String,
    /// off, waiting, active, degraded, holding, ramping, zeroed: what is decided.
    pub state: &'static str,
    /// State as people see it, from the decision and the verified value: `shown` (these, unmodelled, sign-check, unreachable), and in
    /// `tone` how alarming that is (good, warn, bad, off).
    #[serde(flatten)]
    pub shown: Display,
    /// The profile has a model for it; without one it stays off.
    pub has_model: bool,
    /// What it waits for, or what the preferred model lacks: `why` in one sentence, empty where nothing; `cause` and `hint`.
    #[serde(flatten, serialize_with = "in_parts")]
    pub why: Explained,
    /// Somebody asked for it to be armed, which could not be done yet.
    pub waiting: Option<WaitingStatus>,
    /// The model in use.
    pub model: Option<String>,
    /// The model's Cz, µm.
    pub raw_um: Option<f64>,
    /// What is expected to be left of the error where the model is followed: one standard deviation, µm. `None` where the
    /// profile does not say, and outside what the model was identified on.
    pub expected_um: Option<f64>,
    /// Cz after the guard, µm: what is wanted.
    pub cz_um: f64,
    /// Cz as last verified in its register, µm: what stands there; `None` where it was never read.
    pub verified_um: Option<f64>,
    /// Seconds since that was asked.
    pub verified_age_s: Option<f64>,
    /// The stages of the guard that acted: limit, deadband, step, rate, round.
    pub acted: Vec<&'static str>,
    /// Largest |Cz|, µm.
    pub limit_um: f64,
    /// |Cz| at which people are warned, µm.
    pub warn_um: Option<f64>,
    /// |Cz| lies beyond it.
    pub warned: bool,
    /// The size of a model's Cz at which the axis gives up, µm.
    pub error_um: Option<f64>,
    /// A model asked for more than that since the axis was armed.
    pub tripped: bool,
    /// It may write.
    pub armed: bool,
    /// It is off because people want it so: one has switched it off, or is to arm it first.
    pub left_off: bool,
    /// The axis compensates nothing: it takes a register that is no output's any more back to its base. No log has its columns.
    pub release: bool,
    /// Its sign is being checked with a dial gauge.
    pub sign: Option<SignStatus>,
    /// When its sign was checked last, RFC 3339, and which way the gauge moved.
    pub sign_checked: Option<(String, Moved)>,
    /// What is true of it; only a virtual machine knows that.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<TruthStatus>,
    /// What measured errors have taught it; `None` where the profile has no probe.
    pub probe: Option<ProbeStatus>,
    /// The inputs lie outside what the model in use was identified on.
    pub extrapolating: Option<ExtrapolationStatus>,
    /// How far outside that is, as a share: above 0 outside, negative inside; `None` where the model has no region.
    pub excess: Option<f64>,
    /// A sensor of the model in use that others stand in for.
    pub stood_in: Option<StoodInStatus>,
}

/// What is true of an axis of a virtual machine.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TruthStatus {
    /// The error without compensation, µm.
    pub error_um: f64,
    /// What is left of it, µm.
    pub left_um: f64,
}

/// A check of the sign of an axis.
#[derive(Clone, Debug, Serialize)]
pub struct SignStatus {
    /// Who asked, and by which way.
    pub asked: String,
    /// How far Cz is taken, µm.
    pub by_um: f64,
    /// The offset is there: a person may look.
    pub there: bool,
    /// Seconds until it is taken back.
    pub expires_s: f64,
    /// Which way what must have moved, in words.
    pub must: String,
}

/// A request to arm that waits.
#[derive(Clone, Debug, Serialize)]
pub struct WaitingStatus {
    /// Who asked, and by which way.
    pub asked: String,
    /// Seconds until it expires.
    pub expires_s: f64,
}

/// How far a model's inputs lie outside what it was identified on.
#[derive(Clone, Debug, Serialize)]
pub struct ExtrapolationStatus {
    /// Mahalanobis distance of all inputs together; `None` where only a guideway ends.
    pub distance: Option<f64>,
    /// The largest distance that is inside.
    pub reach: Option<f64>,
    /// The signal that is farthest beyond its smallest or largest value; `None` where only the combination is new.
    pub signal: Option<String>,
    /// By how much, in its unit; negative below the smallest.
    pub beyond: Option<f64>,
    /// `agree`, `warn`, `hold`, `shrink`.
    pub outside: &'static str,
    /// What the model's Cz is multiplied with.
    pub gain: f64,
    /// What the two halves of the model differ by, µm; `None` where that is not asked.
    pub apart_um: Option<f64>,
    /// All of it in words.
    pub text: String,
}

/// A sensor that others stand in for.
#[derive(Clone, Debug, Serialize)]
pub struct StoodInStatus {
    /// Which.
    pub signal: String,
    /// It reads the same all the time; else it is lost.
    pub frozen: bool,
    /// Its reading last changed, or was last good, then.
    pub since: String,
    /// How many others say what it would read.
    pub others: usize,
}

/// One signal.
#[derive(Clone, Debug, Serialize)]
pub struct SignalStatus {
    /// Name in the profile.
    pub name: String,
    /// What people call it; empty where the profile does not say.
    pub label: String,
    /// Device in the profile.
    pub device: String,
    /// The last value, where it may be used.
    pub value: Option<f64>,
    /// Engineering unit.
    pub unit: &'static str,
    /// `good`, or the reason's code.
    pub quality: &'static str,
    /// The reason in words.
    pub reason: String,
    /// Seconds since it was taken; `None` before the first.
    pub age_s: Option<f64>,
}

/// One line.
#[derive(Clone, Debug, Serialize)]
pub struct BusStatus {
    /// Name in the profile.
    pub name: String,
    /// Host and port.
    pub address: String,
    /// There is a connection.
    pub connected: bool,
    /// Cycles run.
    pub cycles: u64,
    /// Cycles that ended later than their period allowed.
    pub overruns: u64,
    /// How late cycles began, as counts per upper bound in milliseconds: of this bound alone, not of those below
    /// it too. The last bound is infinite, which JSON shows as null.
    pub jitter_ms: Vec<(f64, u64)>,
}

/// One device.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceStatus {
    /// Name in the profile.
    pub name: String,
    /// What people call it; empty where the profile does not say.
    pub label: String,
    /// Bus in the profile.
    pub bus: String,
    /// Modbus unit, or CANopen node.
    pub unit: u8,
    /// The same as people say it: ` (unit 3)`, ` (node 5)`, nothing for what only sends CAN frames.
    #[serde(skip)]
    pub at: String,
    /// `ok`, `never-answered`, `lost`.
    pub state: &'static str,
    /// What is wrong, in words; empty where nothing.
    pub fault: String,
    /// Requests sent.
    pub requests: u64,
    /// Requests that failed, by blame: timeout, link, peer, exception.
    pub failures: BTreeMap<&'static str, u64>,
}

/// One output.
#[derive(Clone, Debug, Serialize)]
pub struct OutputStatus {
    /// Name in the profile.
    pub name: String,
    /// Axis in the profile.
    pub axis: String,
    /// Device in the profile.
    pub device: String,
    /// The register in both notations.
    pub register: String,
    /// `offset` or `corrected`.
    pub writes: &'static str,
    /// `off`, `unknown`, `verified`, `unverified`, `interlocked`, `foreign`.
    pub state: &'static str,
    /// What its handshake waits for, or failed at last; empty where neither, or where it has none.
    pub handshake: String,
    /// The last verified value, in the output's unit (µm for an offset, mm for a corrected position).
    pub value: Option<f64>,
    /// Of that, the operator's part and ours, where the register is shared with an operator.
    pub shares: Option<SharesStatus>,
    /// What the control says it applies, in the output's unit, where it says so.
    pub applied: Option<f64>,
    /// What else is to be known of the value: that it waits for a late write, or is acknowledged and not read back. Empty
    /// where nothing is.
    pub note: String,
    /// How long a change still waits for what may arrive late, at most.
    pub waits_s: Option<f64>,
    /// Writes that were verified.
    pub writes_done: u64,
    /// Seconds since what stands there was asked.
    pub age_s: Option<f64>,
}

/// Whose a register's value is.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SharesStatus {
    /// The operator's.
    pub base: f64,
    /// Ours.
    pub share: f64,
}

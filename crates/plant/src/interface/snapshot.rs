//! State of a gateway at one time, as a list of metrics.

use std::fmt;

use isotherm_core::quantity::{Moment, Shift};

/// Metrics and events of a gateway at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Metrics, in an order that stays the same for the whole run of the gateway.
    pub metrics: Vec<Metric>,
    /// Events since the previous snapshot, oldest first.
    pub events: Vec<PlantEvent>,
    /// Shift from the monotonic time `now` of the [`Publisher`](super::Publisher) to wall-clock time.
    pub shift: Shift,
}

/// Current value of one number, text or flag of the gateway.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Part of the machine or of the gateway that the metric describes.
    pub subject: Subject,
    /// Name within its subject, for example `cz_um`.
    pub name: &'static str,
    /// Current value; `None` if it is not known.
    pub value: Option<Value>,
    /// Example value that gives the type of the metric even if `value` is `None`. It never changes.
    pub kind: Value,
    /// Unit; empty if the metric has none.
    pub unit: &'static str,
    /// Smallest change that is published, in the unit of the metric; 0 if every change is published.
    pub resolution: f64,
    /// Wall-clock time of the value; zero if it has never been known.
    pub at: Moment,
}

/// Part of the machine or of the gateway that a metric describes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Subject {
    /// Gateway as a whole.
    Gateway,
    /// Axis, by its name in the profile.
    Axis(String),
    /// Signal, by its name in the profile.
    Signal(String),
    /// Output, by its name in the profile.
    Output(String),
    /// Device, by its name in the profile.
    Device(String),
    /// Bus, by its name in the profile.
    Bus(String),
}

impl Subject {
    /// Returns the kind and the name of the subject, for example `axis` and `z`. The name of the gateway is empty.
    pub fn parts(&self) -> (&'static str, &str) {
        match self {
            Subject::Gateway => ("gateway", ""),
            Subject::Axis(name) => ("axis", name),
            Subject::Signal(name) => ("signal", name),
            Subject::Output(name) => ("output", name),
            Subject::Device(name) => ("device", name),
            Subject::Bus(name) => ("bus", name),
        }
    }
}

/// Formats the subject as part of a topic or metric name, for example `axis/z` or `gateway`.
impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.parts() {
            (sort, "") => f.write_str(sort),
            (sort, name) => write!(f, "{sort}/{name}"),
        }
    }
}

/// Value of a type that both message formats (JSON and Sparkplug B) support.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Real number; always finite.
    Real(f64),
    /// Unsigned integer.
    Count(u64),
    /// Boolean.
    Flag(bool),
    /// Text.
    Text(String),
}

impl Value {
    /// Returns whether two real numbers are equal or differ by less than `resolution`. Values of other types must be
    /// equal.
    pub fn is_near(&self, other: &Value, resolution: f64) -> bool {
        match (self, other) {
            (Value::Real(one), Value::Real(other)) => {
                one.total_cmp(other).is_eq() || (one - other).abs() < resolution
            }
            (one, other) => one == other,
        }
    }
}

/// Event of the gateway, for publication.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantEvent {
    /// Wall-clock time of the event.
    pub at: Moment,
    /// Kind of the event, for programs, for example `axis-state`.
    pub kind: String,
    /// Importance of the event.
    pub importance: Importance,
    /// Description of the event for people, as text.
    pub text: String,
    /// Details of the event as JSON; empty if the event has none.
    pub data: String,
}

/// Importance of an event for the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Importance {
    /// Information that requires no attention.
    Info,
    /// The operator should know about the event.
    Warning,
    /// The operator should act.
    Error,
}

impl Importance {
    /// Returns the name of the importance in MQTT messages.
    pub fn name(self) -> &'static str {
        match self {
            Importance::Info => "info",
            Importance::Warning => "warning",
            Importance::Error => "error",
        }
    }
}

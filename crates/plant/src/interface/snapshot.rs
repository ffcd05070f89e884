//! State of a gateway at one time, as a list of metrics.

use std::fmt;

use isotherm_core::quantity::{Moment, Shift};

/// Metrics and events of a gateway at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Metrics. As long as the gateway runs, they are the same ones in the same order.
    pub metrics: Vec<Metric>,
    /// Events since the snapshot before, oldest first.
    pub events: Vec<PlantEvent>,
    /// Difference between the publisher's `now` and wall-clock time.
    pub shift: Shift,
}

/// A number, word or flag.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Subject of the metric.
    pub subject: Subject,
    /// Name within its subject, for example `cz_um`.
    pub name: &'static str,
    /// Value; `None` if it is not known now.
    pub value: Option<Value>,
    /// An empty value of its type, which never changes.
    pub kind: Value,
    /// Unit; empty without one.
    pub unit: &'static str,
    /// Smallest change that counts; 0 if every change counts.
    pub resolution: f64,
    /// Wall-clock time of the value.
    pub at: Moment,
}

/// Subject of a metric.
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
    /// Returns the kind and the name; the gateway has an empty name.
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

/// Formats the subject: `axis/z`, `gateway`.
impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.parts() {
            (sort, "") => f.write_str(sort),
            (sort, name) => write!(f, "{sort}/{name}"),
        }
    }
}

/// Value of a type that both formats support.
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
    /// Returns whether both values are equal, or differ by less than the resolution.
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
    /// Kind for programs: `axis-state`.
    pub kind: String,
    /// Importance of the event.
    pub importance: Importance,
    /// Text for people.
    pub text: String,
    /// Parts of the text as JSON; empty without more data.
    pub data: String,
}

/// Importance of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Importance {
    /// Information that requires no attention.
    Info,
    /// A person should know about it.
    Warning,
    /// A person should act.
    Error,
}

impl Importance {
    /// Returns the name of the importance in messages.
    pub fn name(self) -> &'static str {
        match self {
            Importance::Info => "info",
            Importance::Warning => "warning",
            Importance::Error => "error",
        }
    }
}

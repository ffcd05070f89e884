//! The state of a gateway at one moment, as a list of figures.

use std::fmt;

use isotherm_core::quantity::{Moment, Shift};

/// Everything that is told of a gateway at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Always the same ones in the same order, as long as the gateway runs.
    pub metrics: Vec<Metric>,
    /// What has happened since the snapshot before, oldest first.
    pub events: Vec<Happening>,
    /// What brings the publisher's `now` to the time of day.
    pub shift: Shift,
}

/// One figure, word or flag.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// What it is of.
    pub subject: Subject,
    /// Its name among those of its subject: `cz_um`.
    pub name: &'static str,
    /// `None`: not known now.
    pub value: Option<Value>,
    /// An empty value of the type that it always has.
    pub kind: Value,
    /// Its unit; empty where it has none.
    pub unit: &'static str,
    /// A smaller change is none; 0 where each one counts.
    pub resolution: f64,
    /// When it was taken, by the wall's clock.
    pub at: Moment,
}

/// What a metric is of.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Subject {
    /// The gateway as a whole.
    Gateway,
    /// An axis, by its name in the profile; so are the others.
    Axis(String),
    /// A signal.
    Signal(String),
    /// An output.
    Output(String),
    /// A device.
    Device(String),
    /// A bus.
    Bus(String),
}

impl Subject {
    /// The word for its sort, and its name; the gateway has none.
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

/// `axis/z`, `gateway`.
impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.parts() {
            (sort, "") => f.write_str(sort),
            (sort, name) => write!(f, "{sort}/{name}"),
        }
    }
}

/// A value of one of the few types that both formats have.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A real number; always finite.
    Real(f64),
    /// A count.
    Count(u64),
    /// Yes or no.
    Flag(bool),
    /// A word or a sentence.
    Text(String),
}

impl Value {
    /// It is the same, or differs by less than the resolution.
    pub fn is_near(&self, other: &Value, resolution: f64) -> bool {
        match (self, other) {
            (Value::Real(one), Value::Real(other)) => {
                one.total_cmp(other).is_eq() || (one - other).abs() < resolution
            }
            (one, other) => one == other,
        }
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct Happening {
    /// When, by the wall's clock.
    pub at: Moment,
    /// One word for programs: `axis-state`.
    pub kind: String,
    /// How much it matters.
    pub importance: Importance,
    /// The sentence.
    pub text: String,
    /// What the sentence is made of, as JSON; empty where there is nothing more.
    pub data: String,
}

/// How much something matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Importance {
    /// For the record.
    Info,
    /// Somebody should know.
    Warning,
    /// Somebody should act.
    Error,
}

impl Importance {
    /// Its word.
    pub fn name(self) -> &'static str {
        match self {
            Importance::Info => "info",
            Importance::Warning => "warning",
            Importance::Error => "error",
        }
    }
}

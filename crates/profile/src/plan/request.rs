//! Read requests: the registers or other items to read, and the position of each signal in the answer.

use std::fmt;
use std::time::Duration;

use crate::Profile;
use crate::document::{Section, entries};
use crate::wording::counted;
use isotherm_core::codec::{Node, Object, PcSensor, Quoted, Register, TextValue};
use isotherm_core::reading::SignalId;

/// Read request with the position of each signal in its answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadRequest {
    /// Registers, object, nodes, sensors or texts to read.
    pub asks: ReadTarget,
    /// Values and scales of signals in the answer. Never empty.
    pub fields: Vec<Field>,
}

/// Target of a read request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadTarget {
    /// Adjacent registers or bits of one table.
    Registers {
        /// First register or bit.
        from: Register,
        /// Number of registers or bits.
        count: u16,
    },
    /// Object of a CANopen node.
    Object(Object),
    /// Nodes of an OPC UA server. Each node is one field of the answer.
    Nodes(Vec<Node>),
    /// Latest values that the server has sent for the subscribed nodes.
    Subscription(Subscription),
    /// Sensors of this computer. Each sensor is one field of the answer.
    Sensors(Vec<PcSensor>),
    /// Values in lines of text that the same request returns. Each value is one field of the answer.
    Texts(Vec<TextValue>),
}

/// Nodes whose values an OPC UA server sends when they change. Each node is one field of the answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    /// Subscribed nodes.
    pub nodes: Vec<Node>,
    /// Interval at which the server samples the nodes.
    pub every: Duration,
    /// Smallest `max_age` (maximum age of a reading) among the signals of the subscribed nodes.
    pub max_age: Duration,
    /// Whether the server also sends a value if only its timestamp changed. The timestamp then shows when the value was
    /// measured.
    pub by_stamp: bool,
}

/// Field of an answer: kind, position and length of a signal's value or scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Signal that the field belongs to.
    pub signal: SignalId,
    /// Kind of content: the value of the signal, or its scale.
    pub content: FieldContent,
    /// Index of the field's first register, bit or node, counted from the beginning of the answer.
    pub at: u16,
    /// Number of registers or bits in the field. For an OPC UA node, the number of registers for a value of its type.
    pub len: u16,
}

/// Content of a field of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldContent {
    /// Value of the signal.
    Value,
    /// Power of ten of the signal's scale.
    Scale,
}

impl Field {
    /// Creates the field of a value at the beginning of an answer, with this number of registers or bits.
    pub const fn value(signal: SignalId, len: u16) -> Field {
        Field { signal, content: FieldContent::Value, at: 0, len }
    }

    /// Creates the field of a scale at the beginning of an answer, with this number of registers.
    pub const fn scale(signal: SignalId, len: u16) -> Field {
        Field { signal, content: FieldContent::Scale, at: 0, len }
    }
}

/// Sets the position of each field in the answer: 0, 1, 2, … in the order of the list. Returns the fields and their
/// targets as two lists.
pub(crate) fn numbered<T>(parts: Vec<(Field, T)>) -> (Vec<Field>, Vec<T>) {
    parts.into_iter().zip(0..).map(|((field, part), at)| (Field { at, ..field }, part)).unzip()
}

impl ReadTarget {
    /// Returns the number of registers, bits, nodes, sensors or texts in the target, and their name in the singular.
    /// The number is 0 for a CANopen object.
    fn cells(&self) -> (usize, &'static str) {
        match self {
            ReadTarget::Registers { from, count } if from.table.is_bits() => (usize::from(*count), "bit"),
            ReadTarget::Registers { count, .. } => (usize::from(*count), "register"),
            ReadTarget::Object(_) => (0, ""),
            ReadTarget::Nodes(nodes) | ReadTarget::Subscription(Subscription { nodes, .. }) => {
                (nodes.len(), "node")
            }
            ReadTarget::Sensors(sensors) => (sensors.len(), "sensor"),
            ReadTarget::Texts(texts) => (texts.len(), "text"),
        }
    }
}

impl ReadRequest {
    /// Returns the first register or bit, and the number of registers or bits. `None` if the target is not in
    /// registers.
    pub const fn span(&self) -> Option<(Register, u16)> {
        if let ReadTarget::Registers { from, count } = self.asks { Some((from, count)) } else { None }
    }

    /// Iterates over the fields that contain the value of a signal.
    pub fn values(&self) -> impl Iterator<Item = &Field> {
        self.fields.iter().filter(|field| field.content == FieldContent::Value)
    }

    /// Iterates over the fields that contain the scale of a signal.
    pub fn scales(&self) -> impl Iterator<Item = &Field> {
        self.fields.iter().filter(|field| field.content == FieldContent::Scale)
    }

    /// Returns whether the answer contains the scale of this signal.
    pub fn has_scale_of(&self, signal: SignalId) -> bool {
        self.scales().any(|field| field.signal == signal)
    }

    /// Returns whether the answer contains the scale of a value that is read with another request.
    pub(crate) fn has_scale_of_another(&self) -> bool {
        self.scales().any(|scale| self.values().all(|value| value.signal != scale.signal))
    }

    /// Returns the names of the signals in the answer. If the answer contains only the scale of a signal, the name
    /// begins with "scale of".
    pub fn signals(&self, profile: &Profile) -> Vec<String> {
        let name = |field: &Field| profile.signal(field.signal).name.clone();
        let is_read = |signal| self.values().any(|field| field.signal == signal);
        let scales = self.scales().filter(|field| !is_read(field.signal));
        let scales = scales.map(|field| format!("scale of {}", name(field)));
        self.values().map(name).chain(scales).collect()
    }

    /// Returns the preview of the request and the signals in its answer.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let function = self.span().map_or(0, |(from, _)| from.table.read_function());
        let signals = self.signals(profile);
        let mut section = Section::default();
        section.line(match function {
            0 => format!("    {self}: {}", signals.join(", ")),
            _ => format!("    {self}, function {function:02}: {}", signals.join(", ")),
        });
        entries!(section, read = self.to_string(), function, signals);
        section
    }

    /// Returns the sort key of the request among the requests of a device: first the address, then the signal.
    pub(crate) fn rank(&self) -> (Option<(Register, u16)>, SignalId) {
        (self.span(), self.fields[0].signal)
    }
}

/// Formats the request, for example as `read input:0..7 (30001..30008), 8 registers`.
impl fmt::Display for ReadRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, count) = match &self.asks {
            ReadTarget::Registers { from, count } => (*from, *count),
            ReadTarget::Object(object) => return write!(f, "read {object}"),
            ReadTarget::Sensors(sensors) if sensors.len() == 1 => return write!(f, "read 1 sensor"),
            ReadTarget::Sensors(sensors) => return write!(f, "read {} sensors at once", sensors.len()),
            ReadTarget::Texts(texts) => {
                return match texts.first().map_or("", |text| text.request.as_str()) {
                    "" => write!(f, "receive {}", counted(texts.len(), "text")),
                    request => {
                        write!(f, "send {}, receive {}", Quoted(request), counted(texts.len(), "text"))
                    }
                };
            }
            ReadTarget::Nodes(nodes) => return write!(f, "read {}", counted(nodes.len(), "node")),
            ReadTarget::Subscription(Subscription { nodes, .. }) => {
                return write!(f, "subscribe to {}", counted(nodes.len(), "node"));
            }
        };
        let last = Register { offset: first.offset.saturating_add(count - 1), ..first };
        let cells = if first.table.is_bits() { "bit" } else { "register" };
        if first == last {
            write!(f, "read {first} ({})", first.modicon())?;
        } else {
            write!(f, "read {first}..{} ({}..{})", last.offset, first.modicon(), last.modicon())?;
        }
        write!(f, ", {}", counted(count, cells))
    }
}

/// Summarises requests, for example as `3 requests touching 17 registers for 9 signals`.
pub fn summary(requests: &[ReadRequest]) -> String {
    if requests.is_empty() {
        return "nothing is read".to_owned();
    }
    let touched = |what: &str| -> usize {
        let cells = requests.iter().map(|request| request.asks.cells());
        cells.filter(|(_, own)| *own == what).map(|(count, _)| count).sum()
    };
    let cells: Vec<String> = ["register", "bit", "node", "sensor", "text"]
        .into_iter()
        .map(|what| (touched(what), what))
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| counted(count, what))
        .collect();
    let signals: usize = requests.iter().map(|request| request.values().count()).sum();
    format!(
        "{} touching {} for {}",
        counted(requests.len(), "request"),
        cells.join(" and "),
        counted(signals, "signal")
    )
}

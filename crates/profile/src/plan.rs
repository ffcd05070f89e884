//! Which requests read a device: pure, from its signals to the fewest read requests.
//!
//! Neighbours in one table share a request, also across a few registers that nobody asked for: a request costs a
//! round trip, a register two bytes. A device that refuses registers it does not have wants `max_gap = 0`; one that
//! serves a register wrongly among others has signals with `merge = false`. A CANopen object is a request of its own, what
//! comes in CAN frames is not asked for, and all nodes of an OPC UA server are one request, or one subscription. So are all sensors
//! of this computer that belong to one device: they are read at once.

use std::fmt;
use std::time::Duration;

use crate::document::Section;
use crate::wording::counted;
use crate::{Device, Profile, Quirks, ReadBy, Signal, SourceTime};
use isotherm_core::codec::{Address, Node, Object, PcSensor, Register};
use isotherm_core::reading::SignalId;

/// Most coils or discrete inputs that one request may ask for, by the protocol.
const MAX_BITS: u16 = 2000;

/// One read request, and which of its registers belong to whom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadRequest {
    /// What is asked for.
    pub asks: ReadTarget,
    /// What the answer holds. Never empty.
    pub fields: Vec<Field>,
}

/// What one read request asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ReadTarget {
    /// Neighbours of one table.
    Registers {
        /// First register or bit.
        from: Register,
        /// How many.
        count: u16,
    },
    /// One object of a CANopen node.
    Object(Object),
    /// Nodes of an OPC UA server, each a field of the answer.
    Nodes(Vec<Node>),
    /// What the server has sent of such nodes.
    Subscription(Subscription),
    /// Sensors of this computer, each a field of the answer.
    Sensors(Vec<PcSensor>),
}

/// Nodes that an OPC UA server sends by itself, each a field of the answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    /// Which.
    pub nodes: Vec<Node>,
    /// How often it looks at them, and sends what has changed.
    pub every: Duration,
    /// How old the youngest of their values may become.
    pub max_age: Duration,
    /// A value is sent for its time stamp alone, too: that says when it was measured.
    pub by_stamp: bool,
}

/// The part of an answer that is one signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Whose.
    pub signal: SignalId,
    /// Its first register or bit, or its node, counted from the beginning of the answer.
    pub at: u16,
    /// How many registers or bits; of a node, those of its value.
    pub len: u16,
}

/// The fewest requests that read these signals of one device, by table and address.
///
/// A value of several registers is never torn apart, even where it is longer than the device's limit.
pub fn plan<'a>(
    device: &Device,
    signals: impl IntoIterator<Item = (SignalId, &'a Signal)>,
) -> Vec<ReadRequest> {
    let quirks = &device.quirks;
    let mut requests: Vec<ReadRequest> = Vec::new();
    let mut together: Vec<ReadRequest> = Vec::new();
    let mut nodes: Vec<(Field, Node)> = Vec::new();
    let mut sensors: Vec<(Field, PcSensor)> = Vec::new();
    let mut max_age = Duration::MAX;
    for (id, signal) in signals {
        let data_type = signal.encoding.data_type;
        let field = Field { signal: id, at: 0, len: data_type.registers() };
        let asks = match &signal.address {
            Address::Modbus(from) => ReadTarget::Registers { from: *from, count: data_type.registers() },
            Address::Object(object) => ReadTarget::Object(*object),
            Address::Node(node) => {
                nodes.push((field, node.clone()));
                max_age = max_age.min(signal.max_age);
                continue;
            }
            Address::Sensor(sensor) => {
                sensors.push((field, sensor.clone()));
                continue;
            }
            // Nobody can be asked for it.
            Address::Frame(_) => continue,
        };
        let fields = vec![field];
        let shares = signal.merge && !quirks.one_request_per_field && signal.address.register().is_some();
        if shares { &mut together } else { &mut requests }.push(ReadRequest { asks, fields });
    }
    together.sort_by_key(ReadRequest::rank);
    let mut merged: Vec<ReadRequest> = Vec::new();
    for next in together {
        let is_taken = merged.last_mut().is_some_and(|last| last.takes(&next, quirks));
        if !is_taken {
            merged.push(next);
        }
    }
    requests.extend(merged);
    requests.extend(all_nodes(nodes, device, max_age));
    requests.extend(all_sensors(sensors));
    requests.sort_by_key(ReadRequest::rank);
    requests
}

/// The one request that brings all of these.
fn all_nodes(nodes: Vec<(Field, Node)>, device: &Device, max_age: Duration) -> Option<ReadRequest> {
    let (fields, nodes) = numbered(nodes);
    let by_stamp = device.source_time == Some(SourceTime::Sampled);
    let asks = match device.read {
        ReadBy::Poll => ReadTarget::Nodes(nodes),
        ReadBy::Subscription => {
            ReadTarget::Subscription(Subscription { nodes, every: device.every, max_age, by_stamp })
        }
    };
    (!fields.is_empty()).then_some(ReadRequest { asks, fields })
}

/// The one request that brings all of these.
fn all_sensors(sensors: Vec<(Field, PcSensor)>) -> Option<ReadRequest> {
    let (fields, sensors) = numbered(sensors);
    (!fields.is_empty()).then_some(ReadRequest { asks: ReadTarget::Sensors(sensors), fields })
}

/// Each with its place in the answer.
fn numbered<T>(parts: Vec<(Field, T)>) -> (Vec<Field>, Vec<T>) {
    parts.into_iter().zip(0..).map(|((field, part), at)| (Field { at, ..field }, part)).unzip()
}

impl ReadRequest {
    /// The first register or bit, and how many; `None` for an object, nodes and sensors.
    pub const fn span(&self) -> Option<(Register, u16)> {
        if let ReadTarget::Registers { from, count } = self.asks { Some((from, count)) } else { None }
    }

    /// The names of the signals in its answer.
    pub fn signals<'a>(&self, profile: &'a Profile) -> Vec<&'a str> {
        self.fields.iter().map(|field| profile.signal(field.signal).name.as_str()).collect()
    }

    /// The request and the signals in its answer.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let function = self.span().map_or(0, |(from, _)| from.table.read_function());
        let signals = self.signals(profile);
        let mut section = Section::default();
        section.line(match function {
            0 => format!("    {self}: {}", signals.join(", ")),
            _ => format!("    {self}, function {function:02}: {}", signals.join(", ")),
        });
        section.entry("read", self.to_string());
        section.entry("function", function);
        section.entry("signals", signals);
        section
    }

    fn rank(&self) -> (Option<(Register, u16)>, SignalId) {
        (self.span(), self.fields[0].signal)
    }

    /// Takes in the one that follows it by address, so that only its end can move; `false` where that is too far away or
    /// would make it too long.
    fn takes(&mut self, next: &ReadRequest, quirks: &Quirks) -> bool {
        let (ReadTarget::Registers { from, count }, Some((start, len))) = (&mut self.asks, next.span())
        else {
            return false;
        };
        let limit = if from.table.is_bits() { MAX_BITS } else { quirks.max_registers_per_request };
        let at = start.offset.saturating_sub(from.offset);
        let is_near = u32::from(at) <= u32::from(*count) + u32::from(quirks.max_gap);
        let whole = (*count).max(at.saturating_add(len));
        let fits = from.table == start.table && is_near && whole <= limit;
        if fits {
            *count = whole;
            self.fields.extend(next.fields.iter().map(|field| Field { at, ..*field }));
        }
        fits
    }
}

/// `read input:0..7 (30001..30008), 8 registers`.
impl fmt::Display for ReadRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, count) = match &self.asks {
            ReadTarget::Registers { from, count } => (*from, *count),
            ReadTarget::Object(object) => return write!(f, "read {object}"),
            ReadTarget::Sensors(sensors) if sensors.len() == 1 => return write!(f, "read 1 sensor"),
            ReadTarget::Sensors(sensors) => return write!(f, "read {} sensors at once", sensors.len()),
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

/// `3 requests touching 17 registers for 9 signals`.
pub fn summary(requests: &[ReadRequest]) -> String {
    if requests.is_empty() {
        return "nothing is read".to_owned();
    }
    let touched = |bits: bool| {
        let spans = requests.iter().filter_map(ReadRequest::span);
        spans.filter(|(from, _)| from.table.is_bits() == bits).map(|(_, count)| usize::from(count)).sum()
    };
    let (registers, bits): (usize, usize) = (touched(false), touched(true));
    let nodes = requests.iter().map(|request| match &request.asks {
        ReadTarget::Nodes(nodes) | ReadTarget::Subscription(Subscription { nodes, .. }) => nodes.len(),
        ReadTarget::Registers { .. } | ReadTarget::Object(_) | ReadTarget::Sensors(_) => 0,
    });
    let sensors = requests.iter().map(|request| match &request.asks {
        ReadTarget::Sensors(sensors) => sensors.len(),
        _ => 0,
    });
    let (nodes, sensors) = (nodes.sum(), sensors.sum());
    let cells: Vec<String> = [(registers, "register"), (bits, "bit"), (nodes, "node"), (sensors, "sensor")]
        .into_iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| counted(count, what))
        .collect();
    let signals: usize = requests.iter().map(|request| request.fields.len()).sum();
    format!(
        "{} touching {} for {}",
        counted(requests.len(), "request"),
        cells.join(" and "),
        counted(signals, "signal")
    )
}

#[cfg(test)]
mod tests;

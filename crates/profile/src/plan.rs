//! Plan of the requests that read a device: the fewest read requests for its signals. The calculation has no side
//! effects.
//!
//! Registers that are close to each other in one table share a request, even if a few registers in between are not
//! needed. A request costs a round trip, a register only two bytes. A device that rejects requests with unused
//! registers needs `max_gap = 0`. If a device returns a wrong value when a register is read together with others, the
//! signal needs `merge = false`.
//!
//! Other kinds of devices are planned as follows:
//! - Each CANopen object has its own request.
//! - Values in CAN frames arrive without a request.
//! - All nodes of an OPC UA server share one request or subscription.
//! - All sensors of this computer in one device are read at the same time.

use std::fmt;
use std::time::Duration;

use crate::document::{Section, entries};
use crate::wording::counted;
use crate::{Device, Profile, Quirks, ReadBy, Signal, SourceTime};
use isotherm_core::codec::{Address, Node, Object, PcSensor, Register};
use isotherm_core::reading::SignalId;

/// Largest number of coils or discrete inputs in one Modbus read request.
const MAX_BITS: u16 = 2000;

/// Read request with the position of each signal in its answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadRequest {
    /// Registers, object, nodes or sensors to read.
    pub asks: ReadTarget,
    /// Signals in the answer. Never empty.
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
    /// Nodes of an OPC UA server. Each is a field of the answer.
    Nodes(Vec<Node>),
    /// Values that the server has sent for subscribed nodes.
    Subscription(Subscription),
    /// Sensors of this computer. Each is a field of the answer.
    Sensors(Vec<PcSensor>),
}

/// Subscribed nodes, whose values an OPC UA server sends without a request. Each node is a field of the answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    /// Subscribed nodes.
    pub nodes: Vec<Node>,
    /// Sampling interval of the server, which sends changed values.
    pub every: Duration,
    /// Smallest `max_age` (age at which a reading becomes stale) of the signals.
    pub max_age: Duration,
    /// Whether the server also sends a value if only its timestamp changed. The timestamp then shows when the value was
    /// measured.
    pub by_stamp: bool,
}

/// Position of one signal in an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Signal at this position.
    pub signal: SignalId,
    /// Index of the first register, bit or node of the signal in the answer, from 0.
    pub at: u16,
    /// Number of registers or bits. For a node, those of its value.
    pub len: u16,
}

/// Plans the fewest requests that read these signals of one device, in the order of tables and addresses.
///
/// A value of several registers is never split, even if it is longer than the device's limit.
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
            // Arrives without a request.
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

/// Returns the request for all nodes. `None` if there are none.
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

/// Returns the request for all sensors. `None` if there are none.
fn all_sensors(sensors: Vec<(Field, PcSensor)>) -> Option<ReadRequest> {
    let (fields, sensors) = numbered(sensors);
    (!fields.is_empty()).then_some(ReadRequest { asks: ReadTarget::Sensors(sensors), fields })
}

/// Numbers the nodes or sensors of one request, and stores each number in its field as the position in the answer.
fn numbered<T>(parts: Vec<(Field, T)>) -> (Vec<Field>, Vec<T>) {
    parts.into_iter().zip(0..).map(|((field, part), at)| (Field { at, ..field }, part)).unzip()
}

impl ReadRequest {
    /// First register or bit of the request, and the number of registers or bits. `None` for an object, nodes and
    /// sensors.
    pub const fn span(&self) -> Option<(Register, u16)> {
        if let ReadTarget::Registers { from, count } = self.asks { Some((from, count)) } else { None }
    }

    /// Names of the signals in the answer.
    pub fn signals<'a>(&self, profile: &'a Profile) -> Vec<&'a str> {
        self.fields.iter().map(|field| profile.signal(field.signal).name.as_str()).collect()
    }

    /// Preview of the request and the signals in its answer.
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

    fn rank(&self) -> (Option<(Register, u16)>, SignalId) {
        (self.span(), self.fields[0].signal)
    }

    /// Merges `next`, the request that follows in the order of addresses, into this request. Returns `false` if its
    /// registers are in another table or too far away, or if the merged request would be too long.
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

/// Formats the request, for example as `read input:0..7 (30001..30008), 8 registers`.
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

/// Summarises requests, for example as `3 requests touching 17 registers for 9 signals`.
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

//! OPC UA: the nodes of a server are read and written. The server is one device of the profile.

use std::time::Duration;

use crate::plan::{Field, ReadRequest, ReadTarget, Subscription, numbered};
use crate::tables::bus::transport::{BusType, Transport};
use crate::tables::bus::{LineSettings, LineType};
use crate::tables::bus_kind::{BusKind, SignalKeys, SignalsOf};
use crate::tables::device::{Device, DeviceParts};
use crate::tables::heartbeat::{FEW, RawHeartbeat};
use crate::tables::output::display::Display;
use crate::tables::output::{RawOutput, Target, not_one_bit, share};
use crate::tables::register::{self, plain};
use crate::tables::signal::bad::sentinels;
use crate::tables::signal::unit::Unit;
use crate::tables::signal::{Located, RawSignal};
use crate::tables::{Check, KeyContext};
use isotherm_core::codec::{Address, DataType, Encoding, Node};
use nodes::{ReadBy, SourceTime};

pub(crate) mod connection;
mod line;
pub(crate) mod nodes;

/// Kind of bus for OPC UA servers.
pub(super) static KIND: BusKind = BusKind {
    types: &[LineType {
        word: BusType::OpcUa,
        title: "OPC UA",
        keys: &["address", "late", "security", "user", "cert", "key", "trusted"],
        exclusive: None,
        answer: LineType::ANSWER,
    }],
    recognises: |raw| raw.address.as_ref().is_some_and(|address| address.starts_with(connection::SCHEME)),
    line: |raw, at, _| Some((Transport::OpcUa, line::address(raw, at))),
    settings: |raw, at, _, _| {
        Some(LineSettings { opcua: Some(line::resolve(raw, at)?), ..LineSettings::default() })
    },
    device: |_, raw, _, _| {
        let source_time = Some(raw.source_time.unwrap_or_default());
        DeviceParts { unit: Some(0), source_time, ..DeviceParts::default() }
    },
    foreign_device_keys: &[(
        &["unit", "functions", "quirks", "base"],
        "a Modbus device",
        "remove this key: an OPC UA server has nodes",
    )],
    device_keys_elsewhere: |_, at| {
        at.not_applicable(&["source_time", "read"], "a device on an OPC UA line", nodes::ELSEWHERE);
    },
    verify: |raw, at, _| raw.node(at),
    signal_keys: SignalKeys { keys: &["node", "element"], owner: nodes::OWNER, help: Some(nodes::ELSEWHERE) },
    signal_help: |device| format!("`{device}` is an OPC UA server: write node = \"ns=2;s=…\""),
    check_signal: |_, at, _| {
        let help = "remove this key: a node needs no command before a read";
        at.key("counter").not_applicable(&["capture"], "a Modbus device", help);
        &[]
    },
    has_place: |raw| raw.register.is_some() || raw.node.is_some(),
    signal,
    foreign_output_keys: |_, at, device| {
        let help = format!(
            "`{device}` is an OPC UA server: remove this key; the key `node` sets where a value is written"
        );
        let of_modbus = ["register", "word_order", "byte_swap", "beside", "stale", "read_back"];
        at.not_applicable(&of_modbus, "a Modbus device", &help);
        at.not_applicable(&["pdo", "sdo", "frame"], "a device on a CAN line", &help);
    },
    output,
    heartbeat,
    requests,
    written: |_, address, _| address.node().map(|node| format!("node {}", node.id)).into_iter().collect(),
    ..BusKind::POLLED
};

fn heartbeat(raw: &RawHeartbeat, at: &KeyContext<'_>) -> Option<Address> {
    let help = "write node = \"ns=2;s=…\" instead of `register`";
    at.not_applicable(&["register"], "a Modbus device", help);
    let node = nodes::written(at, raw.node.as_ref(), raw.kind)?;
    nodes::holds(at, &node, FEW)?;
    Some(Address::Node(node))
}

/// Plans one request for all nodes of the device, or one subscription.
fn requests(device: &Device, signals: &SignalsOf<'_>) -> Vec<ReadRequest> {
    let mut nodes: Vec<(Field, Node)> = Vec::new();
    let mut max_age = Duration::MAX;
    for (id, signal) in signals {
        let Some(node) = signal.address.node() else { continue };
        let field = Field::value(*id, signal.encoding.data_type.registers());
        nodes.push((field, node.clone()));
        max_age = max_age.min(signal.max_age);
    }
    let (fields, nodes) = numbered(nodes);
    let by_stamp = device.source_time == Some(SourceTime::Sampled);
    let asks = match device.read {
        ReadBy::Poll => ReadTarget::Nodes(nodes),
        ReadBy::Subscription => {
            ReadTarget::Subscription(Subscription { nodes, every: device.every, max_age, by_stamp })
        }
    };
    (!fields.is_empty()).then_some(ReadRequest { asks, fields }).into_iter().collect()
}

/// Resolves the node of a signal, with its scale and its raw values for "no measurement". `None` if they have an error.
fn signal(_: &Check<'_>, raw: &RawSignal, at: &KeyContext<'_>, _: Option<&Device>) -> Option<Located> {
    let node = nodes::read(at, raw.node.as_ref(), raw.kind, raw.element.as_ref());
    let scale = register::scale(&at.key("scale"), raw.scale.unwrap_or(1.0));
    let bad = sentinels(raw.bad.as_ref(), &at.key("bad"));
    let (node, scale) = (node?, scale?);
    let data_type = node.taken_as();
    let offset = raw.offset.unwrap_or(0.0);
    let encoding = Encoding { scale, offset, bad, ..plain(data_type) };
    let unit = (data_type == DataType::Bool).then_some(Unit("bool"));
    Some(Located::of(Address::Node(node), encoding, unit))
}

/// Resolves the node of an output, with its encoding and verification. `None` if they have an error.
fn output(
    check: &Check<'_>,
    raw: &RawOutput,
    at: &KeyContext<'_>,
    _: &str,
    device: Option<usize>,
) -> Option<Target> {
    let device = device.and_then(|device| check.devices.get(device));
    let node = nodes::written(at, raw.node.as_ref(), raw.kind);
    let data_type = node.as_ref().map(Node::taken_as);
    not_one_bit(&at.key("type"), data_type);
    let scale = raw.scale(&at.key("scale"), data_type);
    let (node, data_type) = (node?, data_type?);
    let bias = raw.bias(&at.key("bias"), data_type);
    let verify = raw.verification();
    let share = share::resolve(raw, at, data_type, device);
    let encoding = Encoding { scale: scale?, bias, ..plain(data_type) };
    let (applied, display) = (None, Display::default());
    Some(Target { address: Address::Node(node), encoding, verify, share, applied, display })
}

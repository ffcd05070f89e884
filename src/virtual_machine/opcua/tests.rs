use std::path::Path;
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use ::opcua::types::{DataValue, NumericRange, StatusCode, Variant};
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use super::content::data_value;
use super::manager::part;
use super::nodes::{APPLICATION, Access, ServerNode};
use super::server::pass_on;
use super::{Endpoint, NodeLine, ServerNodes, with_types};
use crate::clock::Clock;
use crate::virtual_machine::fault::{FaultScript, Faults};
use crate::virtual_machine::hardware::Hardware;
use crate::virtual_machine::hardware::nodes::NodeValue;
use isotherm_core::codec::{DataType, Namespace, Node, Scalar};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Status;
use isotherm_profile::{DeviceId, Profile};

const PROFILE: &str = r#"
[machine]
name = "nodes"

[bus.control]
type     = "opcua"
address  = "opc.tcp://127.0.0.1:4840/plc"
security = "none"

[device.cnc]
bus = "control"

[signal.bed]
device = "cnc"
node   = "ns=2;s=bed"
unit   = "degC"

[signal.first]
device  = "cnc"
node    = "ns=2;s=Temps"
element = 0
unit    = "degC"

[signal.third]
device  = "cnc"
node    = "ns=2;s=Temps"
element = 2
unit    = "degC"

[signal.corner]
device  = "cnc"
node    = "nsu=urn:plc;i=7"
type    = "f32"
element = [1, 2]
unit    = "degC"

[signal.shown]
device = "cnc"
node   = "ns=2;s=offset"
unit   = "mm"

[axis.z]
limit    = 40.0
step     = 1.0
rate     = 100.0
every    = "10s"
on_fault = { action = "hold" }

[[axis.z.model]]
name  = "bed"
kind  = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 20.0 } ]

[set.offsets]
heartbeat = { node = "ns=2;s=beat", type = "i16" }
handshake = { strobe = { node = "ns=2;s=strobe", type = "bool" }, acknowledge = { node = "ns=2;s=taken" }, timeout = "2s" }

[output.offset]
axis   = "z"
device = "cnc"
set    = "offsets"
writes = "offset"
node   = "ns=2;s=offset"
type   = "i32"
scale  = 0.1
"#;

fn profile(text: &str) -> Profile {
    let loaded = isotherm_profile::parse(Path::new("nodes.toml"), text, &[], &[]);
    with_types(loaded.unwrap_or_else(|errors| panic!("{errors}")).profile)
}

fn node<'s>(server: &'s ServerNodes, id: &str) -> &'s ServerNode {
    server.nodes.iter().find(|node| node.id.to_string() == id).unwrap()
}

fn number(value: f64) -> NodeValue {
    NodeValue::Number(Scalar { data_type: DataType::F64, bits: value.to_bits() })
}

#[test]
fn each_node_is_there_once_with_its_type_and_the_length_of_its_array() {
    let server = ServerNodes::of(&profile(PROFILE), 0).unwrap();
    assert_eq!(server.nodes.len(), 7);
    let found = |id| {
        let node = node(&server, id);
        (node.access, node.data_type(), node.dimensions())
    };
    assert_eq!(found("ns=2;s=offset"), (Access::Write, DataType::I32, None));
    assert_eq!(found("ns=2;s=beat"), (Access::Write, DataType::I16, None));
    assert_eq!(found("ns=2;s=strobe"), (Access::Write, DataType::Bool, None));
    assert_eq!(found("ns=2;s=taken"), (Access::Read, DataType::Bool, None));
    assert_eq!(found("ns=2;s=bed"), (Access::Read, DataType::F64, None));
    assert_eq!(found("ns=2;s=Temps"), (Access::Read, DataType::F64, Some(vec![3])));
    assert_eq!(found("nsu=urn:plc;i=7"), (Access::Read, DataType::F32, Some(vec![2, 3])));
    let second = format!("{APPLICATION}:2");
    assert_eq!(server.namespaces, [APPLICATION, second.as_str(), "urn:plc"]);
    assert_eq!(server.index(&Namespace::Uri("urn:plc".to_owned())), Some(3));
    assert_eq!(Endpoint::parts("opc.tcp://127.0.0.1:4840/plc"), ("127.0.0.1:4840", "/plc"));
    assert_eq!(Endpoint::parts("opc.tcp://[::1]:4840"), ("[::1]:4840", ""));
}

#[test]
fn a_server_that_would_be_too_large_is_refused_with_the_reason() {
    let refused =
        |from: &str, to: &str| ServerNodes::of(&profile(&PROFILE.replace(from, to)), 0).unwrap_err();
    let why = refused("element = 2", "element = 4294967295");
    assert_eq!(why, "the array of node ns=2;s=Temps has more than 10000 elements");
    assert_eq!(refused("ns=2;s=bed", "ns=300;s=bed"), "ns=300 is more than 200 namespaces");
}

#[test]
fn an_array_has_its_elements_at_their_places_and_is_bad_if_one_is() {
    let server = ServerNodes::of(&profile(PROFILE), 0).unwrap();
    let temps = node(&server, "ns=2;s=Temps");
    let values = |change: &dyn Fn(u32) -> NodeValue| {
        let parts = temps.parts.iter().map(|part| change(part.element.as_ref().unwrap().indices()[0]));
        data_value(temps, &parts.collect::<Vec<_>>())
    };
    let elements = |change: &dyn Fn(u32) -> NodeValue| match values(change).value {
        Some(Variant::Array(array)) => array.values,
        other => panic!("{other:?}"),
    };
    let numbers = elements(&|place| number(20.5 + f64::from(place)));
    assert_eq!(numbers, [20.5, 0.0, 22.5].map(Variant::from));
    let text = |place: u32| match place {
        0 => NodeValue::Text("20.5".to_owned()),
        place => number(f64::from(place)),
    };
    assert_eq!(elements(&text), ["20.5", "0", "2"].map(Variant::from));
    let bad = |place: u32| match place {
        0 => NodeValue::Status(Status::SENSOR_FAILURE),
        place => number(f64::from(place)),
    };
    let bad = values(&bad);
    assert_eq!((bad.status, bad.value), (Some(StatusCode::BadSensorFailure), Some(Variant::Empty)));
}

#[test]
fn a_client_may_read_a_range_of_an_array() {
    let whole = DataValue::new_now(Variant::from(vec![1.0, 2.0, 3.0]));
    match part(whole.clone(), &NumericRange::Range(1, 2)).value {
        Some(Variant::Array(array)) => assert_eq!(array.values, [2.0, 3.0].map(Variant::from)),
        other => panic!("{other:?}"),
    }
    assert_eq!(part(whole.clone(), &NumericRange::None), whole);
    let beyond = part(whole, &NumericRange::Index(3));
    let no_data = (Some(Variant::Empty), Some(StatusCode::BadIndexRangeNoData));
    assert_eq!((beyond.value, beyond.status), no_data);
    let bad = DataValue::new_now_status(Variant::Empty, StatusCode::BadSensorFailure);
    assert_eq!(part(bad, &NumericRange::Index(0)).status, Some(StatusCode::BadSensorFailure));
}

#[test]
fn a_control_acknowledges_a_handshake_in_nodes_and_rejects_a_value_of_another_type() {
    let (profile, begin) = (profile(PROFILE), Moment::from_nanos(0));
    let faults = Faults::new(FaultScript::default(), begin);
    let mut hardware = Hardware::new(&profile, None, 1, faults, begin, Vec::new());
    let flag = |up: bool| Scalar { data_type: DataType::Bool, bits: u64::from(up) };
    let named = |id: &str, data_type| Node::new(id.parse().unwrap(), Some(data_type));
    let device = DeviceId(0);
    let offset = [(named("ns=2;s=offset", DataType::I32), Some(flag(true)))];
    assert_eq!(hardware.write_nodes(device, &offset, begin).results, [Status::TYPE_MISMATCH]);
    let mut now = begin;
    for up in [true, false] {
        let strobe = [(named("ns=2;s=strobe", DataType::Bool), Some(flag(up)))];
        assert_eq!(hardware.write_nodes(device, &strobe, now).results, [Status::GOOD]);
        let taken = [named("ns=2;s=taken", DataType::Bool)];
        let before = hardware.read_nodes(device, &taken, now).results;
        now = now.after(Duration::from_millis(40));
        let after = hardware.read_nodes(device, &taken, now).results;
        assert_eq!((before, after), (vec![NodeValue::Number(flag(!up))], vec![NodeValue::Number(flag(up))]));
    }
}

#[test]
fn a_fault_of_a_signal_counts_only_answers_and_samples_with_its_node() {
    let (profile, now) = (profile(PROFILE), Moment::from_nanos(0));
    let script = "[[fault]]\ndevice = \"cnc\"\nkind = \"status\"\nsignal = \"bed\"\nfor = 2\n";
    let faults = Faults::new(FaultScript::parse(script, &profile).unwrap(), now);
    let mut hardware = Hardware::new(&profile, None, 1, faults, now, Vec::new());
    let named = |id: &str, data_type| [Node::new(id.parse().unwrap(), Some(data_type))];
    let (bed, taken) = (named("ns=2;s=bed", DataType::F64), named("ns=2;s=taken", DataType::Bool));
    let beat = [(named("ns=2;s=beat", DataType::I16)[0].clone(), None::<Scalar>)];
    assert_eq!(hardware.write_nodes(DeviceId(0), &beat, now).results, [Status::TYPE_MISMATCH]);
    let is_bad = |nodes: &[Node; 1]| {
        matches!(hardware.sample_nodes(DeviceId(0), nodes, now)[..], [NodeValue::Status(_)])
    };
    assert_eq!([&bed, &taken, &taken, &bed, &bed].map(is_bad), [true, false, false, true, false]);
}

#[tokio::test]
async fn a_connection_to_a_silent_server_ends_with_its_client() {
    let (profile, clock) = (profile(PROFILE), Clock::wall());
    let silent = "[[fault]]\ndevice = \"cnc\"\nkind = \"silent\"\n";
    let faults = Faults::new(FaultScript::parse(silent, &profile).unwrap(), clock.now());
    let hardware = Hardware::new(&profile, None, 1, faults, clock.now(), Vec::new());
    let parts = (Arc::new(Mutex::new(hardware)), clock);
    let line = NodeLine::new(ServerNodes::of(&profile, 0).unwrap(), parts, DeviceId(0));
    let (mut client, near_client) = tokio::io::duplex(64);
    let (mut server, near_server) = tokio::io::duplex(64);
    server.write_all(b"answer").await.unwrap();
    let mut passing = pin!(pass_on(near_client, near_server, &line, (line.cuts(), line.boots())));
    let mut received = [0; 8];
    tokio::select! {
        biased;
        ended = &mut passing => panic!("{ended:?}"),
        read = client.read(&mut received) => panic!("{read:?}"),
        () = std::future::ready(()) => {}
    }
    drop(client);
    let ended = tokio::time::timeout(Duration::from_secs(60), passing).await;
    ended.expect("the connection stays open").unwrap();
}

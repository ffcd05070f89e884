//! OPC UA: nodes in place of registers, and keys that belong to another kind of line.

use super::*;
use isotherm_core::codec::{Address, DataType};
use isotherm_profile::plan::ReadTarget;
use isotherm_profile::{DeviceId, Security, SourceTime, Transport};

const SECOND: std::time::Duration = std::time::Duration::from_secs(1);

const SERVER: &str = r#"[machine]
name = "server"

[bus.control]
type = "opcua"
address = "opc.tcp://192.168.214.241"
security = "none"

[device.cnc]
bus = "control"
every = "1s"

[signal.bed]
device = "cnc"
node = "ns=2;s=/Plc/DB100.DBD4"
unit = "degC"
max_age = "10s"

[signal.scale_z]
device = "cnc"
node = "ns=3;i=1005"
type = "i32"
scale = 0.0005
unit = "mm"

[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }

[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [{ signal = "bed", gain = 2.4, reference = 20.0 }]

[output.k0]
axis = "z"
device = "cnc"
writes = "offset"
node = "ns=2;s=/Sinumerik/SEA/offset"
type = "f64"
"#;

/// Checks the only error of the server after a replacement in its text.
#[track_caller]
fn no_server(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    assert!(SERVER.contains(from), "{from}");
    let error = only_error(&SERVER.replacen(from, to, 1), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn a_server_is_a_bus_whose_nodes_are_read_in_one_request() {
    let loaded = parse(SERVER).unwrap_or_else(|errors| panic!("{errors}"));
    let profile = &loaded.profile;
    let bus = &profile.buses[0];
    assert_eq!((bus.transport, bus.address.as_str()), (Transport::OpcUa, "opc.tcp://192.168.214.241:4840"));
    assert_eq!(bus.opcua.as_ref().unwrap().security, Security::None);
    assert_eq!(profile.devices[0].source_time, Some(SourceTime::Sampled));
    let requests = profile.requests(DeviceId(0));
    let ReadTarget::Nodes(nodes) = &requests[0].asks else { panic!("{requests:?}") };
    let types: Vec<_> = nodes.iter().map(|node| (node.to_string(), node.data_type)).collect();
    let expected = [("ns=2;s=/Plc/DB100.DBD4", None), ("ns=3;i=1005", Some(DataType::I32))];
    assert_eq!(types, expected.map(|(id, data_type)| (id.to_owned(), data_type)));
    assert_eq!((requests.len(), requests[0].fields[1].at), (1, 1));
    let Address::Node(node) = &profile.outputs[0].address else { panic!("no node") };
    assert_eq!(
        (node.to_string().as_str(), node.data_type),
        ("ns=2;s=/Sinumerik/SEA/offset", Some(DataType::F64))
    );
}

#[test]
fn check_says_what_is_asked_and_written_and_how_the_messages_are_protected() {
    let profile = parse(SERVER).unwrap().profile;
    let text = isotherm_profile::preview::Preview::of(&profile).to_string();
    for said in [
        "bus control: OPC UA at opc.tcp://192.168.214.241:4840",
        "messages are neither signed nor encrypted; logs in as the anonymous user",
        "cnc: every 1s: 1 request touching 2 nodes for 2 signals",
        "the age of a reading is counted from the server's time stamp",
        "bed: node ns=2;s=/Plc/DB100.DBD4 of cnc, the node's own type, 1 °C per unit",
        "scale_z: node ns=3;i=1005 of cnc, i32, 0.0005 mm per count",
        "k0: node ns=2;s=/Sinumerik/SEA/offset of cnc, f64, 1 µm per unit",
        "accepted once the node was read and contains the written value",
    ] {
        assert!(text.contains(said), "`{said}` is not in:\n{text}");
    }
    assert!(!text.contains("unit 0"), "{text}");
}

#[test]
fn a_subscription_is_told_and_wants_readings_that_may_be_four_periods_old() {
    let every = "every = \"1s\"\n";
    let text =
        SERVER.replacen(every, &format!("{every}read = \"subscription\"\nsource_time = \"changed\"\n"), 1);
    let profile = parse(&text).unwrap_or_else(|errors| panic!("{errors}")).profile;
    let requests = profile.requests(DeviceId(0));
    let ReadTarget::Subscription(sent) = &requests[0].asks else { panic!("{requests:?}") };
    assert_eq!(
        (sent.nodes.len(), sent.every, sent.max_age),
        (2, SECOND, SECOND * 5),
        "the youngest: five periods"
    );
    assert!(!sent.by_stamp);
    let said = isotherm_profile::preview::Preview::of(&profile).to_string();
    assert!(said.contains("the server sends changed values (a subscription)"), "{said}");
    assert!(said.contains("subscribe to 2 nodes"), "{said}");
    let young = text.replacen("max_age = \"10s\"", "max_age = \"3s\"", 1);
    let error = only_error(&young, "signal.bed.max_age", "\"3s");
    assert!(error.to_string().contains("4 periods old"), "{error}");
    assert!(error.to_string().contains("write max_age = \"5s\""), "{error}");
}

#[test]
fn what_is_wrong_with_a_server_is_told_at_its_key() {
    no_server(
        "security = \"none\"\n",
        "",
        "bus.control.security",
        "control]",
        &["`security` is missing", "sign-and-encrypt"],
    );
    no_server("opc.tcp://", "http://", "bus.control.address", "\"http", &["opc.tcp://192.168.214.241"]);
    for (address, words) in [
        ("opc.tcp://::1", "\"opc.tcp://[::1]:4840\""),
        ("opc.tcp://ho st", "contains a space"),
        (" opc.tcp://nck", "\"opc.tcp://nck\""),
        ("opc.tcp://nck:x", "not a host and port"),
    ] {
        no_server("opc.tcp://192.168.214.241", address, "bus.control.address", "\"", &[words]);
    }
    let v6 = parse(&SERVER.replace("192.168.214.241", "[::1]")).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(v6.profile.buses[0].address, "opc.tcp://[::1]:4840");
    no_server("opc.tcp://", "opc.tcp://user@", "bus.control.address", "\"opc", &["must not contain a user"]);
    no_server(
        "\"none\"\n",
        "\"none\"\ncert = \"own.der\"\n",
        "bus.control.cert",
        "cert",
        &["a secured line"],
    );
    no_server(
        "\"none\"\n",
        "\"none\"\nbaud = 9600\n",
        "bus.control.baud",
        "baud",
        &["a line with a serial port"],
    );
    no_server(
        "every = \"1s\"\n",
        "every = \"1s\"\nunit = 1\n",
        "device.cnc.unit",
        "unit",
        &["a Modbus device"],
    );
}

#[test]
fn the_words_of_opc_ua_and_of_other_programs_are_answered_with_those_of_a_profile() {
    no_server("\"opcua\"", "\"opc-ua\"", "bus.control.type", "\"opc-ua", &["did you mean `opcua`"]);
    no_server("\"f64\"", "\"Double\"", "output.k0.type", "\"Double", &["for the OPC UA type Double"]);
    no_server("\"i32\"", "\"Int32\"", "signal.scale_z.type", "\"Int32", &["for the OPC UA type Int32"]);
    no_server(
        "\"none\"",
        "\"Basic256Sha256\"",
        "bus.control.security",
        "\"Basic",
        &["security policy: write \"sign-and-encrypt\"; the strongest policy that both ends support is \
           used"],
    );
    no_server("ns=3;i=1005", "nsu=urn:50%;i=1005", "signal.scale_z.node", "\"nsu", &["written as %25"]);
    let by_uri = parse(&SERVER.replace("ns=3;i=1005", "nsu=urn:nck;i=1005")).unwrap().profile;
    assert_eq!(by_uri.signals[1].address.to_string(), "node nsu=urn:nck;i=1005");
    let verify = "every = \"1s\"\nverify = [ { type = \"i32\", equals = 3 } ]\n";
    no_server("every = \"1s\"\n", verify, "device.cnc.verify[0].node", "{", &["which node is read?"]);
    let verify = "every = \"1s\"\nverify = [ { node = \"ns=2;s=state\", equals = 3 } ]\n";
    no_server(
        "every = \"1s\"\n",
        verify,
        "device.cnc.verify[0].type",
        "{",
        &["the value is compared in the node's own type"],
    );
    let secured = "\"sign\"\ncert = \"own.der\"\nkey = \"own.pem\"\n";
    let said = parse(&SERVER.replacen("\"none\"\n", secured, 1)).unwrap_err().to_string();
    assert!(
        said.contains("`isotherm opcua trust PROFILE` creates this directory with the certificates"),
        "{said}"
    );
}

#[test]
fn what_is_wrong_with_a_node_is_told_at_its_key() {
    no_server(
        "\"ns=3;i=1005\"",
        "\"holding:84\"",
        "signal.scale_z.node",
        "\"holding",
        &["is not a node", "ns=2;s="],
    );
    no_server("node = \"ns=3;i=1005\"\n", "", "signal.scale_z.node", "scale_z]", &["`node` is missing"]);
    no_server(
        "unit = \"mm\"\n",
        "unit = \"mm\"\nword_order = \"msw-first\"\n",
        "signal.scale_z.word_order",
        "word_order",
        &["a Modbus device"],
    );
    no_server(
        "type = \"f64\"\n",
        "",
        "output.k0.type",
        "k0]",
        &["`type` is missing", "in the node's own type"],
    );
    no_server(
        "type = \"f64\"\n",
        "type = \"f64\"\nshare = \"ledger\"\n",
        "output.k0.share",
        "\"ledger",
        &["cannot hold an exact sum"],
    );
}

#[test]
fn two_outputs_never_write_one_node() {
    let second = SERVER.split_once("[output.k0]").unwrap().1;
    let text = format!("{SERVER}\n[output.again]{second}");
    let error = only_error(&text, "output.again.node", "\"ns=2");
    assert!(error.to_string().contains("output `k0` writes this node already"), "{error}");
}

#[test]
fn two_outputs_never_write_one_node_though_its_guid_is_written_otherwise() {
    let guid = "ns=2;g=09087e75-8e5e-499b-954f-f2a9603db28a";
    let text = SERVER.replacen("ns=2;s=/Sinumerik/SEA/offset", guid, 1);
    let (_, output) = text.split_once("[output.k0]").unwrap();
    let second = output.replace(guid, &guid.to_uppercase().replace("NS=2;G=", "ns=2;g="));
    let text = format!("{text}[output.k1]{second}");
    let error = only_error(&text, "output.k1.node", "\"ns=2;g=09087E75");
    assert!(error.to_string().contains("output `k0` writes this node already"), "{error}");
}

#[test]
fn a_node_belongs_to_a_server() {
    let error = only_error(
        &GRINDER.replacen("[device.module]", "[device.module]\nsource_time = \"changed\"", 1),
        "device.module.source_time",
        "source_time",
    );
    assert!(error.to_string().contains("a device on an OPC UA line"), "{error}");
}

/// Server with two outputs in a set that has every possible word.
const SET: &str = r#"set = "line"
restart = { boot_counter = { node = "ns=2;s=boots" } }

[axis.y]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }

[[axis.y.model]]
name = "bed"
kind = "linear"
terms = [{ signal = "bed", gain = 1.2, reference = 20.0 }]

[output.y0]
axis = "y"
device = "cnc"
set = "line"
writes = "offset"
node = "ns=2;s=/Sinumerik/SEA/y"
type = "i32"
scale = 0.1

[set.line]
heartbeat = { node = "ns=2;s=beat", type = "i16" }
control = { node = "ns=2;s=control", type = "u8" }
version = { node = "ns=2;s=version", type = "u32", value = 17 }
handshake = { strobe = { node = "ns=2;s=strobe", type = "bool" }, acknowledge = { node = "ns=2;s=taken" }, timeout = "1s" }

[heartbeat]
device = "cnc"
node = "ns=2;s=life"
type = "u16"
every = "500ms"
"#;

/// Checks the only error of the server with the set after a replacement in its text.
#[track_caller]
fn no_set(from: &str, to: &str, key: &str, at: &str, words: &[&str]) {
    let text = format!("{SERVER}{SET}");
    assert!(text.contains(from), "{from}");
    let error = only_error(&text.replacen(from, to, 1), key, at);
    for word in words {
        assert!(error.to_string().contains(word), "`{word}` is not in: {error}");
    }
}

#[test]
fn a_set_in_nodes_is_one_call_with_each_value_in_its_node_s_own_type() {
    let loaded = parse(&format!("{SERVER}{SET}")).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(loaded.warnings, []);
    let profile = &loaded.profile;
    let nodes = profile.sets[0].nodes(profile);
    let nodes: Vec<_> = nodes.iter().map(|node| (node.to_string(), node.taken_as().name())).collect();
    let expected = [
        ("ns=2;s=/Sinumerik/SEA/offset", "f64"),
        ("ns=2;s=/Sinumerik/SEA/y", "i32"),
        ("ns=2;s=beat", "i16"),
        ("ns=2;s=control", "u8"),
        ("ns=2;s=version", "u32"),
    ];
    assert_eq!(nodes, expected.map(|(node, kind)| (node.to_owned(), kind)));
    let text = isotherm_profile::preview::Preview::of(profile).to_string();
    for said in [
        "set line: k0, y0 are written together to cnc",
        "one request: one call that writes 5 nodes, in the order that the server chooses: \
         ns=2;s=/Sinumerik/SEA/offset (f64), ",
        "heartbeat node ns=2;s=beat: counts up with every write",
        "then: strobe node ns=2;s=strobe on, acknowledge node ns=2;s=taken on within 1s, strobe off",
        "heartbeat: node ns=2;s=life of cnc, u16, counts every 500ms",
        "node ns=2;s=boots changes",
    ] {
        assert!(text.contains(said), "`{said}` is not in:\n{text}");
    }
    for said in ["registers", "function 0"] {
        assert!(!text.contains(said), "`{said}` is in:\n{text}");
    }
}

#[test]
fn a_set_in_nodes_has_no_word_that_would_have_to_come_last() {
    for key in ["sequence", "complement"] {
        no_set(
            "[set.line]\n",
            &format!("[set.line]\n{key} = \"holding:100\"\n"),
            &format!("set.line.{key}"),
            key,
            &["may write the nodes of a call in any order", "`handshake`"],
        );
    }
    no_set("[set.line]\n", "[set.line]\nzeros = true\n", "set.line.zeros", "zeros", &["only for registers"]);
}

#[test]
fn what_is_wrong_with_the_words_of_a_set_in_nodes_is_told_at_their_keys() {
    let beat = "{ node = \"ns=2;s=beat\", type = \"i16\" }";
    no_set(beat, "\"holding:100\"", "set.line.heartbeat", "\"holding", &["this device is an OPC UA server"]);
    let untyped = "{ node = \"ns=2;s=beat\" }";
    no_set(beat, untyped, "set.line.heartbeat.type", "heartbeat", &["`type` is missing"]);
    let at_type = "set.line.heartbeat.type";
    let small = beat.replace("i16", "u8");
    no_set(beat, &small, at_type, "\"u8\"", &["u8 cannot contain 32767"]);
    no_set(beat, &beat.replace("i16", "f64"), at_type, "\"f64\"", &["not an integer type"]);
    no_set(
        "type = \"u32\", value = 17",
        "type = \"u8\", value = 4711",
        "set.line.version.type",
        "\"u8\"",
        &["u8 cannot contain 4711"],
    );
    no_set("s=taken", "s=strobe", "set.line.handshake.acknowledge", "{ node", &["the strobe signal itself"]);
    no_set(
        "\"ns=2;s=life\"",
        "\"ns=2;s=beat\"",
        "heartbeat.node",
        "\"ns=2;s=beat",
        &["the heartbeat of set line writes"],
    );
    no_set(
        "s=strobe",
        "s=/Sinumerik/SEA/y",
        "set.line.handshake.strobe.node",
        "\"ns=2",
        &["output `y0` writes"],
    );
    no_set(
        "node = \"ns=2;s=life\"\n",
        "register = \"holding:1\"\nnode = \"ns=2;s=life\"\n",
        "heartbeat.register",
        "register",
        &["a Modbus device"],
    );
    no_set(
        "{ node = \"ns=2;s=boots\" }",
        "\"holding:98\"",
        "output.k0.restart.boot_counter",
        "\"holding",
        &["this device is an OPC UA server"],
    );
}

#[test]
fn a_register_has_no_place_for_a_node() {
    let with = |from: &str, to: &str| GRINDER.replacen(from, to, 1);
    let restart = "share = \"whole\"\nrestart = { boot_counter = { node = \"ns=2;s=boots\" } }";
    let text = with("share = \"whole\"", restart);
    let error = only_error(&text, "output.cnc_z.restart.boot_counter", "{ node");
    assert!(error.to_string().contains("only for an OPC UA server"), "{error}");
    let text = with("register = \"holding:100\"", "register = \"holding:100\"\nnode = \"ns=2;s=life\"");
    let error = only_error(&text, "heartbeat.node", "node");
    assert!(error.to_string().contains("only for an OPC UA server"), "{error}");
}

#[test]
fn an_operator_s_part_of_a_node_is_counted_in_whole_counts() {
    let shared = SERVER.replace("type = \"f64\"\n", "type = \"i32\"\nscale = 0.1\nshare = \"ledger\"\n");
    let profile = parse(&shared).unwrap_or_else(|errors| panic!("{errors}")).profile;
    assert_eq!(profile.outputs[0].share, isotherm_profile::Share::Ledger);
}

#[test]
fn an_element_of_an_array_is_part_of_its_node_and_is_shown() {
    let node = "node = \"ns=2;s=/Plc/DB100.DBD4\"";
    for (element, shown) in [("3", "element 3"), ("[1, 2]", "element 1, 2")] {
        let text = SERVER.replacen(node, &format!("{node}\nelement = {element}"), 1);
        let loaded = parse(&text).unwrap_or_else(|errors| panic!("{errors}"));
        let Address::Node(node) = &loaded.profile.signals[0].address else { panic!("no node") };
        assert_eq!(node.element.as_ref().map(ToString::to_string).as_deref(), Some(shown));
        assert_eq!(node.to_string(), "ns=2;s=/Plc/DB100.DBD4");
        let preview = isotherm_profile::preview::Preview::of(&loaded.profile);
        let words = format!("the node's own type, {shown}");
        assert!(preview.to_string().contains(&words), "`{words}` is not in:\n{preview}");
        let document = serde_json::to_value(&preview).unwrap();
        assert_eq!(document["signals"][0]["element"], shown);
    }
    for (element, words) in [("-1", "-1"), ("[]", "[]"), ("\"3\"", "\"3\"")] {
        let text = SERVER.replacen(node, &format!("{node}\nelement = {element}"), 1);
        let found = errors(parse(&text));
        assert!(found.iter().any(|error| error.key.starts_with("signal.bed.element")), "{element}: {words}");
    }
    refused(
        "register = \"input:0\"",
        "register = \"input:0\"\nelement = 3",
        "signal.bed.element",
        "element",
        &["`element` is only for an OPC UA server"],
    );
}

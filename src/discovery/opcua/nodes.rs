//! Comparison of the OPC UA nodes of a profile with the description by their server. Each contradiction, for example
//! another type, results in advice to the user.

use serde::Serialize;

use crate::fieldbus::error::Fault;
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::kinds::opcua::client::browse::{Browser, Described, Value};
use isotherm_core::codec::{Address, Node, number_in};
use isotherm_profile::{Bit, Bus, BusId, Profile, Transport};

/// Name of the OPC UA data type for text.
const TEXT: &str = "String";

/// Node of the profile as its server describes it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspected {
    /// Name of the bus in the profile.
    pub bus: String,
    /// Use of the node in the profile: `signal bed`, `output cnc_z`. If the server did not answer:
    /// `bus cell`.
    pub of: String,
    /// Description by the server; `None` if the server did not answer.
    #[serde(flatten)]
    pub found: Option<Described>,
    /// Advice on each contradiction between the server and the profile; empty if both agree. If the server
    /// did not answer, the advice explains this fault.
    pub advice: Vec<String>,
}

/// Properties that the profile requires of a node.
struct NodeRequirement<'p> {
    of: String,
    node: &'p Node,
    role: NodeRole,
}

/// Use of a node in the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NodeRole {
    /// Node of a signal. Its value may be an element of an array, or a text that contains a number.
    Signal,
    /// Node whose value the gateway compares with an expected value. The profile states the type of the node.
    Compared,
    /// Node to which the gateway writes values of the type that the profile states.
    Written,
}

/// Inspects the nodes of a profile on each OPC UA server. The function only reads from the servers.
pub async fn inspect(profile: &Profile) -> Vec<Inspected> {
    let mut all = Vec::new();
    for (place, bus) in profile.buses.iter().enumerate().filter(|(_, bus)| bus.opcua.is_some()) {
        let wanted = wanted(profile, BusId(place));
        match found(bus, &wanted).await {
            Ok(found) => all.extend(wanted.iter().zip(found).map(|(wanted, found)| Inspected {
                bus: bus.name.clone(),
                of: wanted.of.clone(),
                advice: advice(wanted, &found),
                found: Some(found),
            })),
            Err(fault) => {
                let (bus, of) = (bus.name.clone(), format!("bus {}", bus.name));
                all.push(Inspected {
                    bus,
                    of,
                    found: None,
                    advice: vec![explain_on(Transport::OpcUa, fault).to_string()],
                });
            }
        }
    }
    all
}

async fn found(bus: &Bus, wanted: &[NodeRequirement<'_>]) -> Result<Vec<Described>, Fault> {
    let mut browser = Browser::open(bus).await?;
    let ids: Vec<_> = wanted.iter().map(|wanted| wanted.node.id.clone()).collect();
    let found = browser.describe(&ids).await;
    browser.close().await;
    found
}

/// Returns the requirements for every node of the profile on this bus.
fn wanted<'p>(profile: &'p Profile, bus: BusId) -> Vec<NodeRequirement<'p>> {
    let mut wanted = of_devices(profile, bus);
    wanted.extend(of_sets(profile, bus));
    let heartbeat = profile.heartbeat.iter().filter(|heartbeat| profile.device(heartbeat.device).bus == bus);
    wanted.extend(heartbeat.filter_map(|heartbeat| {
        let node = heartbeat.address.node()?;
        Some(NodeRequirement { of: "heartbeat".to_owned(), node, role: NodeRole::Written })
    }));
    wanted
}

fn of_sets<'p>(profile: &'p Profile, bus: BusId) -> Vec<NodeRequirement<'p>> {
    let mut wanted = Vec::new();
    for set in profile.sets.iter().filter(|set| profile.device(set.device).bus == bus) {
        let mut want = |what: &str, node: &'p Node, role| {
            wanted.push(NodeRequirement { of: format!("{what} of {}", set.label()), node, role });
        };
        set.own_nodes().for_each(|(word, node)| want(word.name(), node, NodeRole::Written));
        if let Some(handshake) = &set.handshake {
            let bits = [
                ("strobe", &handshake.strobe, NodeRole::Written),
                ("acknowledge", &handshake.acknowledge, NodeRole::Compared),
            ];
            for (what, bit, role) in bits {
                if let Bit::Node(node) = bit {
                    want(what, node, role);
                }
            }
        }
    }
    wanted
}

fn of_devices<'p>(profile: &'p Profile, bus: BusId) -> Vec<NodeRequirement<'p>> {
    let mut wanted = Vec::new();
    let mut want = |of: String, address: &'p Address, role| {
        if let Address::Node(node) = address {
            wanted.push(NodeRequirement { of, node, role });
        }
    };
    for (id, device) in profile.devices_on(bus) {
        for (_, signal) in profile.signals_of(id) {
            want(format!("signal {}", signal.name), &signal.address, NodeRole::Signal);
        }
        for output in profile.outputs.iter().filter(|output| output.device == id) {
            want(format!("output {}", output.name), &output.address, NodeRole::Written);
        }
        for expected in &device.verify {
            want(format!("verify of device {}", device.name), &expected.address, NodeRole::Compared);
        }
    }
    wanted
}

fn advice(wanted: &NodeRequirement<'_>, found: &Described) -> Vec<String> {
    let explained = |status| explain_on(Transport::OpcUa, Fault::Status(status)).to_string();
    let Some(variable) = &found.variable else {
        return vec![match found.status.is_good() {
            true => {
                "the node is not a variable: write the node below it that holds the value (`isotherm read \
                 PROFILE --browse NODE` shows it)"
                    .to_owned()
            }
            false => explained(found.status),
        }];
    };
    let mut advice = Vec::new();
    if let Some(wrong) = wrong_type(wanted, variable) {
        advice.push(wrong);
    }
    if !variable.is_readable {
        advice.push(
            "this user may not read the node: give the user this right at the server, or write another `user` for the bus"
                .to_owned(),
        );
    } else if !found.status.is_good() {
        advice.push(explained(found.status));
    }
    if wanted.role == NodeRole::Written && !variable.is_writable {
        advice.push(
            "this user may not write the node: give the user this right at the server, or write another \
             `user` for the bus. Is it the right node?"
                .to_owned(),
        );
    }
    advice
}

/// Returns advice if the type of the node at the server contradicts the type in the profile; otherwise `None`.
fn wrong_type(wanted: &NodeRequirement<'_>, variable: &Value) -> Option<String> {
    let Value { kind, data_type, is_array, value, .. } = variable;
    let (node, is_signal) = (wanted.node, wanted.role == NodeRole::Signal);
    let is_number = is_signal && value.as_deref().is_some_and(|text| number_in(text).is_some());
    match (node.data_type, data_type) {
        _ if *is_array && !is_signal => {
            Some("the node holds several values: write the identifier of a node with one value".to_owned())
        }
        _ if *is_array && node.element.is_none() => Some(
            "the node holds several values: write element = 0 for the first value, or write the identifier of a node \
             with one value"
                .to_owned(),
        ),
        // Without a value, the server does not say whether the node holds an array.
        _ if !*is_array && value.is_some() && node.element.is_some() => {
            Some("the node holds one value: remove `element` of this signal".to_owned())
        }
        (_, None) if kind.is_empty() => None,
        // The texts of an array are not shown here, so whether they are numbers is not known.
        (None, None) if kind == TEXT && (is_number || *is_array) => None,
        (Some(_), None) if kind == TEXT && is_number => {
            Some("the server sends the number as a text: remove `type` of this signal".to_owned())
        }
        (_, None) => Some(format!("the value is {}, not a number: write another node", one(kind))),
        (Some(said), Some(known)) if said != *known => Some(format!(
            "the value is {}, but the profile says {}: write type = \"{}\"",
            one(kind),
            said.name(),
            known.name()
        )),
        _ => None,
    }
}

/// Returns the name of a type with its article: `an Int32`, `a UInt32`.
fn one(kind: &str) -> String {
    let article = if kind.starts_with(['A', 'E', 'I', 'O']) { "an" } else { "a" };
    format!("{article} {kind}")
}

/// Formats the description of a node in one line, for example `f32 (Float), read, 20`.
pub fn in_a_line(found: &Described) -> String {
    let Some(Value { kind, data_type, is_array, is_readable, is_writable, value }) = &found.variable else {
        return String::new();
    };
    let kind = match data_type {
        Some(data_type) => format!("{} ({kind})", data_type.name()),
        None if kind.is_empty() => "of a server-specific type".to_owned(),
        None => kind.clone(),
    };
    let several = if *is_array { ", several" } else { "" };
    let may = match (is_readable, is_writable) {
        (true, true) => "read, write",
        (true, false) => "read",
        (false, true) => "write",
        (false, false) => "neither read nor write",
    };
    let value = value.as_ref().map_or(String::new(), |value| format!("  {value}"));
    let status = if found.status.is_good() { String::new() } else { format!("  {}", found.status) };
    format!("{kind}{several}  {may}{value}{status}")
}

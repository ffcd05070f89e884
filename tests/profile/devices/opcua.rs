//! Templates of OPC UA servers.

use std::path::Path;

use isotherm_core::codec::{Address, DataType};
use isotherm_profile::{Errors, Loaded, Writes, parse};

/// Loads a machine with a server.
pub(crate) fn on_opcua(device: &str, rest: &str) -> Result<Loaded, Errors> {
    let text = format!(
        "[machine]\nname = \"bench\"\n[bus.server]\ntype = \"opcua\"\naddress = \"opc.tcp://127.0.0.1:4840\"\n\
         security = \"none\"\n[device.d]\nbus = \"server\"\n{device}\n{rest}\n"
    );
    parse(Path::new("machine.toml"), &text, &[], &[])
}

const AXIS: &str = r#"
[signal.bed]
device = "d"
channel = "value"
node = "ns=2;s=/Plc/DB100.DBD4"
unit = "degC"
[signal.position]
device = "d"
channel = "value"
node = "ns=2;s=/Nck/position"
unit = "mm"
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "10s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "line"
kind = "linear"
terms = [{ signal = "bed", gain = 2.4, reference = 20.0 }]
slope = { position = "position", reference = -50.0, travel = [-350.0, 0.0], terms = [{ signal = "bed", gain = 0.007, reference = 20.0 }] }
"#;

fn target(name: &str, node: &str) -> String {
    format!("[output.{name}]\naxis = \"z\"\ndevice = \"d\"\nchannel = \"{name}\"\n{node}\n")
}

#[test]
fn a_sinumerik_is_given_its_line_in_three_nodes_that_the_profile_names() {
    let device = "template = \"sinumerik-opcua\"";
    let targets = ["intercept", "slope", "reference"];
    let named = targets.map(|name| target(name, &format!("node = \"ns=2;s=/SEA/{name}\"")));
    let loaded = on_opcua(device, &format!("{AXIS}{}", named.concat()));
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let written: Vec<_> = profile
        .outputs
        .iter()
        .map(|output| {
            let Address::Node(node) = &output.address else { panic!("{}", output.address) };
            (output.writes, node.to_string(), node.data_type, output.encoding.scale.get().round())
        })
        .collect();
    let double = Some(DataType::F64);
    assert_eq!(
        written,
        [
            (Writes::Intercept, "ns=2;s=/SEA/intercept".to_owned(), double, 1000.0),
            (Writes::Slope, "ns=2;s=/SEA/slope".to_owned(), double, 1000.0),
            (Writes::Reference, "ns=2;s=/SEA/reference".to_owned(), double, 1.0),
        ]
    );
    let together =
        targets.map(|name| target(name, &format!("node = \"ns=2;s=/SEA/{name}\"\nset = \"line\"")));
    let loaded = on_opcua(device, &format!("{AXIS}[set.line]\n{}", together.concat()));
    let profile = loaded.unwrap_or_else(|errors| panic!("{errors}")).profile;
    let nodes = profile.sets[0].nodes(&profile).iter().map(ToString::to_string).collect::<Vec<_>>();
    assert_eq!(nodes, targets.map(|name| format!("ns=2;s=/SEA/{name}")), "all three by one call");
    let unnamed = targets.map(|name| target(name, ""));
    let said = on_opcua(device, &format!("{AXIS}{}", unnamed.concat())).unwrap_err().to_string();
    assert!(said.contains("`node` is missing: template `sinumerik-opcua` does not set it"), "{said}");
}

#[test]
fn nothing_of_a_heidenhain_can_be_written() {
    let rest = format!("{AXIS}{}", target("offset", "node = \"ns=1;s=x\""));
    let said = on_opcua("template = \"heidenhain-opcua\"", &rest).unwrap_err().to_string();
    assert!(said.contains("no channel of `heidenhain-opcua` can be written"), "{said}");
}

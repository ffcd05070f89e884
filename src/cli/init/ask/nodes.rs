//! Questions of `isotherm init` about OPC UA servers and their nodes.

use super::{Asking, OF_OFFSET};
use crate::cli::init::answers::{self, Line, MachineOn, Module, TemperatureNode};
use crate::cli::init::opcua;
use crate::cli::init::value_form::{self, ValueForm};

impl Asking<'_, '_> {
    /// Asks for the node of each temperature, and for their scale.
    pub(super) fn nodes(&mut self, signals: &[String]) -> anyhow::Result<Module> {
        let mut nodes = Vec::new();
        for (place, signal) in signals.iter().enumerate() {
            let node = self.text(
                ("node", &format!("Node of {signal}"), None),
                "The name of the node at the server, as ns=2;s=Temps or nsu=http://plc.example;s=Temps. `isotherm read \
                 --bus opc.tcp://192.168.0.10:4840 --browse` shows the nodes.",
                self.arguments.nodes.get(place).map(String::as_str),
                opcua::node,
            )?;
            let element = self.text(
                ("element", &format!("Index of {signal} in the node's array, or none"), Some("none")),
                "2 is the third value of an array; 1,2 is an element of two dimensions. If the node has a single \
                 value, write none, even if its name contains an index.",
                self.arguments.elements.get(place).map(String::as_str),
                opcua::element,
            )?;
            nodes.push(TemperatureNode { node, element });
        }
        let scale = self.text(
            ("scale", "Degrees Celsius per count", Some("1")),
            "1 if the nodes hold degrees Celsius; 0.1 if a node holds 215 at 21.5 °C.",
            self.arguments.scale.as_deref(),
            value_form::scale,
        )?;
        Ok(Module::Nodes(nodes, scale))
    }

    /// Asks for type and scale of the offset in a node.
    pub(super) fn node_form(&mut self) -> anyhow::Result<ValueForm> {
        let [of_type, _, of_scale] = OF_OFFSET.options;
        let data_type = self.text(
            (of_type, "Type of the node", None),
            "The server accepts only the type of the node: i32 is an Int32, f32 a Float, f64 a Double. `isotherm read \
             --browse` shows it.",
            self.arguments.output_type.as_deref(),
            value_form::node_type,
        )?;
        let scale = self.text(
            (of_scale, OF_OFFSET.texts[2], None),
            "0.1 if the control adds 1 µm for the value 10; 1000 if the value is in mm. A wrong scale moves the axis \
             too far.",
            self.arguments.output_scale.as_deref(),
            value_form::scale,
        )?;
        Ok(ValueForm { data_type, word_order: None, scale, scale_from: None })
    }

    /// Asks for the address of the control's OPC UA server. Returns `None` if `module`, the server of the temperatures,
    /// is also the control's server.
    pub(super) fn server(&mut self, module: &Line) -> anyhow::Result<Option<Line>> {
        let of_control = |text: &str| {
            if text == "same" && matches!(module, Line::OpcUa(_)) {
                return Ok(None);
            }
            let line = Line::OpcUa(opcua::server(text)?);
            Ok((!line.is_same(module)).then_some(line))
        };
        self.text(
            ("control", "Address of the control's OPC UA server", None),
            "Address and port, such as opc.tcp://192.168.0.20:4840, or same for the server of the temperatures. \
             `isotherm scan --bus opc.tcp://192.168.0.20` shows what a server offers.",
            self.arguments.control.as_deref(),
            of_control,
        )
    }

    /// Asks for the node that is true while the machine is on.
    pub(super) fn machine_on_node(&mut self) -> anyhow::Result<MachineOn> {
        self.text(
            ("machine-on", "Boolean node that is true while the machine is on, or none", Some("none")),
            "Models often use temperature rises since the machine start. Without this node, the reference temperature \
             is never captured again after the first run. Write a node such as ns=2;s=Machine.On, or none.",
            self.arguments.machine_on.as_deref(),
            answers::machine_on_node,
        )
    }
}

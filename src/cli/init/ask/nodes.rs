//! Questions about a control that is an OPC UA server.

use super::{Asking, OF_OFFSET};
use crate::cli::init::answers::{self, Line, MachineOn};
use crate::cli::init::opcua;
use crate::cli::init::value_form::{self, ValueForm};

impl Asking<'_, '_> {
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

    /// Asks for the address of the server.
    pub(super) fn server(&mut self) -> anyhow::Result<Line> {
        self.text(
            ("control", "Address of the control's OPC UA server", None),
            "Address and port, such as opc.tcp://192.168.0.20:4840. `isotherm scan --bus opc.tcp://192.168.0.20` shows \
             what a server offers.",
            self.arguments.control.as_deref(),
            |text| opcua::server(text).map(Line::OpcUa),
        )
    }

    /// Asks for the node that is true while the machine is on.
    pub(super) fn machine_on_node(&mut self) -> anyhow::Result<MachineOn> {
        self.text(
            ("machine-on", "Boolean node that is true while the machine is on, or none", Some("none")),
            "A model often counts from machine start. Without this node, its reference temperature stays that of the \
             first run for ever. Write a node such as ns=2;s=Machine.On, or none.",
            self.arguments.machine_on.as_deref(),
            answers::machine_on_node,
        )
    }
}

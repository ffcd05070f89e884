//! Requests to devices over any transport, and their answers.

use std::fmt;
use std::time::Duration;

use super::error::Fault;
use isotherm_core::codec::{Address, DataType, Encoded, Encoding, Field, Node, Object, Register};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::Functions;
use isotherm_profile::plan::{self, ReadTarget};

pub use super::kinds::can::request::CanRequest;
pub use super::kinds::modbus::request::ModbusRequest;
pub use super::kinds::opcua::request::NodeRequest;
pub use super::kinds::serial_ascii::request::TextRequest;
pub use super::kinds::sysfs::request::SensorRequest;

/// One request to one device: one variant for each type of bus. Only the code of that type of bus uses the content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// Request to a Modbus unit.
    Modbus(ModbusRequest<'a>),
    /// Request on a CAN line, which has no registers.
    Can(CanRequest<'a>),
    /// Request to an OPC UA server, for example a read of nodes.
    Nodes(NodeRequest<'a>),
    /// Read of sensors of this computer.
    Sensors(SensorRequest<'a>),
    /// Read of numbers in lines of text.
    Texts(TextRequest<'a>),
}

/// Reading of one node of a server, of one sensor of this computer, or of one line of text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeReading {
    /// Value as registers, the most significant first; or the reason why there is no value.
    pub value: Result<Encoded, Reason>,
    /// Age of the value by its time stamp, if the server sent a time stamp.
    pub stamped: Stamped,
    /// Time from which the age of the value counts. For a value of a subscription, this is at the latest the
    /// time of the Publish request that the server has answered. `None`: the age counts from the present
    /// request.
    pub asked: Option<Moment>,
}

/// Age of a value by its time stamp: the time from the stamp to the answer, both by the clock of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamped {
    /// The value has no time stamp.
    Unknown,
    /// Time from the time stamp of the value to the answer.
    Ago(Duration),
    /// The time stamp of the value is later than the answer, so one of the clocks is wrong.
    Ahead,
}

/// Content of a checked answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Registers, exactly as many as requested.
    Registers(Vec<u16>),
    /// Bits, exactly as many as requested.
    Bits(Vec<bool>),
    /// Readings of nodes, sensors or texts, as many as requested and in the same order.
    Nodes(Vec<NodeReading>),
    /// Confirmation of a write. The answer repeats the request correctly.
    Done,
}

impl<'a> From<&'a ReadTarget> for Request<'a> {
    fn from(asked: &'a ReadTarget) -> Request<'a> {
        match asked {
            ReadTarget::Registers { from, count } => Request::read_registers(*from, *count),
            ReadTarget::Object(object) => Request::read_object(*object),
            ReadTarget::Nodes(nodes) => Request::read_nodes(nodes),
            ReadTarget::Subscription(sent) => Request::Nodes(NodeRequest::Latest(sent)),
            ReadTarget::Sensors(sensors) => Request::Sensors(SensorRequest(sensors)),
            ReadTarget::Texts(texts) => Request::Texts(TextRequest(texts)),
        }
    }
}

impl Answer {
    /// Returns the registers of the answer. For an answer with one node, returns the value of that node as registers;
    /// for other answers, an empty slice.
    pub fn registers(&self) -> &[u16] {
        match self {
            Answer::Registers(registers) => registers,
            Answer::Nodes(nodes) => match nodes.as_slice() {
                [NodeReading { value: Ok(value), .. }] => value.registers(),
                _ => &[],
            },
            Answer::Bits(_) | Answer::Done => &[],
        }
    }

    /// Returns the answer unchanged, if every node in it has a valid value.
    ///
    /// # Errors
    /// The fault of the first node without a valid value.
    pub fn accepted(self) -> Result<Answer, Fault> {
        let Answer::Nodes(nodes) = &self else { return Ok(self) };
        match nodes.iter().find_map(|node| node.value.err()) {
            Some(reason) => Err(Fault::of_a_node(reason)),
            None => Ok(self),
        }
    }

    /// Returns whether the answer contains any of the requested data. An answer with nodes contains data if at least
    /// one node has a valid value.
    pub fn is_of_use(&self) -> bool {
        match self {
            Answer::Nodes(nodes) => nodes.iter().any(|node| node.value.is_ok()),
            Answer::Registers(_) | Answer::Bits(_) | Answer::Done => true,
        }
    }

    /// Returns the age, by time stamp, of the reading for `field`, which describes the position of one value in the
    /// answer.
    pub fn stamped(&self, field: &plan::Field) -> Stamped {
        self.node(field).map_or(Stamped::Unknown, |node| node.stamped)
    }

    /// Returns the time of the earlier request from which the age of this field counts. `None`: the age counts from the
    /// present request.
    pub fn asked(&self, field: &plan::Field) -> Option<Moment> {
        self.node(field)?.asked
    }

    fn node(&self, field: &plan::Field) -> Option<&NodeReading> {
        if let Answer::Nodes(nodes) = self { nodes.get(usize::from(field.at)) } else { None }
    }

    /// Returns the registers of one value. `field` is the position of the value in the answer.
    ///
    /// # Errors
    /// [`Reason::BadReply`] if the answer contains no registers, or no registers at this position.
    pub fn encoded(&self, field: &plan::Field) -> Result<Encoded, Reason> {
        let (from, to) = (usize::from(field.at), usize::from(field.at) + usize::from(field.len));
        match self {
            Answer::Registers(registers) => registers.get(from..to).map(Encoded::of).ok_or(Reason::BadReply),
            Answer::Bits(_) | Answer::Nodes(_) | Answer::Done => Err(Reason::BadReply),
        }
    }

    /// Decodes the value of a signal. `field` is the position of the value in the answer.
    ///
    /// # Errors
    /// The reason why the signal has no valid value.
    pub fn decode(&self, field: &plan::Field, encoding: &Encoding) -> Result<f64, Reason> {
        let (from, to) = (usize::from(field.at), usize::from(field.at) + usize::from(field.len));
        match self {
            Answer::Registers(registers) => encoding.decode(registers.get(from..to).ok_or(Reason::BadReply)?),
            Answer::Bits(bits) => encoding.decode_bit(*bits.get(from).ok_or(Reason::BadReply)?),
            Answer::Nodes(nodes) => {
                encoding.decode(nodes.get(from).ok_or(Reason::BadReply)?.value?.registers())
            }
            Answer::Done => Err(Reason::BadReply),
        }
    }
}

impl<'a> Request<'a> {
    /// Returns a request that reads registers or bits of a Modbus unit.
    pub const fn read_registers(from: Register, count: u16) -> Request<'a> {
        Request::Modbus(ModbusRequest::Read { from, count })
    }

    /// Returns a request that reads an object of a CANopen node.
    pub const fn read_object(object: Object) -> Request<'a> {
        Request::Can(CanRequest::Read { object })
    }

    /// Returns a request that reads nodes of an OPC UA server.
    pub const fn read_nodes(nodes: &'a [Node]) -> Request<'a> {
        Request::Nodes(NodeRequest::Read(nodes))
    }

    /// Returns a request that reads the namespaces of an OPC UA server.
    pub const fn read_namespaces() -> Request<'a> {
        Request::Nodes(NodeRequest::Namespaces)
    }

    /// Returns the request that reads a value of this type; `None` if the address cannot be read by request.
    pub fn read(at: &'a Address, data_type: DataType) -> Option<Request<'a>> {
        match at {
            Address::Modbus(from) => Some(Request::read_registers(*from, data_type.registers())),
            Address::Object(object) => Some(Request::read_object(*object)),
            Address::Frame(_) => None,
            Address::Node(node) => Some(Request::read_nodes(std::slice::from_ref(node))),
            Address::Sensor(sensor) => Some(Request::Sensors(SensorRequest(std::slice::from_ref(sensor)))),
            Address::Text(text) => Some(Request::Texts(TextRequest(std::slice::from_ref(text)))),
        }
    }

    /// Returns a request that reads these registers, and may be sent together with another request. Returns `None` for
    /// targets that are not registers.
    pub const fn in_registers(asked: &ReadTarget) -> Option<Request<'static>> {
        match asked {
            ReadTarget::Registers { from, count } => Some(Request::read_registers(*from, *count)),
            _ => None,
        }
    }

    /// Returns the request that writes these values to the address, with one of the functions that the device supports.
    pub fn write(at: &'a Address, values: &'a [u16], functions: Functions) -> Request<'a> {
        match at {
            Address::Modbus(Register { offset, .. }) => Request::write_holding(*offset, values, functions),
            Address::Object(object) => Request::write_object(*object, values),
            Address::Frame(Field { frames, bits, .. }) => {
                Request::Can(CanRequest::Send { id: frames.id, bits: *bits, values })
            }
            Address::Node(node) => Request::write_nodes(std::slice::from_ref(node), values),
            // Sensors and texts cannot be written: this request never fits.
            Address::Sensor(_) | Address::Text(_) => Request::write_nodes(&[], values),
        }
    }

    /// Returns the request that writes a coil.
    pub const fn write_coil(at: u16, value: bool) -> Request<'a> {
        Request::Modbus(ModbusRequest::WriteCoil { at, value })
    }

    /// Returns the request that writes holding registers from `at`.
    pub const fn write_holding(at: u16, values: &'a [u16], functions: Functions) -> Request<'a> {
        Request::Modbus(ModbusRequest::write_holding(at, values, functions))
    }

    /// Returns a request that writes an object of a CANopen node.
    pub const fn write_object(object: Object, values: &'a [u16]) -> Request<'a> {
        Request::Can(CanRequest::Write { object, values })
    }

    /// Returns a request that writes nodes of an OPC UA server, all in one call.
    pub const fn write_nodes(nodes: &'a [Node], values: &'a [u16]) -> Request<'a> {
        Request::Nodes(NodeRequest::Write { nodes, values })
    }

    /// Returns the Modbus function code; 0 for requests that are not Modbus.
    pub const fn function(self) -> u8 {
        if let Request::Modbus(request) = self { request.function() } else { 0 }
    }

    /// Returns whether the device answers this request. A CAN frame with values has no answer.
    pub const fn is_answered(self) -> bool {
        !matches!(self, Request::Can(CanRequest::Send { .. }))
    }

    /// Returns whether the request only reads.
    pub const fn is_read(self) -> bool {
        match self {
            Request::Modbus(request) => request.is_read(),
            Request::Can(request) => matches!(request, CanRequest::Read { .. }),
            Request::Nodes(request) => !matches!(request, NodeRequest::Write { .. }),
            Request::Sensors(_) | Request::Texts(_) => true,
        }
    }

    /// Returns whether one protocol message can carry the request. A request must have at least one register, node,
    /// sensor or text, and no more registers than the protocol allows.
    pub fn fits(self) -> bool {
        match self {
            Request::Modbus(request) => request.fits(),
            Request::Can(_) => true,
            Request::Nodes(request) => request.fits(),
            Request::Sensors(SensorRequest(sensors)) => !sensors.is_empty(),
            Request::Texts(request) => request.fits(),
        }
    }
}

/// Formats the request: `read input:0..7`, `write holding:104 = 1 65535`.
impl fmt::Display for Request<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Request::Modbus(request) => fmt::Display::fmt(request, f),
            Request::Can(request) => fmt::Display::fmt(request, f),
            Request::Nodes(request) => fmt::Display::fmt(request, f),
            Request::Sensors(request) => fmt::Display::fmt(request, f),
            Request::Texts(request) => fmt::Display::fmt(request, f),
        }
    }
}

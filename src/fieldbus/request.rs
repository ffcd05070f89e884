//! What a device is asked, over whatever transport, and what its answer brings.

use std::time::Duration;

use super::error::Fault;
use isotherm_core::codec::{
    Address, BitField, CanId, DataType, Encoded, Encoding, Field, Node, Object, PcSensor, Register,
};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::Functions;
use isotherm_profile::plan::{self, ReadTarget, Subscription};

/// One request to one unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request<'a> {
    /// Functions 01 to 04, by table.
    Read {
        /// First register or bit.
        from: Register,
        /// How many.
        count: u16,
    },
    /// Function 05.
    WriteCoil {
        /// Zero-based coil.
        at: u16,
        /// On or off.
        value: bool,
    },
    /// Function 06.
    WriteSingle {
        /// Zero-based holding register.
        at: u16,
        /// Its new value.
        value: u16,
    },
    /// Function 16.
    WriteMultiple {
        /// Zero-based holding register.
        at: u16,
        /// The new values, lowest address first.
        values: &'a [u16],
    },
    /// Of a CAN line, where nothing is a register.
    Can(CanRequest<'a>),
    /// Of an OPC UA server.
    Nodes(NodeRequest<'a>),
    /// Sensors of this computer are read.
    Sensors(&'a [PcSensor]),
}

/// One request to an OPC UA server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeRequest<'a> {
    /// The values of these nodes are read.
    Read(&'a [Node]),
    /// What the server has sent of nodes that are subscribed to.
    Latest(&'a Subscription),
    /// The namespaces of the server are read again.
    Namespaces,
    /// The values of these are written, in one call.
    Write {
        /// Which.
        nodes: &'a [Node],
        /// Their new values one behind the other, of each the most significant register first.
        values: &'a [u16],
    },
}

/// What a server says of one node, or this computer of one of its sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeReading {
    /// Its value as registers, the most significant first; or why there is none.
    pub value: Result<Encoded, Reason>,
    /// When it was taken, as far as it is stamped.
    pub stamped: Stamped,
    /// When the question left that it answers, where that was before the one of the request.
    pub asked: Option<Moment>,
}

/// When a value was taken at its source, by the clock of the server that sends it: its stamp beside the time of the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamped {
    /// It is not stamped.
    Unknown,
    /// So long ago.
    Ago(Duration),
    /// Later than now: one of the clocks is wrong.
    Ahead,
}

/// One request to one device on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanRequest<'a> {
    /// An object of a node is read, by SDO.
    Read {
        /// Which.
        object: Object,
    },
    /// An object of a node is written, by SDO.
    Write {
        /// Which.
        object: Object,
        /// Its new value, the most significant register first.
        values: &'a [u16],
    },
    /// A value in a frame is sent, with what else is in there.
    Send {
        /// The frame.
        id: CanId,
        /// Where in there.
        bits: BitField,
        /// Its new value, the most significant register first.
        values: &'a [u16],
    },
}

/// What a checked answer brings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Exactly as many registers as were asked for.
    Registers(Vec<u16>),
    /// Exactly as many bits as were asked for.
    Bits(Vec<bool>),
    /// As many nodes or sensors as were asked for, in this order.
    Nodes(Vec<NodeReading>),
    /// A write, repeated as it was sent.
    Done,
}

impl<'a> From<&'a ReadTarget> for Request<'a> {
    fn from(asked: &'a ReadTarget) -> Request<'a> {
        match asked {
            ReadTarget::Registers { from, count } => Request::Read { from: *from, count: *count },
            ReadTarget::Object(object) => Request::Can(CanRequest::Read { object: *object }),
            ReadTarget::Nodes(nodes) => Request::Nodes(NodeRequest::Read(nodes)),
            ReadTarget::Subscription(sent) => Request::Nodes(NodeRequest::Latest(sent)),
            ReadTarget::Sensors(sensors) => Request::Sensors(sensors),
        }
    }
}

impl Answer {
    /// The registers that it brings, or those of its only node; none where it brings something else.
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

    /// It, where every node in it can be believed.
    ///
    /// # Errors
    /// What the server says of the first that cannot.
    pub fn believed(self) -> Result<Answer, Fault> {
        let Answer::Nodes(nodes) = &self else { return Ok(self) };
        match nodes.iter().find_map(|node| node.value.err()) {
            Some(reason) => Err(Fault::of_a_node(reason)),
            None => Ok(self),
        }
    }

    /// Returns whether it brings anything that was asked for: of nodes, at least one that is good.
    pub fn is_of_use(&self) -> bool {
        match self {
            Answer::Nodes(nodes) => nodes.iter().any(|node| node.value.is_ok()),
            Answer::Registers(_) | Answer::Bits(_) | Answer::Done => true,
        }
    }

    /// When this part of it was stamped.
    pub fn stamped(&self, field: &plan::Field) -> Stamped {
        self.node(field).map_or(Stamped::Unknown, |node| node.stamped)
    }

    /// When the question left that this part of it answers, where that was before the one of the request.
    pub fn asked(&self, field: &plan::Field) -> Option<Moment> {
        self.node(field)?.asked
    }

    fn node(&self, field: &plan::Field) -> Option<&NodeReading> {
        if let Answer::Nodes(nodes) = self { nodes.get(usize::from(field.at)) } else { None }
    }

    /// The value of a signal from its part of the answer.
    ///
    /// # Errors
    /// Why there is none.
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
    /// What reads a value of this type there; `None` where nobody can be asked for it.
    pub fn read(at: &'a Address, data_type: DataType) -> Option<Request<'a>> {
        match at {
            Address::Modbus(from) => Some(Request::Read { from: *from, count: data_type.registers() }),
            Address::Object(object) => Some(Request::Can(CanRequest::Read { object: *object })),
            Address::Frame(_) => None,
            Address::Node(node) => Some(Request::Nodes(NodeRequest::Read(std::slice::from_ref(node)))),
            Address::Sensor(sensor) => Some(Request::Sensors(std::slice::from_ref(sensor))),
        }
    }

    /// What reads registers there, which may go out behind another question; `None` for anything else.
    pub const fn in_registers(asked: &ReadTarget) -> Option<Request<'static>> {
        match asked {
            ReadTarget::Registers { from, count } => Some(Request::Read { from: *from, count: *count }),
            ReadTarget::Object(_)
            | ReadTarget::Nodes(_)
            | ReadTarget::Subscription(_)
            | ReadTarget::Sensors(_) => None,
        }
    }

    /// The request that writes these values to that address, with a function that the device supports.
    pub fn write(at: &'a Address, values: &'a [u16], functions: Functions) -> Request<'a> {
        match at {
            Address::Modbus(Register { offset, .. }) => Request::write_holding(*offset, values, functions),
            Address::Object(object) => Request::Can(CanRequest::Write { object: *object, values }),
            Address::Frame(Field { frames, bits, .. }) => {
                Request::Can(CanRequest::Send { id: frames.id, bits: *bits, values })
            }
            Address::Node(node) => {
                Request::Nodes(NodeRequest::Write { nodes: std::slice::from_ref(node), values })
            }
            // Nothing is written there: a request that never fits.
            Address::Sensor(_) => Request::Nodes(NodeRequest::Write { nodes: &[], values }),
        }
    }

    /// What writes holding registers from this one on.
    pub const fn write_holding(at: u16, values: &'a [u16], functions: Functions) -> Request<'a> {
        match values {
            [value] if functions.write_single => Request::WriteSingle { at, value: *value },
            values => Request::WriteMultiple { at, values },
        }
    }

    /// The Modbus function code it needs; 0 for what is no register.
    pub const fn function(self) -> u8 {
        match self {
            Request::Read { from, .. } => from.table.read_function(),
            Request::WriteCoil { .. } => 5,
            Request::WriteSingle { .. } => 6,
            Request::WriteMultiple { .. } => 16,
            Request::Can(_) | Request::Nodes(_) | Request::Sensors(_) => 0,
        }
    }

    /// The device answers it. A frame that is sent is only on the bus.
    pub const fn is_answered(self) -> bool {
        !matches!(self, Request::Can(CanRequest::Send { .. }))
    }

    /// It changes nothing.
    pub const fn is_read(self) -> bool {
        matches!(
            self,
            Request::Read { .. }
                | Request::Can(CanRequest::Read { .. })
                | Request::Nodes(NodeRequest::Read(_) | NodeRequest::Latest(_) | NodeRequest::Namespaces)
                | Request::Sensors(_)
        )
    }

    /// Whether one request can carry it.
    pub fn fits(self) -> bool {
        let (at, count, most) = match self {
            Request::Read { from, count } => {
                (from.offset, count, if from.table.is_bits() { 2000 } else { 125 })
            }
            Request::WriteCoil { at, .. } | Request::WriteSingle { at, .. } => (at, 1, 1),
            Request::WriteMultiple { at, values } => {
                (at, u16::try_from(values.len()).unwrap_or(u16::MAX), 123)
            }
            Request::Nodes(NodeRequest::Read(nodes)) => return !nodes.is_empty(),
            Request::Nodes(NodeRequest::Latest(sent)) => return !sent.nodes.is_empty(),
            Request::Sensors(sensors) => return !sensors.is_empty(),
            Request::Nodes(NodeRequest::Write { nodes, values }) => {
                let registers: usize =
                    nodes.iter().map(|node| usize::from(node.taken_as().registers())).sum();
                return !nodes.is_empty() && registers == values.len();
            }
            Request::Can(_) | Request::Nodes(NodeRequest::Namespaces) => return true,
        };
        (1..=most).contains(&count) && u32::from(at) + u32::from(count) <= 65536
    }
}

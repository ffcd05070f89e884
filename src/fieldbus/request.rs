//! Requests to devices over any transport, and their answers.

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
    /// Read of registers or bits, with function 01 to 04 according to the table of `from`.
    Read {
        /// First register or bit.
        from: Register,
        /// Number of registers or bits.
        count: u16,
    },
    /// Write of one coil, with function 05.
    WriteCoil {
        /// Zero-based address of the coil.
        at: u16,
        /// New state of the coil: on or off.
        value: bool,
    },
    /// Write of one holding register, with function 06.
    WriteSingle {
        /// Zero-based address of the holding register.
        at: u16,
        /// New value of the register.
        value: u16,
    },
    /// Write of holding registers, with function 16.
    WriteMultiple {
        /// Zero-based address of the first holding register.
        at: u16,
        /// New values, lowest address first.
        values: &'a [u16],
    },
    /// Request on a CAN line. It addresses objects and frames, not registers.
    Can(CanRequest<'a>),
    /// Request to an OPC UA server.
    Nodes(NodeRequest<'a>),
    /// Read of these sensors of this computer, by the files of its kernel.
    Sensors(&'a [PcSensor]),
}

/// One request to an OPC UA server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeRequest<'a> {
    /// Read of the values of these nodes.
    Read(&'a [Node]),
    /// Latest values of nodes to which the server sends changes by subscription.
    Latest(&'a Subscription),
    /// Read of the namespaces of the server.
    Namespaces,
    /// Write of the values of several nodes, in one call.
    Write {
        /// Nodes to write.
        nodes: &'a [Node],
        /// New values in the order of the nodes, each with its most significant register first.
        values: &'a [u16],
    },
}

/// Reading of one node of a server, or of one sensor of this computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeReading {
    /// Value as registers, the most significant first; or the reason why there is none.
    pub value: Result<Encoded, Reason>,
    /// Time stamp of the value, as an age.
    pub stamped: Stamped,
    /// Time of the earlier request from which the age of the value counts, as in a subscription. `None`: the age counts
    /// from this request.
    pub asked: Option<Moment>,
}

/// Age of a value by its time stamp: the time from the stamp to the answer, both by the clock of the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stamped {
    /// The value has no time stamp.
    Unknown,
    /// Age of the value.
    Ago(Duration),
    /// The stamp is later than the answer, so one of the clocks is wrong.
    Ahead,
}

/// One request to one device on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CanRequest<'a> {
    /// Read of an object of a node by SDO.
    Read {
        /// Object to read.
        object: Object,
    },
    /// Write of an object of a node by SDO.
    Write {
        /// Object to write.
        object: Object,
        /// New value, the most significant register first.
        values: &'a [u16],
    },
    /// Value to send in a frame. The frame also contains the last values of its other bits.
    Send {
        /// Identifier of the frame.
        id: CanId,
        /// Bits of the value in the frame.
        bits: BitField,
        /// New value, the most significant register first.
        values: &'a [u16],
    },
}

/// Content of a checked answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// Registers, exactly as many as requested.
    Registers(Vec<u16>),
    /// Bits, exactly as many as requested.
    Bits(Vec<bool>),
    /// Readings of nodes or sensors, as many as requested and in the same order.
    Nodes(Vec<NodeReading>),
    /// Confirmation of a write. It repeats the request correctly.
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

    /// Returns the time stamp of the part of the answer in which this field is.
    pub fn stamped(&self, field: &plan::Field) -> Stamped {
        self.node(field).map_or(Stamped::Unknown, |node| node.stamped)
    }

    /// Returns the time of the earlier request from which the age of this field counts. `None`: it counts from the
    /// present request.
    pub fn asked(&self, field: &plan::Field) -> Option<Moment> {
        self.node(field)?.asked
    }

    fn node(&self, field: &plan::Field) -> Option<&NodeReading> {
        if let Answer::Nodes(nodes) = self { nodes.get(usize::from(field.at)) } else { None }
    }

    /// Decodes the value of a signal from the part of the answer in which its field is.
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
    /// Returns the request that reads a value of this type. Returns `None` if the value at this address is only
    /// received in frames, and cannot be requested.
    pub fn read(at: &'a Address, data_type: DataType) -> Option<Request<'a>> {
        match at {
            Address::Modbus(from) => Some(Request::Read { from: *from, count: data_type.registers() }),
            Address::Object(object) => Some(Request::Can(CanRequest::Read { object: *object })),
            Address::Frame(_) => None,
            Address::Node(node) => Some(Request::Nodes(NodeRequest::Read(std::slice::from_ref(node)))),
            Address::Sensor(sensor) => Some(Request::Sensors(std::slice::from_ref(sensor))),
        }
    }

    /// Returns the read of these registers, which may be sent together with another request. Returns `None` for targets
    /// that are not registers.
    pub const fn in_registers(asked: &ReadTarget) -> Option<Request<'static>> {
        match asked {
            ReadTarget::Registers { from, count } => Some(Request::Read { from: *from, count: *count }),
            ReadTarget::Object(_)
            | ReadTarget::Nodes(_)
            | ReadTarget::Subscription(_)
            | ReadTarget::Sensors(_) => None,
        }
    }

    /// Returns the request that writes these values to the address, with one of the functions that the device supports.
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
            // Sensors cannot be written: this request never fits.
            Address::Sensor(_) => Request::Nodes(NodeRequest::Write { nodes: &[], values }),
        }
    }

    /// Returns the request that writes holding registers from address `at`, with function 06 or 16.
    pub const fn write_holding(at: u16, values: &'a [u16], functions: Functions) -> Request<'a> {
        match values {
            [value] if functions.write_single => Request::WriteSingle { at, value: *value },
            values => Request::WriteMultiple { at, values },
        }
    }

    /// Returns the Modbus function code; 0 for requests that are not Modbus.
    pub const fn function(self) -> u8 {
        match self {
            Request::Read { from, .. } => from.table.read_function(),
            Request::WriteCoil { .. } => 5,
            Request::WriteSingle { .. } => 6,
            Request::WriteMultiple { .. } => 16,
            Request::Can(_) | Request::Nodes(_) | Request::Sensors(_) => 0,
        }
    }

    /// Returns whether the device answers this request. A CAN frame with values has no answer.
    pub const fn is_answered(self) -> bool {
        !matches!(self, Request::Can(CanRequest::Send { .. }))
    }

    /// Returns whether the request only reads.
    pub const fn is_read(self) -> bool {
        matches!(
            self,
            Request::Read { .. }
                | Request::Can(CanRequest::Read { .. })
                | Request::Nodes(NodeRequest::Read(_) | NodeRequest::Latest(_) | NodeRequest::Namespaces)
                | Request::Sensors(_)
        )
    }

    /// Returns whether one protocol message can carry the request. It must have at least one register, node or sensor,
    /// and no more registers than the protocol allows.
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

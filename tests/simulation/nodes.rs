//! Simulated OPC UA server. Its nodes are the registers of a device, and the faults of the line affect the device
//! behind it. A second namespace has the same nodes for another machine. After each restart, both namespaces have
//! exchanged their indexes.

use isotherm::fieldbus::error::{CallerFault, Fault};
use isotherm::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm::fieldbus::kinds::opcua::namespaces::NamespaceTable;
use isotherm::fieldbus::send_guard::SendGuard;
use isotherm::fieldbus::wire::{
    Answer, Boxed, ModbusRequest, NodeReading, NodeRequest, Request, Stamped, Wire,
};
use isotherm_core::codec::{Encoded, Identifier, Namespace, Node, NodeId, Register, Scalar};
use isotherm_core::reading::{Reason, Status};

use crate::stream::Shared;

/// BadDeviceFailure: the write may have been executed.
const FAILED: Status = Status(0x808b_0000);

/// Unit of the device behind the server; the server itself has no such number.
const UNIT: u8 = 1;

/// Values of the other machine's nodes: 90 °C, and the same type code.
const OTHERS: [(&str, u16); 1] = [("holding:60", 7)];
const OTHER: u16 = 9000;

pub(crate) struct Nodes {
    pub(crate) below: ModbusTcp,
    pub(crate) shared: Shared,
    /// Current index of the namespace that the profile names by index. `None` if the gateway uses the index of the
    /// profile.
    pub(crate) namespaces: Option<NamespaceTable>,
    /// State of the servers when the connection was opened.
    pub(crate) servers: Servers,
}

/// Servers of a machine, which are restarted together.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Servers {
    pub(crate) are_there: bool,
    pub(crate) starts: u64,
}

impl Servers {
    /// Namespace array of the servers.
    pub(crate) fn array(self) -> Vec<String> {
        let (first, second) =
            if self.starts.is_multiple_of(2) { ("machine", "other") } else { ("other", "machine") };
        vec!["http://opcfoundation.org/UA/".to_owned(), format!("urn:{first}"), format!("urn:{second}")]
    }

    fn is_ours(self, index: u16) -> bool {
        self.array().get(usize::from(index)).is_some_and(|uri| uri == "urn:machine")
    }
}

/// Parses the register in a node identifier like `ns=1;s=holding:10`.
fn register(id: &NodeId) -> Result<Register, Fault> {
    let Identifier::Text(name) = &id.identifier else { return Err(Fault::Status(Status::NO_SUCH_NODE)) };
    name.parse().map_err(|_| Fault::Status(Status::NO_SUCH_NODE))
}

/// Converts an exception of the device to the status of the server. The first three exclude that the request was
/// executed, as in Modbus.
fn status(exception: u8) -> Status {
    match exception {
        1 => Status::NOT_WRITABLE,
        2 => Status::NO_SUCH_NODE,
        3 => Status::OUT_OF_RANGE,
        _ => FAILED,
    }
}

impl Nodes {
    /// Returns whether the node belongs to this machine. `None` if the server does not have it.
    fn is_ours(&self, id: &NodeId) -> Option<bool> {
        let Namespace::Index(named) = id.namespace else { return None };
        let index = match &self.namespaces {
            Some(table) => table.index(named)?,
            None => named,
        };
        Some(self.servers.is_ours(index))
    }

    /// Reading of a node of the other machine, or of an unknown node.
    fn of_other(&self, node: &Node) -> NodeReading {
        let name = node.id.to_string();
        let known = OTHERS.iter().find(|(place, _)| name.ends_with(place));
        let value = match self.is_ours(&node.id) {
            Some(_) => Ok(node.word(known.map_or(OTHER, |(_, value)| *value))),
            None => Err(Reason::Status(Status::NO_SUCH_NODE.0)),
        };
        NodeReading { value, stamped: Stamped::Unknown, asked: None }
    }

    async fn ask(&mut self, request: Request<'_>, send_guard: &mut SendGuard) -> Result<Answer, Fault> {
        match request {
            Request::Nodes(NodeRequest::Read(nodes)) => self.read(nodes, send_guard).await,
            Request::Nodes(NodeRequest::Namespaces) => send_guard.leave().map(|_| Answer::Done),
            Request::Nodes(NodeRequest::Write { nodes: [node], values }) => {
                let at = register(&node.id)?.offset;
                match self.is_ours(&node.id) {
                    Some(true) => {}
                    Some(false) => {
                        let mut world = self.shared.world();
                        world
                            .machine
                            .laws
                            .broken
                            .get_or_insert(format!("{at} is written in another machine"));
                        return Err(Fault::Status(FAILED));
                    }
                    None => return Err(Fault::Status(Status::NO_SUCH_NODE)),
                }
                let request = match *values {
                    [value] => Request::Modbus(ModbusRequest::WriteSingle { at, value }),
                    _ => Request::Modbus(ModbusRequest::WriteMultiple { at, values }),
                };
                match self.below.exchange(UNIT, request, send_guard).await {
                    Err(Fault::Exception(code)) => Err(Fault::Status(status(code))),
                    answered => answered,
                }
            }
            _ => Err(Fault::Caller(CallerFault::Function)),
        }
    }

    /// Reads all nodes with one request, including the registers between them.
    async fn read(&mut self, nodes: &[Node], send_guard: &mut SendGuard) -> Result<Answer, Fault> {
        let places: Vec<Register> = nodes.iter().map(|node| register(&node.id)).collect::<Result<_, _>>()?;
        if nodes.iter().any(|node| self.is_ours(&node.id) != Some(true)) {
            send_guard.leave()?;
            return Ok(Answer::Nodes(nodes.iter().map(|node| self.of_other(node)).collect()));
        }
        let from =
            *places.iter().min_by_key(|place| place.offset).ok_or(Fault::Caller(CallerFault::Extent))?;
        let ends = places.iter().zip(nodes).map(|(place, node)| place.offset + node.taken_as().registers());
        let count = ends.max().unwrap_or_default() - from.offset;
        let answered = self.below.exchange(UNIT, Request::read_registers(from, count), send_guard).await;
        let value = |node: &Node, place: &Register| match &answered {
            Ok(answer) => {
                let at = usize::from(place.offset - from.offset);
                let own = &answer.registers()[at..at + usize::from(node.taken_as().registers())];
                node.registers(Scalar { data_type: node.taken_as(), bits: Encoded::of(own).bits() })
            }
            Err(Fault::Exception(code)) => Err(Reason::Status(status(*code).0)),
            Err(_) => Err(Reason::BadReply),
        };
        let found = nodes.iter().zip(&places).map(|(node, place)| NodeReading {
            value: value(node, place),
            stamped: Stamped::Unknown,
            asked: None,
        });
        let found = found.collect();
        match answered {
            Ok(_) | Err(Fault::Exception(_)) => Ok(Answer::Nodes(found)),
            Err(fault) => Err(fault),
        }
    }
}

impl Wire for Nodes {
    fn exchange<'a>(
        &'a mut self,
        _: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.ask(request, send_guard))
    }
}

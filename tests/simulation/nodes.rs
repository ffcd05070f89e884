//! A server of OPC UA in the simulation: its nodes are the registers of a device, and what befalls the line befalls what lies below.

use isotherm::fieldbus::departure::Departure;
use isotherm::fieldbus::error::{CallerFault, Fault};
use isotherm::fieldbus::modbus::ModbusTcp;
use isotherm::fieldbus::wire::{Answer, Boxed, NodeReading, NodeRequest, Request, Stamped, Wire};
use isotherm_core::codec::{Encoded, Identifier, Node, NodeId, Register, Scalar};
use isotherm_core::reading::{Reason, Status};

/// BadDeviceFailure: a write may have been done.
const FAILED: Status = Status(0x808b_0000);

/// The device below; a server has no such number.
const UNIT: u8 = 1;

pub(crate) struct Nodes(pub(crate) ModbusTcp);

/// `ns=1;s=holding:10`
fn register(id: &NodeId) -> Result<Register, Fault> {
    let Identifier::Text(name) = &id.identifier else { return Err(Fault::Status(Status::NO_SUCH_NODE)) };
    name.parse().map_err(|_| Fault::Status(Status::NO_SUCH_NODE))
}

/// What a device says no with, in the words of a server: done is what one of the first three says no to in neither of them.
fn status(exception: u8) -> Status {
    match exception {
        1 => Status::NOT_WRITABLE,
        2 => Status::NO_SUCH_NODE,
        3 => Status::OUT_OF_RANGE,
        _ => FAILED,
    }
}

impl Nodes {
    async fn ask(&mut self, request: Request<'_>, departure: &mut Departure) -> Result<Answer, Fault> {
        match request {
            Request::Nodes(NodeRequest::Read(nodes)) => self.read(nodes, departure).await,
            Request::Nodes(NodeRequest::Write { nodes: [node], values }) => {
                let at = register(&node.id)?.offset;
                let request = match *values {
                    [value] => Request::WriteSingle { at, value },
                    _ => Request::WriteMultiple { at, values },
                };
                match self.0.exchange(UNIT, request, departure).await {
                    Err(Fault::Exception(code)) => Err(Fault::Status(status(code))),
                    answered => answered,
                }
            }
            _ => Err(Fault::Caller(CallerFault::Function)),
        }
    }

    /// All of them in one question, which asks for what lies between them, too.
    async fn read(&mut self, nodes: &[Node], departure: &mut Departure) -> Result<Answer, Fault> {
        let places: Vec<Register> = nodes.iter().map(|node| register(&node.id)).collect::<Result<_, _>>()?;
        let from =
            *places.iter().min_by_key(|place| place.offset).ok_or(Fault::Caller(CallerFault::Extent))?;
        let ends = places.iter().zip(nodes).map(|(place, node)| place.offset + node.taken_as().registers());
        let count = ends.max().unwrap_or_default() - from.offset;
        let answered = self.0.exchange(UNIT, Request::Read { from, count }, departure).await;
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
        departure: &'a mut Departure,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(self.ask(request, departure))
    }
}

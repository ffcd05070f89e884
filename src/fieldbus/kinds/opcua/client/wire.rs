//! One request and its answer in an OPC UA session.

use std::time::Duration;

use ::opcua::client::UARequest;
use ::opcua::client::services::{Read, Write};
use ::opcua::types::{
    AttributeId, DataValue, DateTime, Error, NodeId, ReadResponse, TimestampsToReturn, VariableId, WriteValue,
};
use isotherm_core::codec::Node;
use isotherm_core::reading::{Reason, Status};
use isotherm_profile::plan::Subscription;

use super::OPENING;
use super::call_size::Service;
use super::channel::Link;
use super::publishing::{Latest, Publishing};
use super::session::{Limits, Session, answered, value_of};
use super::status::all_written;
use super::value::reading;
use crate::fieldbus::error::{CallerFault, Fault, PeerFault};
use crate::fieldbus::kinds::opcua::conversion::variant;
use crate::fieldbus::send_guard::SendGuard;
use crate::fieldbus::wire::{Answer, Boxed, Call, Ending, NodeReading, NodeRequest, Request, Stamped, Wire};

/// Connection of an OPC UA line: an open session on an open channel.
pub(super) struct OpcUa {
    link: Link,
    session: Session,
    limits: Limits,
    publishing: Publishing,
}

impl OpcUa {
    pub(super) fn new(link: Link, session: Session, limits: Limits) -> OpcUa {
        OpcUa { link, session, limits, publishing: Publishing::default() }
    }

    async fn exchange(&mut self, request: Request<'_>, send_guard: &mut SendGuard) -> Result<Answer, Fault> {
        let Request::Nodes(request) = request else { return Err(Fault::Caller(CallerFault::Function)) };
        if self.link.is_closed().await {
            return Err(Fault::CLOSED);
        }
        if self.link.is_due_for_new_keys() {
            self.renew_keys().await?;
        }
        match request {
            NodeRequest::Read(nodes) => self.read(nodes, send_guard).await,
            NodeRequest::Latest(asked) => self.latest(asked, send_guard).await,
            NodeRequest::Namespaces => {
                send_guard.leave()?;
                let table = self.session.namespaces().table();
                let read = self.session.read_namespaces(&mut self.link, &table).await;
                read.map(|()| Answer::Done).map_err(|error| self.session.failed(&error))
            }
            NodeRequest::Write { nodes, values } => self.write(nodes, values, send_guard).await,
        }
    }

    /// Returns the values that the server has sent by subscription, if all are known. Otherwise reads the nodes.
    async fn latest(&mut self, asked: &Subscription, send_guard: &mut SendGuard) -> Result<Answer, Fault> {
        let now = send_guard.leave()?;
        let OpcUa { link, session, publishing, .. } = self;
        let taken_in = publishing.take_in(link, session, now).await;
        taken_in.map_err(|error| session.failed(&error))?;
        match self.publishing.latest(asked, now) {
            Latest::Known(nodes) => Ok(Answer::Nodes(nodes)),
            Latest::Unknown => self.read(&asked.nodes, send_guard).await,
            Latest::Silent => Err(Fault::Peer(PeerFault::Silent)),
            Latest::New => {
                let answer = self.read(&asked.nodes, send_guard).await?;
                let OpcUa { link, session, publishing, .. } = self;
                let subscribed = publishing.subscribe(link, session, asked, now).await;
                subscribed.map_err(|error| session.failed(&error))?;
                Ok(answer)
            }
        }
    }

    /// Reads nodes, in several calls if the server does not accept them in one call. The age of all values counts from
    /// the first call. A node whose namespace the server does not have is not requested.
    async fn read(&mut self, nodes: &[Node], send_guard: &mut SendGuard) -> Result<Answer, Fault> {
        let namespaces = self.session.namespaces();
        let known: Result<Vec<Option<NodeId>>, Fault> =
            nodes.iter().map(|node| namespaces.node_id(&node.id)).collect();
        let known = known?;
        let (ids, places) = distinct(nodes, &known);
        let ids: Vec<_> = ids.into_iter().map(value_of).collect();
        let mut found = Vec::with_capacity(ids.len());
        send_guard.leave()?;
        while let Some(rest) = ids.get(found.len()..).filter(|rest| !rest.is_empty()) {
            let count = self.session.sizes().next(Service::Read, rest.len().min(self.limits.read));
            match self.call(rest[..count].to_vec(), TimestampsToReturn::Source).await {
                Ok(answer) => {
                    let (values, at) = answered(answer, count)?;
                    found.extend(values.into_iter().map(|value| (value, at)));
                }
                Err(error) => {
                    let refused = self.session.smaller(count, &error)?;
                    found.extend(refused.map(|value| (value, DateTime::null())));
                }
            }
        }
        let each = nodes.iter().zip(places).map(|(node, place)| {
            let found = place.and_then(|place| found.get(place));
            found.map_or_else(not_there, |(value, answered)| reading(node, value, *answered))
        });
        Ok(Answer::Nodes(each.collect()))
    }

    /// Writes each value with the type of its node, all in one call. The values are sent without a time and a quality,
    /// because many servers reject a write with them.
    async fn write(
        &mut self,
        nodes: &[Node],
        mut values: &[u16],
        send_guard: &mut SendGuard,
    ) -> Result<Answer, Fault> {
        if nodes.len() > self.limits.write {
            let most = u32::try_from(self.limits.write).unwrap_or(u32::MAX);
            return Err(Fault::Caller(CallerFault::TooManyNodes(most)));
        }
        let namespaces = self.session.namespaces();
        let each = nodes.iter().map(|node| {
            let extent = Fault::Caller(CallerFault::Extent);
            let (own, rest) =
                values.split_at_checked(usize::from(node.taken_as().registers())).ok_or(extent)?;
            values = rest;
            let id = namespaces.node_id(&node.id)?.ok_or(Fault::Status(Status::NO_SUCH_NODE))?;
            written(node, id, own).ok_or(extent)
        });
        let each: Vec<WriteValue> = each.collect::<Result<_, Fault>>()?;
        let channel = self.link.channel.clone();
        let handle = channel.request_handle();
        let write =
            Write::new_manual(0, self.session.patience(), self.session.token(), handle).nodes_to_write(each);
        send_guard.leave()?;
        let answer =
            self.link.ask(write.send(&channel)).await.map_err(|error| self.session.failed(&error))?;
        let said = answer.results.unwrap_or_default();
        if said.len() != nodes.len() {
            return Err(Fault::Peer(PeerFault::Length));
        }
        let said: Vec<Status> = said.into_iter().map(|status| Status(status.bits())).collect();
        all_written(&said)
    }

    async fn call(
        &mut self,
        nodes: Vec<::opcua::types::ReadValueId>,
        stamps: TimestampsToReturn,
    ) -> Result<ReadResponse, Error> {
        let channel = self.link.channel.clone();
        let handle = channel.request_handle();
        // With a maximum age of zero, the server reads its source again.
        let read = Read::new_manual(0, self.session.patience(), self.session.token(), handle)
            .timestamps_to_return(stamps)
            .max_age(0.0)
            .nodes_to_read(nodes);
        self.link.ask(read.send(&channel)).await
    }

    /// Renews the keys of the channel, if that is due. Otherwise the library would renew the keys after the check of
    /// the send deadline, and delay the request.
    async fn renew_keys(&mut self) -> Result<(), Fault> {
        let state = value_of(VariableId::Server_ServerStatus_State.into());
        let renewed = self.call(vec![state], TimestampsToReturn::Neither).await;
        renewed.map(|_| ()).map_err(|error| self.session.failed(&error))
    }
}

/// Returns the identifiers of the nodes to request, each only once. The second list contains, for each node of the
/// profile, the index of its value in the answer. All elements of an array share one entry. A node without an
/// identifier is not requested, and gets `None`.
fn distinct(nodes: &[Node], known: &[Option<NodeId>]) -> (Vec<NodeId>, Vec<Option<usize>>) {
    let (mut ids, mut arrays): (Vec<NodeId>, Vec<usize>) = (Vec::with_capacity(nodes.len()), Vec::new());
    let places = nodes.iter().zip(known).map(|(node, id)| {
        let id = id.as_ref()?;
        if node.element.is_some() {
            if let Some(place) = arrays.iter().copied().find(|place| ids[*place] == *id) {
                return Some(place);
            }
            arrays.push(ids.len());
        }
        ids.push(id.clone());
        Some(ids.len() - 1)
    });
    let places = places.collect();
    (ids, places)
}

/// Returns the reading of a node whose namespace the server does not have. The status of the reading is "no such node".
fn not_there() -> NodeReading {
    NodeReading { value: Err(Reason::Status(Status::NO_SUCH_NODE.0)), stamped: Stamped::Unknown, asked: None }
}

fn written(node: &Node, node_id: NodeId, value: &[u16]) -> Option<WriteValue> {
    Some(WriteValue {
        node_id,
        attribute_id: AttributeId::Value as u32,
        index_range: Default::default(),
        value: DataValue { value: Some(variant(node.scalar(value))?), ..DataValue::null() },
    })
}

impl Wire for OpcUa {
    fn exchange<'a>(&'a mut self, _: u8, request: Request<'a>, send_guard: &'a mut SendGuard) -> Call<'a> {
        Box::pin(self.exchange(request, send_guard))
    }

    fn time_under_way(&self, request: Request<'_>) -> Duration {
        match request {
            Request::Nodes(NodeRequest::Latest(asked)) if self.publishing.may_take_long(asked) => OPENING,
            _ => Duration::ZERO,
        }
    }

    fn news(&mut self) -> Option<String> {
        self.publishing.news()
    }

    /// Returns [`Ending::Kept`]. An exchanged or restarted server no longer has the session, which the next connection
    /// detects.
    fn ending(&mut self) -> Ending {
        Ending::Kept
    }

    fn close(&mut self) -> Boxed<'_, ()> {
        Box::pin(self.session.close(&mut self.link))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::Element;

    #[test]
    fn the_elements_of_an_array_are_one_node_of_a_request() {
        let node = |name: &str| Node::new(format!("ns=2;s={name}").parse().unwrap(), None);
        let element = |name, index| Node { element: Element::new(vec![index]), ..node(name) };
        let nodes = [node("bed"), element("temps", 0), node("bed"), element("temps", 3), element("other", 0)];
        let id = |name: &str| NodeId::new(2, name);
        let known = ["bed", "temps", "bed", "temps"].map(|name| Some(id(name)));
        let known: Vec<_> = known.into_iter().chain([None]).collect();
        let (ids, places) = distinct(&nodes, &known);
        assert_eq!(ids, [id("bed"), id("temps"), id("bed")]);
        assert_eq!(places, [Some(0), Some(1), Some(2), Some(1), None]);
    }
}

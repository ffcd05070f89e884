//! Session with an OPC UA server: creation, resumption on a new channel, and the limits of the server.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use ::opcua::client::services::{ActivateSession, CloseSession, Read};
use ::opcua::client::{IdentityToken, UARequest};
use ::opcua::core::ResponseMessage;
use ::opcua::crypto::{PrivateKey, SecurityPolicy, X509, random, verify_signature_data};
use ::opcua::types::{
    ApplicationDescription, ApplicationType, AttributeId, ByteString, CreateSessionRequest,
    CreateSessionResponse, DataValue, DateTime, EndpointDescription, Error, GetEndpointsRequest, NodeId,
    ReadResponse, ReadValueId, RequestHeader, StatusCode, TimestampsToReturn, VariableId, Variant,
};

use super::call_size::{CallSizes, Service, SizeRefusal, size_refusal};
use super::chain::leaf;
use super::channel::{Link, patience};
use super::endpoint::{is_confirmed, security_of};
use super::namespaces::Namespaces;
use super::status::{call_fault, dial_fault, is_of_the_session, list_fault};
use super::value::without_value;
use super::{OPENING, fault};
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::kinds::opcua::fault::OpcUaFault;
use crate::fieldbus::kinds::opcua::namespaces::NamespaceTable;

/// Time in milliseconds after which the server ends a session without requests. The session of a gateway that was
/// killed occupies the server for this time.
const LIFETIME: f64 = 60_000.0;
const NONCE: usize = 32;
/// Maximum wait for the server's answer when the gateway closes a session that it cannot use.
const CLOSING: Duration = Duration::from_secs(1);

/// OPC UA session. Clones share its data.
#[derive(Clone)]
pub(super) struct Session {
    application: String,
    timeout: Duration,
    held: Arc<Mutex<Option<ServerSession>>>,
    sizes: CallSizes,
}

/// Data of a session that exists at the server.
#[derive(Clone)]
struct ServerSession {
    /// Authentication token, which each request of the session contains.
    token: NodeId,
    /// Random number of the server that the next signature must include.
    nonce: ByteString,
    /// Subscriptions of the session that the gateway has not deleted yet.
    subscriptions: Vec<u32>,
    /// Namespaces of the server, as read when the connection was opened.
    namespaces: Namespaces,
}

/// Endpoint of a server, and the identity with which the gateway logs in to it.
#[derive(Clone, Copy)]
pub(super) struct Login<'a> {
    pub(super) endpoint: &'a EndpointDescription,
    /// Certificate of the gateway with its private key; `None` without security.
    pub(super) own: Option<&'a (X509, PrivateKey)>,
    pub(super) user: &'a IdentityToken,
}

/// Maximum number of nodes that the server accepts in one call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Limits {
    pub(super) read: usize,
    pub(super) write: usize,
}

/// Queries the endpoints of a server: their URLs, security modes and login methods.
pub(super) async fn endpoints(
    link: &mut Link,
    url: &str,
    timeout: Duration,
) -> Result<Vec<EndpointDescription>, Fault> {
    let channel = link.channel.clone();
    let request = GetEndpointsRequest {
        request_header: header(&NodeId::null(), channel.request_handle(), timeout),
        endpoint_url: url.into(),
        locale_ids: None,
        profile_uris: None,
    };
    let answer = link.ask(channel.send(request, timeout)).await.map_err(|error| list_fault(&error))?;
    match answer {
        ResponseMessage::GetEndpoints(found) => Ok(found.endpoints.unwrap_or_default()),
        other => Err(list_fault(&refused(&other))),
    }
}

pub(super) fn header(token: &NodeId, handle: u32, timeout: Duration) -> RequestHeader {
    let timeout_hint = u32::try_from(timeout.as_millis()).unwrap_or(u32::MAX);
    RequestHeader { timeout_hint, ..RequestHeader::new(token, &DateTime::now(), handle) }
}

/// Returns the error for a message that is not the expected answer. The error contains the status of the server, if the
/// message has one.
pub(super) fn refused(answer: &ResponseMessage) -> Error {
    let status = match answer {
        ResponseMessage::ServiceFault(fault) => fault.response_header.service_result,
        _ => StatusCode::BadUnknownResponse,
    };
    Error::new(status, "refused")
}

impl Session {
    /// Returns the local state of a session that does not exist at the server yet. `sizes` are the call sizes that
    /// earlier sessions have learned.
    pub(super) fn none(application: String, timeout: Duration, sizes: CallSizes) -> Session {
        Session { application, timeout, held: Arc::default(), sizes }
    }

    /// Returns the maximum number of nodes in one call of each service, as learned from refusals of the server.
    pub(super) fn sizes(&self) -> &CallSizes {
        &self.sizes
    }

    /// Returns whether the session exists at the server, as far as the gateway knows.
    pub(super) fn is_alive(&self) -> bool {
        self.held().is_some()
    }

    /// Records that the session no longer exists at the server.
    pub(super) fn is_over(&self) {
        self.hold(None);
    }

    /// Returns the authentication token, which each request of the session must contain.
    pub(super) fn token(&self) -> NodeId {
        self.held().map_or(NodeId::null(), |held| held.token)
    }

    /// Returns the fault for a call of this session that got no usable answer. Records the end of the session.
    pub(super) fn failed(&self, error: &Error) -> Fault {
        if is_of_the_session(error) {
            self.is_over();
        }
        call_fault(error)
    }

    /// Processes the error of a Read call of `count` nodes. If the call was too large, the next call gets half of the
    /// nodes, and the result is `None`. For a single node that is too large, the result is a value with the status of
    /// the server.
    ///
    /// # Errors
    /// The call has failed for another reason, or the connection is closed. BadTooManyOperations for a single node
    /// counts as another reason.
    pub(super) fn smaller(&self, count: usize, error: &Error) -> Result<Option<DataValue>, Fault> {
        let Some(refusal) = size_refusal(error) else { return Err(self.failed(error)) };
        let is_smaller = self.sizes.halve(Service::Read, count);
        match refusal {
            SizeRefusal::Closed => Err(Fault::BROKEN),
            SizeRefusal::Answered(_) if is_smaller => Ok(None),
            SizeRefusal::Answered(StatusCode::BadTooManyOperations) => {
                self.sizes.forget(Service::Read);
                Err(self.failed(error))
            }
            SizeRefusal::Answered(status) => Ok(Some(without_value(status))),
        }
    }

    /// Returns the longest time that the library waits for an answer in this session.
    pub(super) fn patience(&self) -> Duration {
        patience(self.timeout)
    }

    fn held(&self) -> Option<ServerSession> {
        self.lock().clone()
    }

    fn hold(&self, held: Option<ServerSession>) {
        *self.lock() = held;
    }

    fn lock(&self) -> MutexGuard<'_, Option<ServerSession>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Resumes the session on a new channel, and logs in again.
    pub(super) async fn take_up(&self, link: &mut Link, login: Login<'_>) -> Result<(), Error> {
        let held = self.held().ok_or_else(|| Error::new(StatusCode::BadSessionClosed, "there is none"))?;
        self.activate(link, login, held).await
    }

    /// Creates the session at the server and logs in the user. If the login fails, closes the session, because it would
    /// otherwise occupy the server until its lifetime ends.
    pub(super) async fn begin(&self, link: &mut Link, login: Login<'_>) -> Result<(), Fault> {
        let nonce = random::byte_string(NONCE);
        let made = self.create(link, login, &nonce).await?;
        let token = made.authentication_token.clone();
        let begun = match proven(&made, &nonce, login) {
            Ok(()) => {
                let held = ServerSession {
                    token: token.clone(),
                    nonce: made.server_nonce,
                    subscriptions: Vec::new(),
                    namespaces: Namespaces::default(),
                };
                self.activate(link, login, held).await.map_err(|error| dial_fault(&error))
            }
            Err(why) => Err(fault(why)),
        };
        if begun.is_err() {
            let _ = tokio::time::timeout(CLOSING, self.close_with(link, token)).await;
        }
        begun
    }

    async fn create(
        &self,
        link: &mut Link,
        login: Login<'_>,
        nonce: &ByteString,
    ) -> Result<CreateSessionResponse, Fault> {
        let Login { endpoint, own, .. } = login;
        let channel = link.channel.clone();
        let request = CreateSessionRequest {
            request_header: header(&NodeId::null(), channel.request_handle(), OPENING),
            client_description: ApplicationDescription {
                application_uri: self.application.as_str().into(),
                product_uri: "urn:isotherm".into(),
                application_name: "isotherm".into(),
                application_type: ApplicationType::Client,
                ..Default::default()
            },
            server_uri: Default::default(),
            endpoint_url: endpoint.endpoint_url.clone(),
            session_name: "isotherm".into(),
            client_nonce: nonce.clone(),
            client_certificate: own.map_or_else(ByteString::null, |(cert, _)| cert.as_byte_string()),
            requested_session_timeout: LIFETIME,
            max_response_message_size: 0,
        };
        let answer = link.ask(channel.send(request, OPENING)).await.map_err(|error| dial_fault(&error))?;
        let ResponseMessage::CreateSession(made) = answer else { return Err(dial_fault(&refused(&answer))) };
        if made.response_header.service_result.is_bad() {
            return Err(dial_fault(&Error::new(made.response_header.service_result, "refused")));
        }
        Ok(*made)
    }

    async fn activate(&self, link: &mut Link, login: Login<'_>, held: ServerSession) -> Result<(), Error> {
        let Login { endpoint, own, user } = login;
        let channel = link.channel.clone();
        channel.set_auth_token(held.token.clone());
        // A new channel has a nonce of its own, which no signature here uses.
        link.set_nonce(&held.nonce)?;
        let (token, handle) = (held.token.clone(), channel.request_handle());
        let request = ActivateSession::new_manual(endpoint.clone(), 0, OPENING, token, handle)
            .identity_token(user.clone());
        let request = match own {
            Some((_, key)) => request.private_key(key.clone()),
            None => request,
        };
        let answer = link.ask(request.send(&channel)).await?;
        self.hold(Some(ServerSession { nonce: answer.server_nonce.clone(), ..held }));
        Ok(())
    }

    /// Closes the session at the server, together with its subscriptions.
    pub(super) async fn close(&self, link: &mut Link) {
        self.close_with(link, self.token()).await;
        self.is_over();
    }

    /// Closes the session at the server as [`Session::close`] does, if the server answers within a second.
    pub(super) async fn give_up(&self, link: &mut Link) {
        let _ = tokio::time::timeout(CLOSING, self.close(link)).await;
        self.is_over();
    }

    async fn close_with(&self, link: &mut Link, token: NodeId) {
        let channel = link.channel.clone();
        let close = CloseSession::new_manual(0, self.patience(), token, channel.request_handle());
        // Without an answer, the server ends the session after its lifetime.
        let _ = link.ask(close.send(&channel)).await;
    }

    /// Reads how many nodes the server accepts in one call. A limit that the server does not state is `usize::MAX`.
    pub(super) async fn limits(&self, link: &mut Link) -> Result<Limits, Error> {
        let read = VariableId::Server_ServerCapabilities_OperationLimits_MaxNodesPerRead;
        let write = VariableId::Server_ServerCapabilities_OperationLimits_MaxNodesPerWrite;
        // Read one at a time: two nodes may exceed the limit.
        let read = self.most(link, read).await?;
        let write = self.most(link, write).await?;
        Ok(Limits { read, write })
    }

    /// Reads one operation limit of the server; `usize::MAX` if the server has no such limit.
    pub(super) async fn most(&self, link: &mut Link, limit: VariableId) -> Result<usize, Error> {
        let most = match self.value(link, limit).await? {
            Some(Variant::UInt32(most)) if most > 0 => usize::try_from(most).ok(),
            _ => None,
        };
        Ok(most.unwrap_or(usize::MAX))
    }

    /// Reads the namespaces of the server, and stores them in `table`.
    pub(super) async fn read_namespaces(&self, link: &mut Link, table: &NamespaceTable) -> Result<(), Error> {
        let array = self.value(link, VariableId::Server_NamespaceArray).await;
        let namespaces = Namespaces::of(array?.as_ref(), table);
        if let Some(held) = self.lock().as_mut() {
            held.namespaces = namespaces;
        }
        Ok(())
    }

    /// Returns the namespaces that the server had when the connection was opened.
    pub(super) fn namespaces(&self) -> Namespaces {
        self.lock().as_ref().map_or_else(Namespaces::default, |held| held.namespaces.clone())
    }

    /// Reads the value of a variable that OPC UA defines for every server; `None` if the server has no value for this
    /// variable.
    async fn value(&self, link: &mut Link, variable: VariableId) -> Result<Option<Variant>, Error> {
        let channel = link.channel.clone();
        let read = Read::new_manual(0, OPENING, self.token(), channel.request_handle())
            .timestamps_to_return(TimestampsToReturn::Neither)
            .node(value_of(variable.into()));
        let found = link.ask(read.send(&channel)).await?.results.unwrap_or_default();
        Ok(found.into_iter().next().and_then(|found| found.value))
    }

    /// Records the number of a new subscription of this session.
    pub(super) fn subscribes(&self, id: u32) {
        if let Some(held) = self.lock().as_mut() {
            held.subscriptions.push(id);
        }
    }

    /// Returns the subscriptions of the session, including those made on earlier connections.
    pub(super) fn subscriptions(&self) -> Vec<u32> {
        self.held().map_or_else(Vec::new, |held| held.subscriptions)
    }

    /// Records that the subscriptions with these numbers were deleted.
    pub(super) fn forgets(&self, ids: &[u32]) {
        if let Some(held) = self.lock().as_mut() {
            held.subscriptions.retain(|id| !ids.contains(id));
        }
    }
}

/// Checks that the server of a secured session uses the trusted certificate and has the key of this certificate. Also
/// checks that the signed list of endpoints leads to the same choice of security.
fn proven(made: &CreateSessionResponse, nonce: &ByteString, login: Login<'_>) -> Result<(), OpcUaFault> {
    let Login { endpoint, own, user } = login;
    let Some((cert, _)) = own else { return Ok(()) };
    // The certificates of the authorities may follow the server's own.
    if leaf(made.server_certificate.as_ref()) != Some(endpoint.server_certificate.as_ref()) {
        return Err(OpcUaFault::NotProven);
    }
    let not_proven = |_| OpcUaFault::NotProven;
    let server = X509::from_byte_string(&endpoint.server_certificate).map_err(not_proven)?;
    let policy = SecurityPolicy::from_uri(endpoint.security_policy_uri.as_ref());
    verify_signature_data(&made.server_signature, policy, &server, cert, nonce.as_ref())
        .map_err(not_proven)?;
    let signed = made.server_endpoints.clone().unwrap_or_default();
    match security_of(endpoint) {
        Some(security) if is_confirmed(endpoint, signed, security, user) => Ok(()),
        _ => Err(OpcUaFault::Weakened),
    }
}

/// Returns the values in the answer to a Read call of `count` nodes, and the time of the answer by the server's clock.
///
/// # Errors
/// The answer has another number of values.
pub(super) fn answered(answer: ReadResponse, count: usize) -> Result<(Vec<DataValue>, DateTime), Fault> {
    let values = answer.results.unwrap_or_default();
    match values.len() == count {
        true => Ok((values, answer.response_header.timestamp)),
        false => Err(Fault::Peer(PeerFault::Length)),
    }
}

/// Returns the item of a Read call that reads the value of this node.
pub(super) fn value_of(node_id: NodeId) -> ReadValueId {
    ReadValueId {
        node_id,
        attribute_id: AttributeId::Value as u32,
        index_range: Default::default(),
        data_encoding: Default::default(),
    }
}

//! Conversion of errors of the library and of status codes of the server to faults.

use ::opcua::types::{Error, StatusCode};
use isotherm_core::reading::Status;

use super::call_size::{SizeRefusal, size_refusal};
use super::chunks::Reply;
use crate::fieldbus::error::{Fault, LinkFault, Outcome, PeerFault};
use crate::fieldbus::kinds::opcua::fault::OpcUaFault;
use crate::fieldbus::wire::Answer;

/// Returns the fault for an error that occurred while a session was opened.
pub(super) fn dial_fault(error: &Error) -> Fault {
    use OpcUaFault as Why;
    let why = match error.status() {
        StatusCode::BadTooManySessions => Why::NoSession,
        status if is_busy(status) => Why::NoChannel,
        StatusCode::BadIdentityTokenInvalid
        | StatusCode::BadIdentityTokenRejected
        | StatusCode::BadUserAccessDenied
        | StatusCode::BadUserSignatureInvalid => Why::UserRefused,
        StatusCode::BadCertificateTimeInvalid => Why::OursExpired,
        StatusCode::BadCertificateUntrusted
        | StatusCode::BadCertificateInvalid
        | StatusCode::BadCertificateUriInvalid
        | StatusCode::BadCertificateUseNotAllowed
        | StatusCode::BadCertificateHostNameInvalid
        | StatusCode::BadCertificateIssuerUseNotAllowed
        | StatusCode::BadCertificateIssuerTimeInvalid
        | StatusCode::BadCertificateIssuerRevoked
        | StatusCode::BadCertificateIssuerRevocationUnknown
        | StatusCode::BadCertificatePolicyCheckFailed
        | StatusCode::BadCertificateRevocationUnknown
        | StatusCode::BadCertificateRevoked
        | StatusCode::BadNoValidCertificates
        | StatusCode::BadCertificateChainIncomplete
        | StatusCode::BadSecurityChecksFailed => Why::OursRefused,
        StatusCode::BadSecurityModeRejected | StatusCode::BadSecurityPolicyRejected => Why::NoEndpoint,
        StatusCode::BadInvalidTimestamp => Why::Clock,
        StatusCode::BadApplicationSignatureInvalid => Why::NotProven,
        _ if is_not_understood(error) => return Fault::Peer(PeerFault::Malformed),
        status => Why::Refused(Status(status.bits())),
    };
    Fault::Link(LinkFault::OpcUa(why))
}

/// Returns whether the server reports that all its connections or channels are in use.
fn is_busy(status: StatusCode) -> bool {
    matches!(
        status,
        StatusCode::BadTcpServerTooBusy
            | StatusCode::BadTcpNotEnoughResources
            | StatusCode::BadMaxConnectionsReached
            | StatusCode::BadServerTooBusy
    )
}

/// Returns the fault for an error that occurred while the endpoints of a server were queried, on a channel without
/// security.
pub(super) fn list_fault(error: &Error) -> Fault {
    let why = match error.status() {
        StatusCode::BadSecurityPolicyRejected
        | StatusCode::BadSecurityModeRejected
        | StatusCode::BadSecurityModeInsufficient
        | StatusCode::BadSecurityChecksFailed => OpcUaFault::NoList,
        status if is_busy(status) => OpcUaFault::NoChannel,
        _ if is_not_understood(error) => return Fault::Peer(PeerFault::Malformed),
        status => OpcUaFault::Refused(Status(status.bits())),
    };
    Fault::Link(LinkFault::OpcUa(why))
}

/// Purpose of a channel. The fault for an error depends on the purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Query of the list of endpoints, without security.
    List,
    /// Requests of a session at an endpoint.
    Session,
}

/// Returns the fault for an error that occurred while a channel was opened. `reply` is the first reply of the server on
/// this connection.
pub(super) fn opening_fault(purpose: Purpose, reply: Reply, error: &Error) -> Fault {
    let of_status = |error: &Error| match purpose {
        Purpose::List => list_fault(error),
        Purpose::Session => dial_fault(error),
    };
    let is_closed = is_of_the_connection(error.status());
    let why = match reply {
        Reply::Foreign => OpcUaFault::NoServer,
        Reply::NotSigned => OpcUaFault::NotProven,
        Reply::Error(status) => return of_status(&Error::new(status, "said by the server")),
        Reply::None if is_closed => OpcUaFault::NoAnswer,
        Reply::Acknowledged if is_closed => OpcUaFault::NotOpened,
        Reply::None | Reply::Acknowledged if is_not_understood(error) => OpcUaFault::NoServer,
        Reply::None | Reply::Acknowledged => return of_status(error),
    };
    Fault::Link(LinkFault::OpcUa(why))
}

/// Returns whether the error means that the connection has ended, and the server has given no reason.
fn is_of_the_connection(status: StatusCode) -> bool {
    matches!(
        status,
        StatusCode::BadSecureChannelIdInvalid
            | StatusCode::BadSecureChannelClosed
            | StatusCode::BadConnectionClosed
            | StatusCode::BadNotConnected
            | StatusCode::BadCommunicationError
            | StatusCode::BadTcpMessageTooLarge
    )
}

/// Returns whether the error means that the message violates the protocol.
fn is_not_understood(error: &Error) -> bool {
    matches!(
        error.status(),
        StatusCode::BadDecodingError
            | StatusCode::BadUnknownResponse
            | StatusCode::BadSequenceNumberInvalid
            | StatusCode::BadTcpMessageTypeInvalid
    )
}

/// Returns whether the error means that the session or its channel has ended.
pub(super) fn is_of_the_session(error: &Error) -> bool {
    matches!(
        error.status(),
        StatusCode::BadSessionIdInvalid | StatusCode::BadSessionClosed | StatusCode::BadSessionNotActivated
    )
}

/// Returns the fault for a call that got no usable answer.
pub(super) fn call_fault(error: &Error) -> Fault {
    if let Some(SizeRefusal::Answered(status)) = size_refusal(error) {
        return Fault::Status(Status(status.bits()));
    }
    match error.status() {
        _ if is_of_the_session(error) => Fault::BROKEN,
        status if is_of_the_connection(status) => Fault::BROKEN,
        StatusCode::BadServerHalted | StatusCode::BadShutdown => Fault::BROKEN,
        StatusCode::BadTimeout => Fault::Timeout,
        _ if is_not_understood(error) => Fault::Peer(PeerFault::Malformed),
        // Within a session the certificates were accepted, so this message was changed on the way.
        StatusCode::BadSecurityChecksFailed => Fault::Peer(PeerFault::Malformed),
        status => Fault::Status(Status(status.bits())),
    }
}

/// Returns the result of a call that wrote several nodes, from the status of each node. The result is `Done` if every
/// node was written. [`Outcome::NotDone`] requires that every status proves that its node was not written.
pub(super) fn all_written(said: &[Status]) -> Result<Answer, Fault> {
    let mut refused = said.iter().zip(1..).filter(|(status, _)| !status.is_good());
    let Some((&status, place)) = refused.clone().next() else { return Ok(Answer::Done) };
    if said.iter().any(|status| status.is_good()) {
        return Err(Fault::Part { status, place });
    }
    let unknown = refused.find_map(|(status, _)| {
        let fault = Fault::Status(*status);
        (fault.outcome() == Outcome::Unknown).then_some(fault)
    });
    Err(unknown.unwrap_or(Fault::Status(status)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_status_has_the_name_that_the_library_has_for_it() {
        let known = (0..=0xffff).map(|code| Status(code << 16)).filter(|status| status.name().is_some());
        let known: Vec<_> = known.collect();
        assert!(known.len() > 90, "{}", known.len());
        for status in known {
            assert_eq!(status.to_string(), StatusCode::from(status.0).to_string(), "{:08X}", status.0);
        }
        assert_eq!(Status(StatusCode::BadNoSubscription.bits()).to_string(), "BadNoSubscription");
    }

    #[test]
    fn a_channel_that_is_not_opened_has_the_reason_of_the_server_as_its_fault() {
        use OpcUaFault as Why;
        use Purpose::{List, Session};
        use StatusCode as Code;
        let closed = Code::BadConnectionClosed;
        let refused = |status: StatusCode| Why::Refused(Status(status.bits()));
        let cases = [
            // After an error message of the server, the error of the library is always "closed".
            (List, Reply::Error(Code::BadSecurityPolicyRejected), closed, Why::NoList),
            (List, Reply::Error(Code::BadTcpNotEnoughResources), closed, Why::NoChannel),
            (List, Reply::Error(Code::BadTcpServerTooBusy), closed, Why::NoChannel),
            (
                List,
                Reply::Error(Code::BadTcpEndpointUrlInvalid),
                closed,
                refused(Code::BadTcpEndpointUrlInvalid),
            ),
            (List, Reply::Acknowledged, Code::BadSecurityPolicyRejected, Why::NoList),
            (List, Reply::Acknowledged, Code::BadMaxConnectionsReached, Why::NoChannel),
            (List, Reply::Acknowledged, Code::BadSecurityChecksFailed, Why::NoList),
            (List, Reply::Acknowledged, closed, Why::NotOpened),
            (List, Reply::Acknowledged, Code::BadCommunicationError, Why::NotOpened),
            (List, Reply::Acknowledged, Code::BadDecodingError, Why::NoServer),
            (List, Reply::None, closed, Why::NoAnswer),
            (List, Reply::Foreign, closed, Why::NoServer),
            (Session, Reply::Error(Code::BadSecurityPolicyRejected), closed, Why::NoEndpoint),
            (Session, Reply::Error(Code::BadSecurityChecksFailed), closed, Why::OursRefused),
            (Session, Reply::Error(Code::BadCertificateUntrusted), closed, Why::OursRefused),
            (Session, Reply::Error(Code::BadTcpNotEnoughResources), closed, Why::NoChannel),
            (Session, Reply::Acknowledged, Code::BadServerTooBusy, Why::NoChannel),
            (Session, Reply::Acknowledged, closed, Why::NotOpened),
            (Session, Reply::NotSigned, closed, Why::NotProven),
        ];
        for (purpose, reply, status, why) in cases {
            let found = opening_fault(purpose, reply, &Error::new(status, "said"));
            assert_eq!(found, Fault::Link(LinkFault::OpcUa(why)), "{purpose:?} {reply:?} {status}");
        }
    }

    #[test]
    fn a_call_that_is_too_large_is_a_refusal_and_a_closed_connection_is_broken() {
        let call = |status| call_fault(&Error::new(status, "said"));
        for status in [
            StatusCode::BadTooManyOperations,
            StatusCode::BadRequestTooLarge,
            StatusCode::BadResponseTooLarge,
            StatusCode::BadEncodingLimitsExceeded,
        ] {
            assert_eq!(call(status), Fault::Status(Status(status.bits())));
        }
        assert_eq!(call(StatusCode::BadTcpMessageTooLarge), Fault::BROKEN);
        assert_eq!(call(StatusCode::BadCommunicationError), Fault::BROKEN);
        let unsent = Error::new(StatusCode::BadCommunicationError, "said").with_context(Some(1), Some(2));
        assert_eq!(call_fault(&unsent), Fault::Status(Status::REQUEST_TOO_LARGE));
    }

    #[test]
    fn a_set_is_done_where_all_of_it_is_and_not_done_where_each_of_it_is_refused() {
        const GOOD: Status = Status(0);
        const FAILED: Status = Status(0x808b_0000);
        let (denied, typed) = (Status::ACCESS_DENIED, Status::TYPE_MISMATCH);
        let part = |status, place| Err(Fault::Part { status, place });
        let cases: [(&[Status], Result<Answer, Fault>, Outcome); 6] = [
            (&[denied, typed], Err(Fault::Status(denied)), Outcome::NotDone),
            (&[GOOD, denied], part(denied, 2), Outcome::Unknown),
            (&[denied, GOOD, typed], part(denied, 1), Outcome::Unknown),
            (&[GOOD, FAILED], part(FAILED, 2), Outcome::Unknown),
            (&[denied, FAILED], Err(Fault::Status(FAILED)), Outcome::Unknown),
            (&[FAILED], Err(Fault::Status(FAILED)), Outcome::Unknown),
        ];
        for (said, expected, outcome) in cases {
            let found = all_written(said);
            assert_eq!(
                (&found, found.clone().map_err(Fault::outcome)),
                (&expected, Err(outcome)),
                "{said:?}"
            );
        }
        assert_eq!(all_written(&[GOOD, GOOD]), Ok(Answer::Done));
    }
}

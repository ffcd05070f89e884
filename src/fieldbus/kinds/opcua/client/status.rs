//! Conversion of errors of the library and of status codes of the server to faults.

use ::opcua::types::{Error, StatusCode};
use isotherm_core::reading::Status;

use crate::fieldbus::error::{Fault, LinkFault, Outcome, PeerFault};
use crate::fieldbus::kinds::opcua::fault::OpcUaFault;
use crate::fieldbus::wire::Answer;

/// Returns the fault for an error that occurred while a session was opened.
pub(super) fn dial_fault(error: &Error) -> Fault {
    use OpcUaFault as Why;
    let why = match error.status() {
        StatusCode::BadTooManySessions
        | StatusCode::BadTcpServerTooBusy
        | StatusCode::BadTcpNotEnoughResources => Why::NoSession,
        StatusCode::BadIdentityTokenInvalid
        | StatusCode::BadIdentityTokenRejected
        | StatusCode::BadUserAccessDenied
        | StatusCode::BadUserSignatureInvalid => Why::UserRefused,
        StatusCode::BadCertificateTimeInvalid => Why::OursExpired,
        StatusCode::BadCertificateUntrusted
        | StatusCode::BadCertificateInvalid
        | StatusCode::BadCertificateUriInvalid
        | StatusCode::BadCertificateUseNotAllowed
        | StatusCode::BadCertificateIssuerUseNotAllowed
        | StatusCode::BadCertificateRevoked
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

/// Returns whether the error means that the message violates the protocol.
fn is_not_understood(error: &Error) -> bool {
    matches!(
        error.status(),
        StatusCode::BadDecodingError
            | StatusCode::BadUnknownResponse
            | StatusCode::BadSequenceNumberInvalid
            | StatusCode::BadTcpMessageTypeInvalid
            | StatusCode::BadResponseTooLarge
            | StatusCode::BadEncodingLimitsExceeded
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
    match error.status() {
        _ if is_of_the_session(error) => Fault::BROKEN,
        StatusCode::BadSecureChannelIdInvalid
        | StatusCode::BadSecureChannelClosed
        | StatusCode::BadConnectionClosed
        | StatusCode::BadNotConnected
        | StatusCode::BadCommunicationError
        | StatusCode::BadServerHalted
        | StatusCode::BadShutdown => Fault::BROKEN,
        StatusCode::BadTimeout => Fault::Timeout,
        _ if is_not_understood(error) => Fault::Peer(PeerFault::Malformed),
        // Within a session the certificates were accepted, so this message was changed on the way.
        StatusCode::BadSecurityChecksFailed => Fault::Peer(PeerFault::Malformed),
        status => Fault::Status(Status(status.bits())),
    }
}

/// Returns the result of a call that wrote several nodes, from the status of each. The result is `Done` if every node
/// was written. [`Outcome::NotDone`] requires that every status proves that its node was not written.
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

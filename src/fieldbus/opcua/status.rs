//! What the library and the server say, as faults of ours.

use ::opcua::types::{Error, StatusCode};
use isotherm_core::reading::Status;

use crate::fieldbus::error::{Fault, LinkFault, PeerFault};
use crate::fieldbus::opcua_fault::OpcUaFault;

/// Why no session came about.
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
        status => Why::Refused(Status(status.bits())),
    };
    Fault::Link(LinkFault::OpcUa(why))
}

/// The session is over, or its channel.
pub(super) fn is_of_the_session(error: &Error) -> bool {
    matches!(
        error.status(),
        StatusCode::BadSessionIdInvalid | StatusCode::BadSessionClosed | StatusCode::BadSessionNotActivated
    )
}

/// Why a call has no answer that could be used.
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
        StatusCode::BadDecodingError
        | StatusCode::BadUnknownResponse
        | StatusCode::BadSequenceNumberInvalid
        | StatusCode::BadTcpMessageTypeInvalid
        | StatusCode::BadResponseTooLarge
        | StatusCode::BadEncodingLimitsExceeded => Fault::Peer(PeerFault::Malformed),
        status => Fault::Status(Status(status.bits())),
    }
}

//! Status codes of OPC UA, with their names.

use std::fmt;

/// Status code of OPC UA. Its two highest bits give the severity: good, uncertain or bad.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Status(pub u32);

/// Status codes that clients receive when they read, write or subscribe, with their names. The numbers are those in
/// Part 6 of the specification.
const NAMES: [(u32, &str); 116] = [
    (0x0000, "Good"),
    (0x002f, "GoodOverload"),
    (0x0030, "GoodClamped"),
    (0x0096, "GoodLocalOverride"),
    (0x4000, "Uncertain"),
    (0x408f, "UncertainNoCommunicationLastUsableValue"),
    (0x4090, "UncertainLastUsableValue"),
    (0x4091, "UncertainSubstituteValue"),
    (0x4092, "UncertainInitialValue"),
    (0x4093, "UncertainSensorNotAccurate"),
    (0x4094, "UncertainEngineeringUnitsExceeded"),
    (0x4095, "UncertainSubNormal"),
    (0x8000, "Bad"),
    (0x8001, "BadUnexpectedError"),
    (0x8002, "BadInternalError"),
    (0x8003, "BadOutOfMemory"),
    (0x8004, "BadResourceUnavailable"),
    (0x8005, "BadCommunicationError"),
    (0x8006, "BadEncodingError"),
    (0x8007, "BadDecodingError"),
    (0x8008, "BadEncodingLimitsExceeded"),
    (0x800a, "BadTimeout"),
    (0x800b, "BadServiceUnsupported"),
    (0x800c, "BadShutdown"),
    (0x800e, "BadServerHalted"),
    (0x800f, "BadNothingToDo"),
    (0x8010, "BadTooManyOperations"),
    (0x8012, "BadCertificateInvalid"),
    (0x8013, "BadSecurityChecksFailed"),
    (0x8014, "BadCertificateTimeInvalid"),
    (0x8015, "BadCertificateIssuerTimeInvalid"),
    (0x8016, "BadCertificateHostNameInvalid"),
    (0x8017, "BadCertificateUriInvalid"),
    (0x8018, "BadCertificateUseNotAllowed"),
    (0x8019, "BadCertificateIssuerUseNotAllowed"),
    (0x801a, "BadCertificateUntrusted"),
    (0x801b, "BadCertificateRevocationUnknown"),
    (0x801c, "BadCertificateIssuerRevocationUnknown"),
    (0x801d, "BadCertificateRevoked"),
    (0x801e, "BadCertificateIssuerRevoked"),
    (0x801f, "BadUserAccessDenied"),
    (0x8020, "BadIdentityTokenInvalid"),
    (0x8021, "BadIdentityTokenRejected"),
    (0x8022, "BadSecureChannelIdInvalid"),
    (0x8023, "BadInvalidTimestamp"),
    (0x8024, "BadNonceInvalid"),
    (0x8025, "BadSessionIdInvalid"),
    (0x8026, "BadSessionClosed"),
    (0x8027, "BadSessionNotActivated"),
    (0x8028, "BadSubscriptionIdInvalid"),
    (0x802b, "BadTimestampsToReturnInvalid"),
    (0x8031, "BadNoCommunication"),
    (0x8032, "BadWaitingForInitialData"),
    (0x8033, "BadNodeIdInvalid"),
    (0x8034, "BadNodeIdUnknown"),
    (0x8035, "BadAttributeIdInvalid"),
    (0x8036, "BadIndexRangeInvalid"),
    (0x8037, "BadIndexRangeNoData"),
    (0x8038, "BadDataEncodingInvalid"),
    (0x8039, "BadDataEncodingUnsupported"),
    (0x803a, "BadNotReadable"),
    (0x803b, "BadNotWritable"),
    (0x803c, "BadOutOfRange"),
    (0x803d, "BadNotSupported"),
    (0x803e, "BadNotFound"),
    (0x8040, "BadNotImplemented"),
    (0x8041, "BadMonitoringModeInvalid"),
    (0x8042, "BadMonitoredItemIdInvalid"),
    (0x8043, "BadMonitoredItemFilterInvalid"),
    (0x8044, "BadMonitoredItemFilterUnsupported"),
    (0x8045, "BadFilterNotAllowed"),
    (0x804a, "BadContinuationPointInvalid"),
    (0x804b, "BadNoContinuationPoints"),
    (0x8054, "BadSecurityModeRejected"),
    (0x8055, "BadSecurityPolicyRejected"),
    (0x8056, "BadTooManySessions"),
    (0x8057, "BadUserSignatureInvalid"),
    (0x8058, "BadApplicationSignatureInvalid"),
    (0x8059, "BadNoValidCertificates"),
    (0x8073, "BadWriteNotSupported"),
    (0x8074, "BadTypeMismatch"),
    (0x8077, "BadTooManySubscriptions"),
    (0x8078, "BadTooManyPublishRequests"),
    (0x8079, "BadNoSubscription"),
    (0x807a, "BadSequenceNumberUnknown"),
    (0x807b, "BadMessageNotAvailable"),
    (0x807d, "BadTcpServerTooBusy"),
    (0x807e, "BadTcpMessageTypeInvalid"),
    (0x807f, "BadTcpSecureChannelUnknown"),
    (0x8080, "BadTcpMessageTooLarge"),
    (0x8081, "BadTcpNotEnoughResources"),
    (0x8082, "BadTcpInternalError"),
    (0x8083, "BadTcpEndpointUrlInvalid"),
    (0x8085, "BadRequestTimeout"),
    (0x8086, "BadSecureChannelClosed"),
    (0x8087, "BadSecureChannelTokenUnknown"),
    (0x8088, "BadSequenceNumberInvalid"),
    (0x8089, "BadConfigurationError"),
    (0x808a, "BadNotConnected"),
    (0x808b, "BadDeviceFailure"),
    (0x808c, "BadSensorFailure"),
    (0x808d, "BadOutOfService"),
    (0x809d, "BadDataLost"),
    (0x80ae, "BadConnectionClosed"),
    (0x80af, "BadInvalidState"),
    (0x80b7, "BadMaxConnectionsReached"),
    (0x80b8, "BadRequestTooLarge"),
    (0x80b9, "BadResponseTooLarge"),
    (0x80db, "BadTooManyMonitoredItems"),
    (0x80e4, "BadRequestNotAllowed"),
    (0x80e6, "BadSecurityModeInsufficient"),
    (0x80e9, "BadLocked"),
    (0x80ee, "BadServerTooBusy"),
    (0x810d, "BadCertificateChainIncomplete"),
    (0x8110, "BadLicenseNotAvailable"),
    (0x8114, "BadCertificatePolicyCheckFailed"),
];

impl Status {
    /// Good: the value may be used, or the write was executed.
    pub const GOOD: Status = Status(0);
    /// BadEncodingLimitsExceeded: the message is too large for the server.
    pub const ENCODING_LIMITS: Status = Status(0x8008_0000);
    /// BadTooManyOperations: the call has more nodes than the server accepts.
    pub const TOO_MANY_OPERATIONS: Status = Status(0x8010_0000);
    /// BadUserAccessDenied: the user may not read or write this node.
    pub const ACCESS_DENIED: Status = Status(0x801f_0000);
    /// BadNodeIdUnknown: the server does not have this node.
    pub const NO_SUCH_NODE: Status = Status(0x8034_0000);
    /// BadNotWritable: the node cannot be written.
    pub const NOT_WRITABLE: Status = Status(0x803b_0000);
    /// BadOutOfRange: the node does not accept this value.
    pub const OUT_OF_RANGE: Status = Status(0x803c_0000);
    /// BadWriteNotSupported: the server does not support such a write.
    pub const WRITE_NOT_SUPPORTED: Status = Status(0x8073_0000);
    /// BadTypeMismatch: the node has another type than the value.
    pub const TYPE_MISMATCH: Status = Status(0x8074_0000);
    /// BadTcpEndpointUrlInvalid: the server does not know the address at which it was called.
    pub const URL_INVALID: Status = Status(0x8083_0000);
    /// BadSensorFailure: the sensor that gives the value of the node has failed.
    pub const SENSOR_FAILURE: Status = Status(0x808c_0000);
    /// BadRequestTooLarge: the request has more bytes than the server accepts.
    pub const REQUEST_TOO_LARGE: Status = Status(0x80b8_0000);
    /// BadResponseTooLarge: the answer would have more bytes than the server can send.
    pub const RESPONSE_TOO_LARGE: Status = Status(0x80b9_0000);

    /// Returns whether a value with this status may be used.
    pub const fn is_good(self) -> bool {
        self.0 >> 30 == 0
    }

    /// Returns whether both codes are the same. The lower 16 bits are ignored, because they only add details about the
    /// value.
    pub const fn is(self, other: Status) -> bool {
        self.0 >> 16 == other.0 >> 16
    }

    /// Returns the name of the code; `None` if the code is not in the list of known codes.
    pub fn name(self) -> Option<&'static str> {
        let found = NAMES.iter().find(|(code, _)| *code == self.0 >> 16);
        found.map(|(_, name)| *name)
    }
}

/// Formats the status as its name, for example `BadUserAccessDenied`; as `status 80AB0000h` if the name is unknown.
impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.name() {
            Some(name) => f.write_str(name),
            None => write!(f, "status {:08X}h", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_is_good_uncertain_or_bad_by_its_highest_bits() {
        assert!(Status(0).is_good() && Status(0x0096_0000).is_good());
        assert!(!Status(0x4090_0000).is_good() && !Status(0x8034_0000).is_good());
    }

    #[test]
    fn a_status_has_its_name_whatever_its_lower_half_says() {
        assert_eq!(Status(0x801f_0000).to_string(), "BadUserAccessDenied");
        assert_eq!(Status(0x801f_0480).to_string(), "BadUserAccessDenied");
        assert!(Status(0x801f_0480).is(Status::ACCESS_DENIED));
        assert_eq!(Status(0x8123_0000).to_string(), "status 81230000h");
        assert_eq!(Status(0).to_string(), "Good");
    }
}

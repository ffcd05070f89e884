//! Reasons why there is no session with an OPC UA server.

/// Reason why there is no session. `isotherm check` also reports faults of the profile's own files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum OpcUaFault {
    /// This program was built without OPC UA.
    #[error(
        "this program was built without OPC UA: the packages have it, and `cargo build --release --features opcua` \
         builds it in"
    )]
    NotBuiltIn,
    /// The program at this port does not support OPC UA.
    #[error("whoever listens there does not speak OPC UA: is the port right (usually 4840)?")]
    NoServer,
    /// The server has no endpoint that fits the profile.
    #[error(
        "the server offers no such security with this kind of user: `security` and `user` must be among what it has \
         switched on"
    )]
    NoEndpoint,
    /// The server's certificate is not in the directory of trusted certificates.
    #[error(
        "the server's certificate is not among those in `trusted`: `isotherm opcua trust PROFILE` shows it, and puts it there"
    )]
    NotTrusted,
    /// The server's certificate has expired.
    #[error(
        "the server's certificate has expired, or this computer's clock is wrong: renew it at the server"
    )]
    Expired,
    /// The server's certificate is not valid yet.
    #[error("the server's certificate is not valid yet, or this computer's clock is wrong")]
    NotYetValid,
    /// The server does not prove that it has the key of its certificate.
    #[error("the server does not prove that its certificate is its own: is something between?")]
    NotProven,
    /// The signed list of endpoints is stronger than the one before the login.
    #[error(
        "the server offers stronger security than whoever answered before the login said: is something between?"
    )]
    Weakened,
    /// The gateway's certificate has expired.
    #[error(
        "the gateway's certificate in `cert` has expired: move it and its key away, make a new one (`isotherm opcua \
         certificate PROFILE`), and trust it at the server"
    )]
    OursExpired,
    /// The server rejects the gateway's certificate.
    #[error("the server does not trust the gateway's certificate in `cert`: put it among those it trusts")]
    OursRefused,
    /// The files that the profile names are unusable.
    #[error("the files of this line are of no use: `isotherm check` says why")]
    OurFiles,
    /// The server rejects the user.
    #[error(
        "the server does not let this user in: name, password or certificate are wrong, or it lacks the right"
    )]
    UserRefused,
    /// The server has no session left.
    #[error(
        "the server has no session left: close another client, or wait until a session that was lost has expired there"
    )]
    NoSession,
    /// The clocks differ too much.
    #[error("the server finds this computer's clock wrong, or its own is")]
    Clock,
    /// The server refuses for another reason.
    #[error("the server opens no session: {0}")]
    Refused(isotherm_core::reading::Status),
}

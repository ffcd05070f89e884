//! Reasons why there is no session with an OPC UA server.

/// Reason why there is no session with an OPC UA server. `isotherm check` names the file of the profile that is
/// unusable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum OpcUaFault {
    /// This program was built without OPC UA.
    #[error(
        "this program was built without OPC UA: use a packaged program, or build one with \
         `cargo build --release --features opcua`"
    )]
    NotBuiltIn,
    /// The program at this port does not answer in the OPC UA protocol.
    #[error("the program at this port does not speak OPC UA: is the port right (usually 4840)?")]
    NoServer,
    /// The program at this port closes the connection without an answer.
    #[error(
        "the program at this port closes the connection without an answer: is the port right (usually 4840)? \
         If so, the server may have no channel left: close another client"
    )]
    NoAnswer,
    /// The server has no free connection or channel.
    #[error(
        "the server has no channel left: close another client, or wait until a lost connection has expired at \
         the server"
    )]
    NoChannel,
    /// The server has accepted the connection, and closes it instead of opening a channel.
    #[error(
        "the server closes the connection instead of opening a channel: it has no channel left, or rejects \
         the security. Close another client; the server's own log says why"
    )]
    NotOpened,
    /// The server refuses to list its endpoints on a channel without security.
    #[error(
        "the server refuses to list its endpoints without security: allow this query at the server (often \
         called discovery with the policy None). Sessions without security can stay switched off"
    )]
    NoList,
    /// The server has no endpoint with the `security` and the kind of `user` in the profile.
    #[error(
        "the server offers no endpoint with this `security` and this kind of `user`: write what is switched \
         on at the server"
    )]
    NoEndpoint,
    /// The server's certificate is not in the directory `trusted` of the profile.
    #[error(
        "the server's certificate is not in the directory `trusted`: `isotherm opcua trust PROFILE` shows \
         it, and adds it"
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
    /// The server cannot prove that it has the private key of its certificate.
    #[error(
        "the server does not prove that it has the key of its certificate: does another device answer \
         instead?"
    )]
    NotProven,
    /// The signed list of endpoints, received when the session is created, has a stronger endpoint than the unprotected
    /// list before.
    #[error(
        "the server offers stronger security after the login than before it: does a network device change \
         the messages?"
    )]
    Weakened,
    /// The gateway's certificate has expired.
    #[error(
        "the gateway's certificate in `cert` has expired: move it and its key away, make a new one (`isotherm opcua \
         certificate PROFILE`), and trust it at the server"
    )]
    OursExpired,
    /// The server rejects the gateway's certificate.
    #[error(
        "the server does not trust the gateway's certificate in `cert`: add it to the trusted certificates \
         of the server. A running gateway tries again after 5 minutes, or at once after `isotherm restart \
         PROFILE --keep`"
    )]
    OursRefused,
    /// The files that the profile names are unusable.
    #[error("the files of this line cannot be used: `isotherm check` says why")]
    OurFiles,
    /// The server rejects the user of the line.
    #[error(
        "the server rejects this user: name, password or certificate are wrong, or the user lacks the \
         permission. A running gateway tries again after 5 minutes, or at once after `isotherm restart PROFILE \
         --keep`. Many servers lock a user after a few wrong passwords"
    )]
    UserRefused,
    /// The server has no free session.
    #[error(
        "the server has no session left: close another client, or wait until a lost session has expired at \
         the server"
    )]
    NoSession,
    /// The clocks of the server and of this computer differ too much.
    #[error("the clocks of the server and of this computer differ too much: correct the clock that is wrong")]
    Clock,
    /// The server opens no session for another reason, with this status.
    #[error("the server opens no session: {0}")]
    Refused(isotherm_core::reading::Status),
}

//! Reasons why there is no session with an OPC UA server, and what to do about each.

use isotherm_core::reading::Status;

/// Reason why there is no session with an OPC UA server. The text of `Display` is the cause, without the remedy.
/// `isotherm check` names the file of the profile that is unusable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum OpcUaFault {
    /// This program was built without OPC UA.
    #[error("this program was built without OPC UA")]
    NotBuiltIn,
    /// The program at this port does not answer in the OPC UA protocol.
    #[error("the program at this port does not speak OPC UA")]
    NoServer,
    /// The program at this port closes the connection without an answer.
    #[error("the program at this port closes the connection without an answer")]
    NoAnswer,
    /// The server has no free connection or channel.
    #[error("the server has no free channel")]
    NoChannel,
    /// The server has accepted the connection, and closes it instead of opening a channel.
    #[error(
        "the server closes the connection instead of opening a channel: it has no free channel, or rejects \
         the security"
    )]
    NotOpened,
    /// The server refuses to list its endpoints on a channel without security.
    #[error("the server refuses to list its endpoints without security")]
    NoList,
    /// The server has no endpoint with the `security` and the kind of `user` in the profile.
    #[error("the server offers no endpoint with this `security` and this kind of `user`")]
    NoEndpoint,
    /// The server's certificate is not in the directory `trusted` of the profile.
    #[error("the server's certificate is not in the directory `trusted`")]
    NotTrusted,
    /// The server's certificate has expired.
    #[error("the server's certificate has expired, or this computer's clock is wrong")]
    Expired,
    /// The server's certificate is not valid yet.
    #[error("the server's certificate is not valid yet, or this computer's clock is wrong")]
    NotYetValid,
    /// The server cannot prove that it has the private key of its certificate.
    #[error("the server does not prove that it has the key of its certificate")]
    NotProven,
    /// The signed list of endpoints has a stronger endpoint than the unprotected list, which the gateway received
    /// before the login. An attacker may have changed the unprotected list.
    #[error("the server offers stronger security after the login than before it")]
    Weakened,
    /// The gateway's certificate has expired.
    #[error("the gateway's certificate in `cert` has expired")]
    OursExpired,
    /// The server rejects the gateway's certificate.
    #[error("the server does not trust the gateway's certificate in `cert`")]
    OursRefused,
    /// The files that the profile names are unusable.
    #[error("the files of this line cannot be used")]
    OurFiles,
    /// The server rejects the user of the line.
    #[error(
        "the server rejects this user: name, password or certificate are wrong, or the user lacks the \
         permission"
    )]
    UserRefused,
    /// The server has no free session.
    #[error("the server has no free session")]
    NoSession,
    /// The clocks of the server and of this computer differ too much.
    #[error("the clocks of the server and of this computer differ too much")]
    Clock,
    /// The server opens no session for another reason, with this status.
    #[error("the server did not open a session: {0}")]
    Refused(Status),
}

impl OpcUaFault {
    /// Returns what the user can do about the fault.
    pub const fn hint(self) -> &'static str {
        match self {
            OpcUaFault::NotBuiltIn => {
                "use a packaged program, or build one with `cargo build --release --features opcua`"
            }
            OpcUaFault::NoServer => "is the port right (usually 4840)?",
            OpcUaFault::NoAnswer => {
                "is the port right (usually 4840)? If so, the server may have no free channel: close \
                 another client"
            }
            OpcUaFault::NoChannel => {
                "close another client, or wait until a lost connection has expired at the server"
            }
            OpcUaFault::NotOpened => "close another client; the server's own log says why",
            OpcUaFault::NoList => {
                "allow this query at the server (often called discovery with the policy None). Sessions without \
                 security can stay switched off"
            }
            OpcUaFault::NoEndpoint => {
                "write a `security` and a kind of `user` that are switched on at the server"
            }
            OpcUaFault::NotTrusted => {
                "`isotherm opcua trust PROFILE` shows the certificate, and adds it to the trusted certificates"
            }
            OpcUaFault::Expired => "renew the certificate at the server, or correct the clock",
            OpcUaFault::NotProven => "does another device answer at this address?",
            OpcUaFault::Weakened => "does a network device change the messages?",
            OpcUaFault::OursExpired => {
                "move this certificate and its key away, make a new one (`isotherm opcua certificate PROFILE`), and \
                 trust it at the server"
            }
            OpcUaFault::OursRefused => {
                "add this certificate to the trusted certificates of the server. A running gateway tries again after 5 \
                 minutes, or at once after `isotherm restart PROFILE --keep`"
            }
            OpcUaFault::OurFiles => "`isotherm check` says why",
            OpcUaFault::UserRefused => {
                "correct the `user`, or its permission at the server. A running gateway tries again after 5 minutes, \
                 or at once after `isotherm restart PROFILE --keep`. Many servers lock a user after a few wrong \
                 passwords"
            }
            OpcUaFault::NoSession => {
                "close another client, or wait until a lost session has expired at the server"
            }
            OpcUaFault::NotYetValid | OpcUaFault::Clock => "correct the clock that is wrong",
            OpcUaFault::Refused(status) if status.is(Status::URL_INVALID) => {
                "write the path of the server too, for example /plc in opc.tcp://192.168.0.10:4840/plc. The server's own \
                 display or manual shows the path"
            }
            OpcUaFault::Refused(_) => "the server's own log or display says why",
        }
    }
}

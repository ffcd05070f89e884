//! Why there is no session with an OPC UA server.

/// Why there is no session. The faults of a profile's own files are told by `isotherm check` as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum OpcUaFault {
    /// This program has no OPC UA in it.
    #[error(
        "this program was built without OPC UA: the packages have it, and `cargo build --release --features opcua` \
         builds it in"
    )]
    NotBuiltIn,
    /// Whoever listens there speaks something else.
    #[error("whoever listens there does not speak OPC UA: is the port right (usually 4840)?")]
    NoServer,
    /// It offers no endpoint as the profile wants it.
    #[error(
        "the server offers no such security with this kind of user: `security` and `user` must be among what it has \
         switched on"
    )]
    NoEndpoint,
    /// Its certificate is not in the directory.
    #[error(
        "the server's certificate is not among those in `trusted`: `isotherm opcua trust PROFILE` shows it, and puts it there"
    )]
    NotTrusted,
    /// Its certificate is too old.
    #[error(
        "the server's certificate has expired, or this computer's clock is wrong: renew it at the server"
    )]
    Expired,
    /// Its certificate will be valid later.
    #[error("the server's certificate is not valid yet, or this computer's clock is wrong")]
    NotYetValid,
    /// What it sends in proof of its certificate is none.
    #[error("the server does not prove that its certificate is its own: is something between?")]
    NotProven,
    /// Under its signature it offers more than before the login.
    #[error(
        "the server offers stronger security than whoever answered before the login said: is something between?"
    )]
    Weakened,
    /// The gateway's certificate is too old.
    #[error(
        "the gateway's certificate in `cert` has expired: move it and its key away, make a new one (`isotherm opcua \
         certificate PROFILE`), and trust it at the server"
    )]
    OursExpired,
    /// The gateway's certificate is not taken.
    #[error("the server does not trust the gateway's certificate in `cert`: put it among those it trusts")]
    OursRefused,
    /// The files that the profile names are of no use.
    #[error("the files of this line are of no use: `isotherm check` says why")]
    OurFiles,
    /// The user is not let in.
    #[error(
        "the server does not let this user in: name, password or certificate are wrong, or it lacks the right"
    )]
    UserRefused,
    /// There are as many sessions as there may be.
    #[error(
        "the server has no session left: close another client, or wait until a session that was lost has expired there"
    )]
    NoSession,
    /// The clocks are too far apart.
    #[error("the server finds this computer's clock wrong, or its own is")]
    Clock,
    /// It has said no in another way.
    #[error("the server opens no session: {0}")]
    Refused(isotherm_core::reading::Status),
}

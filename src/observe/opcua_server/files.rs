//! Certificates, keys and users of the server. The caller has read and checked them.

use std::fmt;

/// Certificates, keys and users of the server.
#[derive(Clone, Debug, Default)]
pub struct ServerFiles {
    /// Certificate and private key of the server; `None` if the server has no security.
    pub own: Option<OwnCertificate>,
    /// Application URI of the server. Clients compare it with the URI in the certificate.
    pub application: String,
    /// Certificates of the trusted clients, in DER form.
    pub trusted: Vec<Vec<u8>>,
    /// Users that may log in.
    pub users: Vec<Login>,
}

/// Certificate and private key of the server.
#[derive(Clone)]
pub struct OwnCertificate {
    /// Certificate in DER form.
    pub cert: Vec<u8>,
    /// Private key in PEM form.
    pub key: Vec<u8>,
}

/// User with the secret that the user needs to log in.
#[derive(Clone, Debug)]
pub struct Login {
    /// Name of the user.
    pub name: String,
    /// Secret that the user needs to log in.
    pub secret: Secret,
    /// Whether the user may send measured errors.
    pub takes_measured: bool,
}

/// Secret that a user needs to log in.
#[derive(Clone)]
pub enum Secret {
    /// The user logs in with this password.
    Password(String),
    /// The user logs in with this certificate, which is in DER form.
    Certificate(Vec<u8>),
}

/// Formats the certificate without the private key.
impl fmt::Debug for OwnCertificate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OwnCertificate").finish_non_exhaustive()
    }
}

/// Formats the kind of the secret without its content.
impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Secret::Password(_) => "Password",
            Secret::Certificate(_) => "Certificate",
        })
    }
}

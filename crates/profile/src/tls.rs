//! Modbus/TCP Security: the files by which the two ends of a line know each other.
//!
//! They are read with the profile. What is in them is judged by whoever opens the line, who has TLS; each file
//! knows where in the profile it is named, so that its fault is reported there.

use std::fmt;

use crate::error::ProfileError;

/// The port that the Modbus Organization has for it.
pub const TLS_PORT: u16 = 802;

/// The security of a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Tls {
    /// The certificates that are trusted.
    pub ca: PemFile,
    /// The gateway's certificate.
    pub cert: PemFile,
    /// Its private key.
    pub key: PemFile,
    /// The name that the device's certificate must have.
    pub name: String,
    /// Where that name comes from.
    pub(crate) name_at: ProfileError,
}

/// One of the files.
#[derive(Clone, PartialEq)]
pub struct PemFile {
    /// Its name, as written.
    pub name: String,
    /// What is in it.
    pub bytes: Vec<u8>,
    pub(crate) named_at: ProfileError,
}

impl Tls {
    /// The error that the name can be nobody's.
    pub fn wrong_name(&self) -> ProfileError {
        let message = format!("no certificate can be for the name `{}`", self.name);
        ProfileError { message, ..self.name_at.clone() }
    }
}

impl PemFile {
    /// The error that this is wrong with the file.
    pub fn wrong(&self, why: &str) -> ProfileError {
        ProfileError { message: format!("{}: {why}", self.name), ..self.named_at.clone() }
    }
}

/// Without its content: one of them is a secret.
impl fmt::Debug for PemFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("PemFile").field(&self.name).finish()
    }
}

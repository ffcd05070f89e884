//! Files that a profile names for an OPC UA line: the gateway's certificate, the certificate of its user, and the
//! trusted certificates.

use ::opcua::client::IdentityToken;
use ::opcua::crypto::{PrivateKey, X509};
use x509_cert::Certificate;
use x509_cert::der::Decode;
use x509_cert::ext::pkix::SubjectAltName;
use x509_cert::ext::pkix::name::GeneralName;

use super::chain::leaf;
use crate::clock::Clock;
use crate::fieldbus::kinds::opcua::fault::OpcUaFault;
use isotherm_profile::{NamedFile, OpcUa, ProfileError, User};

/// Last line of a certificate in PEM form.
const END: &[u8] = b"-----END CERTIFICATE-----";
/// Application URI that the gateway reports if it has no certificate.
const APPLICATION: &str = "urn:isotherm:gateway";

/// Parsed certificates, keys and passwords of an OPC UA line.
pub(super) struct Files {
    pub(super) own: Option<(X509, PrivateKey)>,
    pub(super) user: IdentityToken,
    trusted: Vec<Vec<u8>>,
    /// Application URI that the gateway reports. Servers compare this URI with the URI in the certificate.
    pub(super) application: String,
}

/// Returns the mistakes in the files that an OPC UA line names; empty if all files are usable.
pub(in crate::fieldbus) fn wrong(line: &OpcUa) -> Vec<ProfileError> {
    Files::read(line).err().unwrap_or_default()
}

impl Files {
    /// Reads the files that an OPC UA line names.
    ///
    /// # Errors
    /// All mistakes in these files.
    pub(super) fn read(line: &OpcUa) -> Result<Files, Vec<ProfileError>> {
        let mut wrong = Vec::new();
        let own = line.own.as_ref().and_then(|(cert, key)| pair(cert, key, &mut wrong));
        let application = match line.own.as_ref().zip(own.as_ref()) {
            None => APPLICATION.to_owned(),
            Some(((cert, _), (parsed, _))) => application(parsed).unwrap_or_else(|| {
                wrong.push(cert.invalid(
                    "the certificate contains no application URI, which servers check: add the URI to the \
                     subjectAltName of the certificate",
                ));
                String::new()
            }),
        };
        let user = match &line.user {
            User::Anonymous => Some(IdentityToken::Anonymous),
            User::Named { name, password } => match std::str::from_utf8(&password.bytes) {
                Ok(text) => {
                    Some(IdentityToken::new_user_name(name.as_str(), text.trim_end_matches(['\r', '\n'])))
                }
                Err(_) => {
                    wrong.push(password.invalid("the file is not text in UTF-8"));
                    None
                }
            },
            User::Certified { cert, key } => {
                pair(cert, key, &mut wrong).map(|(cert, key)| IdentityToken::new_x509(cert, key))
            }
        };
        let mut trusted = Vec::new();
        for file in &line.trusted {
            match certificate(&file.bytes).and_then(|cert| cert.to_der().ok()) {
                Some(der) => trusted.push(der),
                None => wrong.push(file.invalid("the file is not a certificate in DER or PEM form")),
            }
        }
        match user {
            Some(user) if wrong.is_empty() => Ok(Files { own, user, trusted, application }),
            _ => Err(wrong),
        }
    }

    /// Checks that the gateway's own certificate is valid now.
    pub(super) fn own_is_valid(&self) -> Result<(), OpcUaFault> {
        match &self.own {
            Some((cert, _)) => in_its_time(cert).map_err(|_| OpcUaFault::OursExpired),
            None => Ok(()),
        }
    }

    /// Checks that the server's certificate is trusted, and is valid now.
    pub(super) fn trusts(&self, shown: &[u8]) -> Result<(), OpcUaFault> {
        // The certificates of the server's authorities may follow its own.
        let shown = self.trusted.iter().find(|known| shown.starts_with(known));
        let Some(known) = shown else { return Err(OpcUaFault::NotTrusted) };
        let known = X509::from_der(known).map_err(|_| OpcUaFault::NotTrusted)?;
        in_its_time(&known)
    }
}

fn in_its_time(cert: &X509) -> Result<(), OpcUaFault> {
    let now = i64::try_from(Clock::wall().time_of_day().as_nanos() / 1_000_000_000).unwrap_or(i64::MAX);
    let (from, to) = (cert.not_before(), cert.not_after());
    let (Ok(from), Ok(to)) = (from, to) else { return Err(OpcUaFault::Expired) };
    match now {
        _ if now < from.timestamp() => Err(OpcUaFault::NotYetValid),
        _ if now > to.timestamp() => Err(OpcUaFault::Expired),
        _ => Ok(()),
    }
}

/// Reads a certificate and its private key. If a file has a mistake, adds the mistake to `wrong` and returns `None`.
pub(super) fn pair(
    cert: &NamedFile,
    key: &NamedFile,
    wrong: &mut Vec<ProfileError>,
) -> Option<(X509, PrivateKey)> {
    let parsed = certificate(&cert.bytes);
    if parsed.is_none() {
        wrong.push(cert.invalid("the file is not a certificate in DER or PEM form"));
    }
    let secret = PrivateKey::from_pem(&key.bytes).ok();
    if secret.is_none() {
        wrong.push(key.invalid("the file is not an RSA key in PEM form without a password"));
    }
    let (parsed, secret) = (parsed?, secret?);
    let of_cert = Certificate::from_der(&parsed.to_der().ok()?).ok()?.tbs_certificate.subject_public_key_info;
    if secret.public_key_to_info().ok()? != of_cert {
        wrong.push(key.invalid(&format!("the key does not belong to the certificate {}", cert.name)));
        return None;
    }
    Some((parsed, secret))
}

/// Reads a certificate in DER or PEM form; returns `None` if it is unreadable. The certificates of its authorities may
/// follow in `bytes`.
pub(super) fn certificate(bytes: &[u8]) -> Option<X509> {
    if let Some(own) = leaf(bytes) {
        return X509::from_der(own).ok();
    }
    let end = bytes.windows(END.len()).position(|part| part == END).map_or(bytes.len(), |at| at + END.len());
    X509::from_pem(bytes.get(..end)?).ok()
}

/// Returns the application URI of a certificate; `None` if the certificate does not contain a URI.
pub(super) fn application(cert: &X509) -> Option<String> {
    let cert = Certificate::from_der(&cert.to_der().ok()?).ok()?;
    let (_, names) = cert.tbs_certificate.get::<SubjectAltName>().ok()??;
    names.0.iter().find_map(|name| match name {
        GeneralName::UniformResourceIdentifier(uri) => Some(uri.as_str().to_owned()),
        _ => None,
    })
}

//! Modbus/TCP Security: whom a line trusts, and how the gateway shows who it is.

use std::sync::Arc;

use tokio_rustls::rustls::client::WebPkiServerVerifier;
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use tokio_rustls::rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error, InconsistentKeys, RootCertStore,
    SignatureScheme,
};

/// The port that the Modbus Organization has for it.
pub const TLS_PORT: u16 = 802;

/// The security of a line. Made from its files when the profile is checked, so that nothing about them can be wrong
/// later but their dates.
#[derive(Clone, Debug)]
pub struct Tls {
    /// The file with the certificates that are trusted, as written.
    pub ca: String,
    /// The file with the gateway's certificate, as written.
    pub cert: String,
    /// The name that the device's certificate must have.
    pub name: ServerName<'static>,
    /// Versions, ciphers, trust and key.
    pub client: Arc<ClientConfig>,
}

impl PartialEq for Tls {
    /// Two that were made at different times may come from different files.
    fn eq(&self, other: &Tls) -> bool {
        Arc::ptr_eq(&self.client, &other.client) && self.name == other.name
    }
}

/// Which of the files is wrong, and how.
#[derive(Debug)]
pub(crate) enum TlsFile {
    Ca(String),
    Cert(String),
    Key(String),
}

/// TLS 1.2 or 1.3 that trusts `ca` and shows `cert`, all as the PEM text of their files.
///
/// # Errors
/// A sentence for each file that is of no use.
pub(crate) fn client(ca: &[u8], cert: &[u8], key: &[u8]) -> Result<ClientConfig, Vec<TlsFile>> {
    let trusted = certificates(ca).and_then(|ca| Trust::new(&ca)).map_err(TlsFile::Ca);
    let chain = certificates(cert).map_err(TlsFile::Cert);
    let key = private_key(key).map_err(TlsFile::Key);
    let (trust, chain, key) = match (trusted, chain, key) {
        (Ok(trust), Ok(chain), Ok(key)) => (trust, chain, key),
        (trust, chain, key) => {
            return Err([trust.err(), chain.err(), key.err()].into_iter().flatten().collect());
        }
    };
    let config = ClientConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| vec![TlsFile::Ca(error.to_string())])?
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(trust))
        .with_client_auth_cert(chain, key);
    config.map_err(|error| {
        vec![match error {
            Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => {
                TlsFile::Key("this key does not belong to the certificate in `cert`".to_owned())
            }
            Error::InvalidCertificate(_) => TlsFile::Cert(format!("the certificate is of no use: {error}")),
            _ => TlsFile::Key(format!("the key is of no use: {error}")),
        }]
    })
}

fn certificates(text: &[u8]) -> Result<Vec<CertificateDer<'static>>, String> {
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(text).collect();
    match found {
        Ok(found) if found.is_empty() => {
            Err("there is no certificate in it in PEM form (-----BEGIN CERTIFICATE-----)".to_owned())
        }
        Ok(found) => Ok(found),
        Err(error) => Err(format!("it is not in PEM form: {error}")),
    }
}

fn private_key(text: &[u8]) -> Result<PrivateKeyDer<'static>, String> {
    if text.windows(ENCRYPTED.len()).any(|window| window == ENCRYPTED) {
        return Err(
            "the key is encrypted, and nobody is there to type its password when the gateway starts; \
                    write it in clear with `openssl pkey`, readable for the gateway's user only"
                .to_owned(),
        );
    }
    PrivateKeyDer::from_pem_slice(text)
        .map_err(|_| "there is no private key in it in PEM form (-----BEGIN PRIVATE KEY-----)".to_owned())
}

const ENCRYPTED: &[u8] = b"ENCRYPTED";

/// Trusts what the authorities in a file have signed, and the very certificates in it.
///
/// Many devices come with a certificate that they have signed themselves, for a name that is not theirs in this plant.
/// One that was put into the file, byte for byte, is known better than by its name; only its dates are still asked.
#[derive(Debug)]
struct Trust {
    authorities: Arc<WebPkiServerVerifier>,
    known: Vec<CertificateDer<'static>>,
}

impl Trust {
    fn new(known: &[CertificateDer<'static>]) -> Result<Trust, String> {
        let mut roots = RootCertStore::empty();
        for (place, certificate) in known.iter().enumerate() {
            let unreadable = |error| format!("certificate {} in it cannot be read: {error}", place + 1);
            roots.add(certificate.clone()).map_err(unreadable)?;
        }
        let authorities =
            WebPkiServerVerifier::builder_with_provider(Arc::new(roots), Arc::new(default_provider()))
                .build()
                .map_err(|error| error.to_string())?;
        Ok(Trust { authorities, known: known.to_vec() })
    }
}

impl ServerCertVerifier for Trust {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        server_name: &ServerName<'_>,
        ocsp_response: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        let verified =
            self.authorities.verify_server_cert(end_entity, intermediates, server_name, ocsp_response, now);
        match verified {
            // The dates are looked at before any of these.
            Err(Error::InvalidCertificate(
                CertificateError::NotValidForName
                | CertificateError::NotValidForNameContext { .. }
                | CertificateError::UnknownIssuer
                | CertificateError::InvalidPurpose
                | CertificateError::InvalidPurposeContext { .. }
                | CertificateError::Other(_),
            )) if self.known.iter().any(|known| known == end_entity) => Ok(ServerCertVerified::assertion()),
            verified => verified,
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.authorities.verify_tls12_signature(message, cert, dss)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.authorities.verify_tls13_signature(message, cert, dss)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.authorities.supported_verify_schemes()
    }
}

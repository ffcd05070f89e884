//! TLS client of a Modbus line, made from the files that the profile names: trusted authorities, certificate and key.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::net::TcpStream;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::client::{ResolvesClientCert, WebPkiServerVerifier};
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::sign::CertifiedKey;
use tokio_rustls::rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, Error, HandshakeKind, RootCertStore,
    SignatureScheme,
};

use super::plant_client::{own, plant_client, showing, trusting};
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::local_tcp::LocalTcp;
use crate::fieldbus::port::Port;
use crate::net::{self, ConnectError};
use isotherm_profile::{Errors, Profile, ProfileError, Tls};

/// Settings of connections inside TLS: versions, ciphers, trusted certificates, own certificate and key, and the name
/// of the device.
#[derive(Clone, Debug)]
pub(in crate::fieldbus) struct Client {
    name: ServerName<'static>,
    config: Arc<ClientConfig>,
    shown: Arc<ShownCertificate>,
}

/// Checks the TLS files that a profile names for its Modbus lines.
///
/// # Errors
/// All mistakes with their keys, in the order of the lines.
pub fn check(profile: &Profile) -> Result<(), Errors> {
    let secured = profile.buses.iter().filter_map(|bus| bus.tls.as_deref());
    let mut wrong: Vec<ProfileError> = secured.filter_map(|tls| Client::new(tls).err()).flatten().collect();
    let authorities = profile.notify.iter().filter_map(|notify| notify.ca.as_ref());
    wrong.extend(authorities.filter_map(|ca| Some(ca.invalid(&plant_client(Some(&ca.bytes)).err()?))));
    wrong.sort_by_key(|error| (error.line, error.column));
    if wrong.is_empty() { Ok(()) } else { Err(Errors(wrong)) }
}

impl Client {
    /// Returns a client for TLS 1.2 or 1.3 that trusts `ca` and sends `cert`.
    ///
    /// # Errors
    /// The mistakes in the name of the device and in each file.
    pub(in crate::fieldbus) fn new(tls: &Tls) -> Result<Client, Vec<ProfileError>> {
        let name = ServerName::try_from(tls.name.clone()).map_err(|_| tls.wrong_name());
        let trust = trusting(Some(&tls.ca.bytes)).map_err(|why| tls.ca.invalid(&why));
        let config = match (trust, own(&tls.cert, &tls.key)) {
            (Ok(trust), Ok(own)) => showing(trust, own, (&tls.cert, &tls.key)),
            (trust, own) => Err(trust.err().into_iter().chain(own.err().into_iter().flatten()).collect()),
        };
        match (name, config) {
            (Ok(name), Ok(mut config)) => {
                let shown = Arc::new(ShownCertificate::instead_of(config.client_auth_cert_resolver));
                config.client_auth_cert_resolver = shown.clone();
                Ok(Client { name, config: Arc::new(config), shown })
            }
            (name, config) => Err(name.err().into_iter().chain(config.err().into_iter().flatten()).collect()),
        }
    }

    /// Performs the TLS handshake on an open connection. Returns the encrypted stream.
    pub(in crate::fieldbus) async fn secure(&self, stream: TcpStream) -> Result<TlsStream<LocalTcp>, Fault> {
        let secured = net::secure(LocalTcp::new(stream), &self.name, &self.config).await;
        let connected = secured.map_err(|error| match error {
            ConnectError::Tls(fault) => Fault::Link(LinkFault::Tls(fault)),
            _ => Fault::Link(LinkFault::Broken),
        })?;
        // A device does not ask for a certificate again in a resumed TLS session.
        if connected.get_ref().1.handshake_kind() == Some(HandshakeKind::Full) {
            self.shown.warn(&self.name.to_str());
        }
        Ok(connected)
    }
}

/// Certificate of the gateway, with a record of whether a device has requested it.
#[derive(Debug)]
struct ShownCertificate {
    certificate: Arc<dyn ResolvesClientCert>,
    is_asked: AtomicBool,
    is_reported: AtomicBool,
}

impl ShownCertificate {
    fn instead_of(certificate: Arc<dyn ResolvesClientCert>) -> ShownCertificate {
        ShownCertificate {
            certificate,
            is_asked: AtomicBool::new(false),
            is_reported: AtomicBool::new(false),
        }
    }

    /// Logs a warning, once, if the device has not requested the gateway's certificate.
    fn warn(&self, device: &str) {
        if !self.is_asked.load(Ordering::Relaxed) && !self.is_reported.swap(true, Ordering::Relaxed) {
            tracing::warn!(
                "{device} requests no certificate: TLS encrypts the messages, but every client that reaches \
                 the device can command it. Set the device to accept only the gateway's certificate"
            );
        }
    }
}

impl ResolvesClientCert for ShownCertificate {
    fn resolve(&self, hints: &[&[u8]], schemes: &[SignatureScheme]) -> Option<Arc<CertifiedKey>> {
        self.is_asked.store(true, Ordering::Relaxed);
        self.certificate.resolve(hints, schemes)
    }

    fn has_certs(&self) -> bool {
        self.certificate.has_certs()
    }
}

/// TLS stream as a port. A tap (recorder of the line) receives the bytes of Modbus, before encryption and after
/// decryption.
impl Port for TlsStream<LocalTcp> {}

/// Verifier of a device's certificate. It trusts certificates signed by the authorities in a file, and the certificates
/// in the file themselves.
///
/// Many devices have a self-signed certificate that does not contain their host name in this plant. A certificate that
/// is identical to a certificate in the file identifies a device better than its name. For such a certificate only the
/// dates are checked.
#[derive(Debug)]
pub(super) struct Trust {
    authorities: Arc<WebPkiServerVerifier>,
    known: Vec<CertificateDer<'static>>,
}

impl Trust {
    pub(super) fn new(known: &[CertificateDer<'static>]) -> Result<Trust, String> {
        let mut roots = RootCertStore::empty();
        for (place, certificate) in known.iter().enumerate() {
            let unreadable = |error| format!("certificate {} in the file cannot be read: {error}", place + 1);
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
            // The library checks the dates before any of these.
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

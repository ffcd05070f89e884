//! TLS clients for servers in the plant, with or without a certificate of the gateway.

use std::path::Path;
use std::sync::Arc;

use tokio_rustls::rustls::client::WantsClientCert;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{ClientConfig, ConfigBuilder, RootCertStore};

use super::client::Trust;
use super::pem::{certificates, private_key};
use super::server::Wrong;
use isotherm_profile::{NamedFile, ProfileError, safe_file};

/// Files in which Linux distributions store the trusted certificate authorities.
const BUNDLES: [&str; 4] = [
    "/etc/ssl/certs/ca-certificates.crt",
    "/etc/pki/tls/certs/ca-bundle.crt",
    "/etc/ssl/ca-bundle.pem",
    "/etc/ssl/cert.pem",
];

/// Returns a client for TLS 1.2 or 1.3 that sends no certificate. It trusts the authorities in `ca`, a file in PEM
/// form. Without `ca`, it trusts the authorities of this computer.
///
/// # Errors
/// A sentence for the user, if `ca` is unusable or this computer has no trusted authorities.
pub fn plant_client(ca: Option<&[u8]>) -> Result<ClientConfig, String> {
    Ok(trusting(ca)?.with_no_client_auth())
}

/// Returns incomplete settings of a client for TLS 1.2 or 1.3: the choice of its own certificate is missing. The
/// trusted authorities are those of [`plant_client`].
pub(super) fn trusting(ca: Option<&[u8]>) -> Result<ConfigBuilder<ClientConfig, WantsClientCert>, String> {
    let config = ClientConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?;
    match ca {
        Some(ca) => {
            let trust = Arc::new(Trust::new(&certificates(ca)?)?);
            Ok(config.dangerous().with_custom_certificate_verifier(trust))
        }
        None => Ok(config.with_root_certificates(of_this_computer(BUNDLES.map(Path::new))?)),
    }
}

/// Certificates that this program sends, and the private key of the first one.
pub(super) type Own = (Vec<CertificateDer<'static>>, PrivateKeyDer<'static>);

/// Reads the certificates and the private key that this program sends.
///
/// # Errors
/// The mistakes in the two files.
pub(super) fn own(cert: &NamedFile, key: &NamedFile) -> Result<Own, Vec<ProfileError>> {
    let chain = certificates(&cert.bytes).map_err(|why| cert.invalid(&why));
    let private = private_key(&key.bytes).map_err(|why| key.invalid(&why));
    match (chain, private) {
        (Ok(chain), Ok(private)) => Ok((chain, private)),
        (chain, private) => Err(chain.err().into_iter().chain(private.err()).collect()),
    }
}

/// Completes the settings of a client with its own certificates and private key, which it reads from the files `cert`
/// and `key`.
///
/// # Errors
/// The mistake in one of the files.
pub(super) fn showing(
    config: ConfigBuilder<ClientConfig, WantsClientCert>,
    (chain, private): Own,
    (cert, key): (&NamedFile, &NamedFile),
) -> Result<ClientConfig, Vec<ProfileError>> {
    config.with_client_auth_cert(chain, private).map_err(|error| {
        vec![match Wrong::from(error) {
            Wrong::Cert(why) => cert.invalid(&why),
            Wrong::Key(why) => key.invalid(&why),
        }]
    })
}

/// Returns the authorities in the first of these files that contains at least one authority.
fn of_this_computer<'a>(bundles: impl IntoIterator<Item = &'a Path>) -> Result<RootCertStore, String> {
    for bundle in bundles {
        let mut roots = RootCertStore::empty();
        // A system may also have authorities in forms that this program cannot read.
        let found =
            safe_file::read(bundle, safe_file::LARGEST).ok().and_then(|text| certificates(&text).ok());
        roots.add_parsable_certificates(found.into_iter().flatten());
        if !roots.is_empty() {
            return Ok(roots);
        }
    }
    Err("this computer has no trusted authorities: install them (package `ca-certificates`), or write the path of a \
         file of authorities into `ca`"
        .to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_file_with_authorities_is_taken_and_without_one_it_is_said_what_to_do() {
        let home = tempfile::tempdir().unwrap();
        let [empty, full] = ["empty.pem", "full.pem"].map(|name| home.path().join(name));
        std::fs::write(&empty, "# none\n").unwrap();
        let key = rcgen::KeyPair::generate().unwrap();
        let mut params = rcgen::CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
        std::fs::write(&full, params.self_signed(&key).unwrap().pem()).unwrap();
        let none = home.path().join("not-there.pem");
        let found = of_this_computer([none.as_path(), &empty, &full]).unwrap();
        assert_eq!(found.len(), 1);
        assert!(
            of_this_computer([none.as_path(), &empty]).unwrap_err().contains("file of authorities into `ca`")
        );
    }
}

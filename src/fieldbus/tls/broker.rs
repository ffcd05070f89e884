//! A client of a broker: whom it trusts, and what it shows of itself, where it shows anything.

use std::path::Path;
use std::sync::Arc;

use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::{ClientConfig, Error, InconsistentKeys, RootCertStore};

use super::client::Trust;
use super::pem::{certificates, private_key};
use isotherm_profile::{Mqtt, ProfileError, regular};

/// Where the systems that there are keep the authorities that they trust, in one file.
const BUNDLES: [&str; 4] = [
    "/etc/ssl/certs/ca-certificates.crt",
    "/etc/pki/tls/certs/ca-bundle.crt",
    "/etc/ssl/ca-bundle.pem",
    "/etc/ssl/cert.pem",
];

/// TLS 1.2 or 1.3 as a profile says; `None` where its broker is spoken to without.
///
/// # Errors
/// What is wrong with each of its files.
pub fn broker(mqtt: &Mqtt) -> Result<Option<Arc<ClientConfig>>, Vec<ProfileError>> {
    if !mqtt.broker.tls {
        return Ok(None);
    }
    let builder = ClientConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| vec![mqtt.wrong(&error.to_string(), "")])?;
    let builder = match &mqtt.ca {
        Some(ca) => {
            let trust = certificates(&ca.bytes).and_then(|known| Trust::new(&known));
            let trust = trust.map_err(|why| vec![ca.wrong(&why)])?;
            builder.dangerous().with_custom_certificate_verifier(Arc::new(trust))
        }
        None => {
            let help = "install its authorities (`ca-certificates`), or name one with `tls = { ca = \"…\" }`";
            let roots = of_this_computer(BUNDLES.map(Path::new));
            builder.with_root_certificates(
                roots.ok_or_else(|| vec![mqtt.wrong("this computer trusts nobody", help)])?,
            )
        }
    };
    let Some((cert, key)) = &mqtt.own else { return Ok(Some(Arc::new(builder.with_no_client_auth()))) };
    let chain = certificates(&cert.bytes).map_err(|why| cert.wrong(&why));
    let private = private_key(&key.bytes).map_err(|why| key.wrong(&why));
    let (chain, private) = match (chain, private) {
        (Ok(chain), Ok(private)) => (chain, private),
        (chain, private) => return Err(chain.err().into_iter().chain(private.err()).collect()),
    };
    let config = builder.with_client_auth_cert(chain, private).map_err(|error| {
        vec![match error {
            Error::InconsistentKeys(InconsistentKeys::KeyMismatch) => {
                key.wrong("this key does not belong to the certificate in `cert`")
            }
            Error::InvalidCertificate(_) => cert.wrong(&format!("the certificate is of no use: {error}")),
            _ => key.wrong(&format!("the key is of no use: {error}")),
        }]
    });
    config.map(|config| Some(Arc::new(config)))
}

/// The authorities in the first of these files that has some.
fn of_this_computer<'a>(bundles: impl IntoIterator<Item = &'a Path>) -> Option<RootCertStore> {
    bundles.into_iter().find_map(|bundle| {
        let mut roots = RootCertStore::empty();
        // A system has authorities of forms that nobody here can read beside the others.
        let found = regular::read(bundle, regular::LARGEST).ok().and_then(|text| certificates(&text).ok());
        roots.add_parsable_certificates(found.into_iter().flatten());
        (!roots.is_empty()).then_some(roots)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_file_with_authorities_is_taken_and_without_one_nobody_is_trusted() {
        let home = tempfile::tempdir().unwrap();
        let [empty, full] = ["empty.pem", "full.pem"].map(|name| home.path().join(name));
        std::fs::write(&empty, "# none\n").unwrap();
        let key = rcgen::KeyPair::generate().unwrap();
        let mut params = rcgen::CertificateParams::new(Vec::new()).unwrap();
        params.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
        std::fs::write(&full, params.self_signed(&key).unwrap().pem()).unwrap();
        let none = home.path().join("not-there.pem");
        assert_eq!(of_this_computer([none.as_path(), &empty, &full]).unwrap().len(), 1);
        assert!(of_this_computer([none.as_path(), &empty]).is_none());
    }
}

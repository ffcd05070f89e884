//! Reading of certificates and keys in PEM form.

use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};

const ENCRYPTED: &[u8] = b"ENCRYPTED";

/// Returns the certificates in a file.
///
/// # Errors
/// A sentence for the user: the mistake in the file.
pub(super) fn certificates(text: &[u8]) -> Result<Vec<CertificateDer<'static>>, String> {
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(text).collect();
    match found {
        Ok(found) if found.is_empty() => {
            Err("there is no certificate in PEM form in the file (-----BEGIN CERTIFICATE-----)".to_owned())
        }
        Ok(found) => Ok(found),
        Err(error) => Err(format!("the file is not in PEM form: {error}")),
    }
}

/// Returns the private key in a file.
///
/// # Errors
/// A sentence for the user: the mistake in the file.
pub(super) fn private_key(text: &[u8]) -> Result<PrivateKeyDer<'static>, String> {
    if text.windows(ENCRYPTED.len()).any(|window| window == ENCRYPTED) {
        return Err(
            "the key is encrypted, and the gateway has no password for it. Write the key without encryption \
             with `openssl pkey`, readable for the gateway's user only"
                .to_owned(),
        );
    }
    PrivateKeyDer::from_pem_slice(text).map_err(|_| {
        "there is no private key in PEM form in the file (-----BEGIN PRIVATE KEY-----)".to_owned()
    })
}

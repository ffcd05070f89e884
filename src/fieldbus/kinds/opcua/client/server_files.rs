//! Files that a profile names for the OPC UA server of the gateway: its certificate, the certificates of trusted
//! clients, and the secrets of users.

use super::files::{application, certificate, pair};
use isotherm_profile::{NamedFile, OpcUaServer, ProfileError, ServerLogin};

/// Content of the files that `[opcua_server]` names.
#[derive(Clone, Default)]
pub struct ServerFiles {
    /// Certificate in DER form, and private key in PEM form. `None` without security.
    pub own: Option<(Vec<u8>, Vec<u8>)>,
    /// Application URI in the certificate; `None` without security.
    pub application: Option<String>,
    /// Certificates of trusted clients, in DER form.
    pub trusted: Vec<Vec<u8>>,
    /// Secret of each user, in the order of the profile: the password, or the certificate in DER form.
    pub secrets: Vec<Vec<u8>>,
}

/// Reads the files that `[opcua_server]` names.
///
/// # Errors
/// All mistakes in these files.
pub(in crate::fieldbus) fn read(server: &OpcUaServer) -> Result<ServerFiles, Vec<ProfileError>> {
    let mut wrong = Vec::new();
    let (mut own, mut uri) = (None, None);
    if let Some((cert, key)) = &server.own
        && let Some((parsed, _)) = pair(cert, key, &mut wrong)
    {
        uri = application(&parsed);
        own = parsed.to_der().ok().map(|der| (der, key.bytes.clone()));
        if uri.is_none() {
            wrong.push(cert.invalid(
                "the certificate contains no application URI, which clients check: add the URI to the \
                 subjectAltName of the certificate",
            ));
        }
    }
    let mut der = |file: &NamedFile| {
        let found = certificate(&file.bytes).and_then(|cert| cert.to_der().ok());
        if found.is_none() {
            wrong.push(file.invalid("the file is not a certificate in DER or PEM form"));
        }
        found
    };
    let trusted: Vec<Vec<u8>> = server.trusted.iter().filter_map(&mut der).collect();
    let mut secrets = Vec::new();
    let mut unusable = Vec::new();
    for user in &server.users {
        match &user.login {
            ServerLogin::Certificate(cert) => secrets.extend(der(cert)),
            ServerLogin::Password(file) => match password(&file.bytes) {
                Ok(password) => secrets.push(password),
                Err(why) => unusable.push(file.invalid(why)),
            },
        }
    }
    wrong.append(&mut unusable);
    if wrong.is_empty() { Ok(ServerFiles { own, application: uri, trusted, secrets }) } else { Err(wrong) }
}

/// Returns a password without the newline at its end. The error is a text about the mistake, for example an empty
/// password.
fn password(bytes: &[u8]) -> Result<Vec<u8>, &'static str> {
    let text = std::str::from_utf8(bytes).map_err(|_| "the file is not text in UTF-8")?;
    let text = text.trim_end_matches(['\r', '\n']);
    if text.is_empty() { Err("the password is empty") } else { Ok(text.as_bytes().to_vec()) }
}

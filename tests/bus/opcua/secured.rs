//! Tests of signed and encrypted connections, of users, and of wrong certificates.

use std::path::Path;

use super::rig::{Line, Server, machine, no_session, profile, python};
use isotherm::fieldbus::kinds::opcua::check as opcua_check;
use isotherm::fieldbus::kinds::opcua::fault::OpcUaFault;

/// Creates a directory with certificates, and with the server's certificate among the trusted ones.
pub(crate) fn certificates() -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    assert!(python("opcua_certificates.py").arg(directory.path()).status().unwrap().success());
    std::fs::create_dir(directory.path().join("trusted")).unwrap();
    std::fs::copy(directory.path().join("server.der"), directory.path().join("trusted/server.der")).unwrap();
    directory
}

pub(crate) fn serve(directory: &Path, name: &str, more: &[&str]) -> Server {
    let file = |end| directory.join(format!("{name}.{end}")).display().to_string();
    let (cert, key) = (file("der"), file("pem"));
    Server::start(&[&["--cert", cert.as_str(), "--key", key.as_str()], more].concat())
}

/// Returns the keys of a secured bus.
pub(crate) fn secured(security: &str, own: &str, user: &str) -> String {
    format!(
        "security = \"{security}\"\ncert = \"{own}.der\"\nkey = \"{own}.pem\"\ntrusted = \"trusted\"\n{user}"
    )
}

#[tokio::test]
async fn a_line_reads_signed_as_well_as_encrypted() {
    let directory = certificates();
    let server = serve(directory.path(), "server", &[]);
    for security in ["sign", "sign-and-encrypt"] {
        let text = machine(server.port, &secured(security, "own", ""));
        let mut line = Line::new(profile(&text, directory.path()));
        assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]), "{security}");
    }
}

#[tokio::test]
async fn a_secured_line_takes_its_session_up_again_after_the_server_was_killed() {
    let directory = certificates();
    let server = serve(directory.path(), "server", &[]);
    let text = machine(server.port, &secured("sign-and-encrypt", "own", ""));
    let mut line = Line::new(profile(&text, directory.path()));
    assert!(line.signals().await.is_ok());
    let path = |end: &str| directory.path().join(format!("server.{end}")).display().to_string();
    let _server = server.dies(&["--cert", &path("der"), "--key", &path("pem")]);
    assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]));
}

#[tokio::test]
async fn a_server_whose_certificate_is_not_in_the_directory_is_not_spoken_to() {
    let directory = certificates();
    let server = serve(directory.path(), "server", &[]);
    std::fs::rename(directory.path().join("trusted/server.der"), directory.path().join("trusted/none.txt"))
        .unwrap();
    std::fs::copy(directory.path().join("own.der"), directory.path().join("trusted/other.der")).unwrap();
    let text = machine(server.port, &secured("sign-and-encrypt", "own", ""));
    let mut line = Line::new(profile(&text, directory.path()));
    assert_eq!(line.signals().await, Err(no_session(OpcUaFault::NotTrusted)));
}

#[tokio::test]
async fn an_expired_certificate_of_either_end_is_told_with_what_to_do() {
    let directory = certificates();
    let server = serve(directory.path(), "server", &[]);
    let text = machine(server.port, &secured("sign-and-encrypt", "old", ""));
    let fault = Line::new(profile(&text, directory.path())).signals().await.unwrap_err();
    assert_eq!(fault, no_session(OpcUaFault::OursExpired));
    assert!(fault.to_string().contains("make a new one (`isotherm opcua certificate PROFILE`)"), "{fault}");
    let old = serve(directory.path(), "old", &[]);
    std::fs::copy(directory.path().join("old.der"), directory.path().join("trusted/old.der")).unwrap();
    let text = machine(old.port, &secured("sign-and-encrypt", "own", ""));
    let fault = Line::new(profile(&text, directory.path())).signals().await.unwrap_err();
    assert_eq!(fault, no_session(OpcUaFault::Expired));
    assert!(fault.to_string().contains("renew it at the server"), "{fault}");
}

#[tokio::test]
async fn a_user_is_let_in_by_the_password_in_its_file_and_not_by_another() {
    let directory = certificates();
    let server = serve(directory.path(), "server", &["--user", "isotherm:hot-and-cold"]);
    let user = "user = { name = \"isotherm\", password_file = \"password\" }";
    let text = machine(server.port, &secured("sign-and-encrypt", "own", user));
    for (password, expected) in [
        ("hot-and-cold\n", Ok([Ok(20.0), Ok(100.0)])),
        ("cold-and-hot", Err(no_session(OpcUaFault::UserRefused))),
    ] {
        std::fs::write(directory.path().join("password"), password).unwrap();
        let profile = profile(&text, directory.path());
        assert!(!format!("{profile:?}").contains("cold"), "a secret is shown");
        assert_eq!(Line::new(profile).signals().await, expected);
    }
    let text = machine(server.port, &secured("sign-and-encrypt", "own", ""));
    let nobody = Line::new(profile(&text, directory.path())).signals().await;
    assert_eq!(nobody, Err(no_session(OpcUaFault::NoEndpoint)));
}

#[test]
fn files_that_are_of_no_use_are_told_at_their_keys() {
    let directory = certificates();
    std::fs::copy(directory.path().join("server.pem"), directory.path().join("other.pem")).unwrap();
    let text = machine(1, &secured("sign-and-encrypt", "own", "")).replace("own.pem", "other.pem");
    let said = opcua_check::check(&profile(&text, directory.path())).unwrap_err().to_string();
    assert!(said.contains("other.pem: the key is not the key of the certificate own.der"), "{said}");
    let text = machine(1, &secured("sign-and-encrypt", "own", "")).replace("own.der", "own.pem");
    let said = opcua_check::check(&profile(&text, directory.path())).unwrap_err().to_string();
    assert!(said.contains("own.pem: the file is no certificate in DER or PEM form"), "{said}");
}

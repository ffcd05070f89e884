//! Tests of signed and encrypted connections, of users, and of wrong certificates.

use std::path::Path;
use std::time::Duration;

use super::process::{Running, isotherm};
use super::rig::{Line, Server, machine, no_session, profile, python};
use super::words::typing;
use isotherm::fieldbus::explain::explain;
use isotherm::fieldbus::kinds::opcua::check as opcua_check;
use isotherm::fieldbus::kinds::opcua::fault::OpcUaFault;
use isotherm::fieldbus::wire::Answer;

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
    let said = explain(fault);
    assert!(said.contains("make a new one (`isotherm opcua certificate PROFILE`)"), "{said}");
    let old = serve(directory.path(), "old", &[]);
    std::fs::copy(directory.path().join("old.der"), directory.path().join("trusted/old.der")).unwrap();
    let text = machine(old.port, &secured("sign-and-encrypt", "own", ""));
    let fault = Line::new(profile(&text, directory.path())).signals().await.unwrap_err();
    assert_eq!(fault, no_session(OpcUaFault::Expired));
    let said = explain(fault);
    assert!(said.contains("renew the certificate at the server"), "{said}");
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

/// Creates certificates that only some servers have: with a chain, and with a short key.
fn others() -> tempfile::TempDir {
    let directory = certificates();
    let made = python("opcua_certificates.py").arg("--others").arg(directory.path()).status().unwrap();
    assert!(made.success());
    directory
}

fn trust(directory: &Path, name: &str) {
    std::fs::copy(directory.join(name), directory.join("trusted").join(name)).unwrap();
}

#[tokio::test]
async fn a_server_that_sends_its_certificate_with_its_chain_is_read_and_written() {
    let directory = others();
    let authority = directory.path().join("authority.der").display().to_string();
    let password = "isotherm:hot-and-cold";
    let server = serve(directory.path(), "chained", &["--chain", &authority, "--user", password]);
    std::fs::write(directory.path().join("password"), "hot-and-cold").unwrap();
    let user = "user = { name = \"isotherm\", password_file = \"password\" }";
    let line = |security: &str| {
        let bus = match security {
            "none" => format!("security = \"none\"\n{user}"),
            _ => secured(security, "own", user),
        };
        Line::new(profile(&machine(server.port, &bus), directory.path()))
    };
    trust(directory.path(), "authority.der");
    assert_eq!(
        line("sign").signals().await,
        Err(no_session(OpcUaFault::NotTrusted)),
        "the authority alone is not sufficient"
    );
    trust(directory.path(), "chained.der");
    for security in ["sign", "sign-and-encrypt", "none"] {
        let mut line = line(security);
        assert_eq!(line.signals().await, Ok([Ok(20.0), Ok(100.0)]), "{security}");
        assert_eq!(line.writes(7).await, Ok(Answer::Done), "{security}");
    }
}

#[tokio::test]
async fn a_server_with_a_short_key_is_read_and_check_warns_of_its_certificate() {
    let directory = others();
    trust(directory.path(), "short.der");
    let server = serve(directory.path(), "short", &[]);
    let profile = profile(&machine(server.port, &secured("sign-and-encrypt", "own", "")), directory.path());
    let weak = isotherm::gateway::certificates::weak(&profile);
    assert_eq!(weak.len(), 1, "{weak:?}");
    let weak = weak[0].as_str();
    assert!(
        weak.contains(
            "the server's certificate trusted/short.der is weak: the key has 1024 bits. The gateway uses it."
        ),
        "{weak}"
    );
    assert_eq!(Line::new(profile).signals().await, Ok([Ok(20.0), Ok(100.0)]));
    let checked =
        typing(isotherm(directory.path()).args(["check", "machine.toml"]).current_dir(&directory), "");
    assert!(checked.said.contains(weak), "{}{}", checked.out, checked.said);
}

/// Many servers lock a user after a few rejected passwords.
#[test]
fn a_rejected_password_is_not_tried_again_within_minutes_and_its_session_is_closed() {
    let directory = tempfile::tempdir().unwrap();
    let mut server = Server::start(&["--user", "isotherm:hot-and-cold"]);
    std::fs::write(directory.path().join("password"), "cold-and-hot").unwrap();
    let user = "security = \"none\"\nuser = { name = \"isotherm\", password_file = \"password\" }";
    let path = directory.path().join("machine.toml");
    std::fs::write(&path, machine(server.port, user)).unwrap();
    let mut command = isotherm(directory.path());
    let mut gateway = Running::start(
        command.arg("run").arg(&path).args(["--state", "state"]).current_dir(directory.path()),
    );
    gateway.receives("the server rejects this user");
    std::thread::sleep(Duration::from_secs(10));
    assert_eq!((server.does("logins"), server.does("open")), ("1".to_owned(), "0".to_owned()));
}

#[test]
fn files_that_are_of_no_use_are_told_at_their_keys() {
    let directory = certificates();
    std::fs::copy(directory.path().join("server.pem"), directory.path().join("other.pem")).unwrap();
    let text = machine(1, &secured("sign-and-encrypt", "own", "")).replace("own.pem", "other.pem");
    let said = opcua_check::check(&profile(&text, directory.path())).unwrap_err().to_string();
    assert!(said.contains("other.pem: the key does not belong to the certificate own.der"), "{said}");
    let text = machine(1, &secured("sign-and-encrypt", "own", "")).replace("own.der", "own.pem");
    let said = opcua_check::check(&profile(&text, directory.path())).unwrap_err().to_string();
    assert!(said.contains("own.pem: the file is not a certificate in DER or PEM form"), "{said}");
}

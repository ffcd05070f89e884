//! The page over TLS. It does not answer without TLS, and its certificate is renewed while it is served.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use isotherm::clock::BootClock;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use crate::certificates::{Authority, Signed};
use crate::process::{file, isotherm, until};
use crate::rig::{Machine, ask, get};
use crate::site::OPERATOR;

const WEB: &str = "[web]\nlisten = \"127.0.0.1:0\"\ncommands = \"local\"\ntls = { cert = \"page.pem\", key = \"page.key\" }\n";

/// TLS connection of a client.
pub(crate) type Secured = StreamOwned<ClientConnection, TcpStream>;

/// Makes a TLS connection to a server with a certificate of this authority.
pub(crate) fn secured(authority: &str, stream: TcpStream) -> Secured {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(authority.as_bytes()).unwrap()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let name = ServerName::from(stream.peer_addr().unwrap().ip());
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    StreamOwned::new(ClientConnection::new(Arc::new(config), name).unwrap(), stream)
}

/// Sends a request to a server with a certificate of this authority.
fn asks(authority: &str, page: SocketAddr, request: &str) -> Result<String, String> {
    let mut secured = secured(authority, TcpStream::connect(page).unwrap());
    secured.write_all(request.as_bytes()).map_err(|error| error.to_string())?;
    let mut answer = String::new();
    secured.read_to_string(&mut answer).map_err(|error| error.to_string())?;
    Ok(answer)
}

/// Replaces certificate and key like a program that renews certificates: each file atomically, one after the other.
fn lay(home: &Path, signed: &Signed) {
    for (name, text) in [("page.pem", &signed.cert), ("page.key", &signed.key)] {
        std::fs::write(home.join("new"), text).unwrap();
        std::fs::rename(home.join("new"), home.join(name)).unwrap();
    }
}

#[test]
fn the_page_speaks_tls_alone_and_shows_what_lies_in_its_files_now() {
    let [first, second] = [Authority::named("first"), Authority::named("second")];
    let home = tempfile::tempdir().unwrap();
    lay(home.path(), &first.signs("127.0.0.1", (2020, 2090)));
    std::fs::set_permissions(home.path().join("page.key"), std::fs::Permissions::from_mode(0o644)).unwrap();
    let files = ["page.pem", "page.key"].map(|name| home.path().join(name).display().to_string());
    let web = WEB.replace("page.pem", &files[0]).replace("page.key", &files[1]);
    let token = file(home.path(), "operator.token", OPERATOR);
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
    let web = web.replace("commands = \"local\"", &format!("token_file = \"{}\"", token.display()));
    let mut machine = Machine::start(None, &[], &web);
    let said = machine.gateway.receives("page https://127.0.0.1:");
    let page: SocketAddr = said.rsplit('/').next().unwrap().parse().unwrap();
    until("its key is warned of", || {
        let said = machine.gateway.so_far().join("\n");
        if said.contains("every user of this computer can read") { Ok(()) } else { Err(said) }
    });
    let _on_time = machine.on_time();
    let silent = TcpStream::connect(page).unwrap();
    let begun = BootClock::default().passed();

    let healthy = |authority: &Authority| asks(&authority.cert, page, &get(page, "/healthz"));
    let answer = healthy(&first).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(ask(page, &get(page, "/healthz")).is_none_or(|answer| !answer.starts_with("HTTP/1.1")));
    // Over TLS, the browser protects the session cookie from plain pages, from scripts, and from other hosts.
    let sign_in = format!("token={OPERATOR}");
    let head = format!(
        "POST /login HTTP/1.1\r\nHost: {page}\r\nOrigin: https://{page}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n",
        sign_in.len()
    );
    let answer = asks(&first.cert, page, &(head + &sign_in)).unwrap();
    let cookie = answer.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap_or(&answer);
    let (name, attributes) = cookie.split_once('=').unwrap();
    assert_eq!(name, format!("__Host-isotherm_visit_{}", page.port()));
    assert_eq!(attributes[32..], *"; Path=/; HttpOnly; SameSite=Strict; Secure");
    let visit = cookie.split(';').next().unwrap();
    let bare = visit.trim_start_matches("__Host-");
    for (scheme, visit, code) in [("https", visit, 200), ("http", visit, 403), ("https", bare, 401)] {
        let head = format!(
            "POST /api/disarm HTTP/1.1\r\nHost: {page}\r\nOrigin: {scheme}://{page}\r\nCookie: {visit}\r\n"
        );
        let answer = asks(&first.cert, page, &format!("{head}Connection: close\r\n\r\n")).unwrap();
        assert!(answer.starts_with(&format!("HTTP/1.1 {code}")), "{scheme}: {answer}");
    }

    lay(home.path(), &second.signs("127.0.0.1", (2020, 2090)));
    until("the new certificate is shown", || healthy(&second).map(drop));
    assert!(healthy(&first).is_err(), "the old one is shown no more");
    std::fs::write(&files[0], "no certificate").unwrap();
    machine.gateway.receives("the web page still uses its old certificate");
    healthy(&second).unwrap();

    // The handshake has the same timeout as a head.
    let mut silent = silent;
    silent.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    assert_eq!(silent.read(&mut [0; 16]).unwrap_or(0), 0, "it is still open");
    let took = BootClock::default().passed() - begun;
    assert!(took >= Duration::from_secs(9), "{took:?}");
    let said = machine.gateway.so_far().join("\n");
    assert_eq!(said.matches("still uses its old certificate").count(), 1, "{said}");
}

#[test]
fn a_page_without_its_certificate_is_refused_at_the_start_with_the_file_and_what_is_wrong() {
    let authority = Authority::new();
    let [one, other] = ["127.0.0.1", "localhost"].map(|name| authority.signs(name, (2020, 2090)));
    for (cert, key, words) in [
        (None, Some(&one.key), "page.pem cannot be read (web.tls)"),
        (Some(&one.key), Some(&one.key), "page.pem (web.tls): there is no certificate in PEM form"),
        (Some(&one.cert), Some(&one.cert), "page.key (web.tls): there is no private key in PEM form"),
        (Some(&one.cert), Some(&other.key), "page.key (web.tls): this key is not the key of the certificate"),
    ] {
        let home = tempfile::tempdir().unwrap();
        for (name, text) in [("page.pem", cert), ("page.key", key)] {
            if let Some(text) = text {
                std::fs::write(home.path().join(name), text).unwrap();
            }
        }
        let files = ["page.pem", "page.key"].map(|name| home.path().join(name).display().to_string());
        let web = WEB.replace("page.pem", &files[0]).replace("page.key", &files[1]);
        let mut machine = Machine::start(None, &[], &web);
        machine.gateway.receives(words);
        let checked =
            isotherm(home.path()).arg("check").arg(machine.home.path().join("walker.toml")).output();
        let said = String::from_utf8(checked.unwrap().stderr).unwrap();
        assert!(said.contains(words) && said.contains("does not start until this is corrected"), "{said}");
        assert_eq!(machine.gateway.ends_within(Duration::from_secs(30)).code(), Some(1), "{words}");
    }
}

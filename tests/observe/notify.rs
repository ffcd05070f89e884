//! Delivery of one message to different servers, over real sockets.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::future::Future;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use isotherm::fieldbus::tls;
use isotherm::observe::notify::{Failure, Post, Server};
use isotherm_profile::{ALARM, Notify, Url};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

use crate::support::certificates;
use crate::support::process;

use certificates::{Authority, Signed, signs_itself};
use process::{Running, file};

mod chats;

const NOW: (i32, i32) = (2020, 2099);
const BODY: &str = "{\"text\":\"µ\"}";

/// Server with this URL. `ca` contains the trusted certificates.
fn to(url: &str, ca: Option<&str>) -> Server {
    let url = Url::parse(url).unwrap();
    let notify =
        Notify { name: "notify[0]".into(), url, on: vec![ALARM], token_file: None, ca: None, body: None };
    Server::of(&notify, tls::plant_client(ca.map(str::as_bytes)).map(Arc::new))
}

/// Starts a server that handles its only connection with `serve`.
async fn once<F: Future<Output = ()> + Send>(
    serve: impl FnOnce(TcpStream) -> F + Send + 'static,
) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move { serve(listener.accept().await.unwrap().0).await });
    address
}

/// Starts a server that gives this answer to a request.
async fn answering(answer: &'static str) -> SocketAddr {
    once(move |mut stream| async move {
        let mut request = vec![0; 4096];
        let _ = stream.read(&mut request).await;
        let _ = stream.write_all(answer.as_bytes()).await;
    })
    .await
}

async fn posted(answer: &'static str) -> Result<(), Failure> {
    let address = answering(answer).await;
    to(&format!("http://{address}/a"), None).post(BODY).await
}

#[tokio::test]
async fn what_a_server_answers_is_said_in_words() {
    assert_eq!(posted("HTTP/1.1 202 Accepted\r\nContent-Length: 2\r\n\r\nok").await, Ok(()));
    for (answer, words) in [
        ("HTTP/1.1 500 Oops\r\n\r\n", "the server answered 500: the server had an internal error"),
        ("HTTP/1.1 401 Who\r\n\r\n", "the server answered 401: is the token in `token_file` right?"),
        ("HTTP/1.1 404 Where\r\n\r\n", "the server answered 404: is the path in `url` right?"),
        ("HTTP/1.1 429 Slow\r\nRetry-After: 30\r\n\r\n", "the server answered 429: the server is overloaded"),
        (
            "HTTP/1.1 301 Moved\r\nLocation: https://elsewhere.example/?secret\r\n\r\n",
            "the server answered 301, a redirection to another address (https://elsewhere.example). The \
             gateway does not follow it: write that address into `url`",
        ),
        ("HTTP/1.1 200 OK\r\nA: ", "the server closed the connection before it had answered"),
        ("", "the server closed the connection before it had answered"),
        ("220 mail.example ESMTP\r\n", "does not speak HTTP/1.1"),
    ] {
        let failure = posted(answer).await.unwrap_err().to_string();
        assert!(failure.contains(words), "{answer}: {failure}");
        assert!(!failure.contains("secret"), "{failure}");
    }
}

#[tokio::test]
async fn who_is_not_there_is_told_from_who_says_nothing() {
    let free = TcpListener::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
    assert_eq!(to(&format!("http://{free}"), None).post(BODY).await, Err(Failure::Refused));
    assert_eq!(to("http://no-such-host.invalid", None).post(BODY).await, Err(Failure::Unresolved));
    let silent = once(|stream| async move {
        tokio::time::sleep(Duration::from_secs(60)).await;
        drop(stream);
    });
    let silent = to(&format!("http://{}", silent.await), None);
    let waited = tokio::time::timeout(Duration::from_millis(300), silent.post(BODY)).await;
    assert!(waited.is_err(), "whoever carries the message waits as long as it likes");
}

/// Starts a server with TLS. Returns its address, and a receiver of the request.
async fn secured(signed: &Signed) -> (SocketAddr, tokio::sync::oneshot::Receiver<String>) {
    let config = tls::server(signed.cert.as_bytes(), signed.key.as_bytes()).unwrap();
    let acceptor = TlsAcceptor::from(Arc::new(config));
    let (tell, reported) = tokio::sync::oneshot::channel();
    let address = once(move |stream| async move {
        let Ok(mut stream): Result<TlsStream<TcpStream>, _> = acceptor.accept(stream).await else { return };
        let mut request = String::new();
        while !request.ends_with(BODY) {
            let mut some = [0; 1024];
            let Ok(count @ 1..) = stream.read(&mut some).await else { return };
            request.push_str(&String::from_utf8_lossy(&some[..count]));
        }
        let _ = stream.write_all(b"HTTP/1.1 200 OK\r\n\r\n").await;
        let _ = stream.shutdown().await;
        let _ = tell.send(request);
    });
    (address.await, reported)
}

#[tokio::test]
async fn a_server_with_a_certificate_of_the_plants_own_authority_is_posted_to() {
    let authority = Authority::new();
    for (signed, ca) in [
        (authority.signs("localhost", NOW), authority.cert.clone()),
        // A self-signed certificate for another name, which the client trusts itself.
        {
            let signed = signs_itself("hooks", NOW);
            (signed.clone(), signed.cert)
        },
    ] {
        let (address, reported) = secured(&signed).await;
        let server = to(&format!("https://localhost:{}/in?key=1", address.port()), Some(&ca));
        assert_eq!(server.post(BODY).await, Ok(()));
        let request = reported.await.unwrap();
        assert!(request.starts_with("POST /in?key=1 HTTP/1.1\r\n"), "{request}");
        assert!(request.contains(&format!("\r\nContent-Length: {}\r\n", BODY.len())), "{request}");
        let (address, _) = secured(&signed).await;
        let server = to(&format!("https://localhost:{}/", address.port()), Some(&ca));
        assert_eq!(server.reached(Duration::from_secs(30)).await, Ok(()));
    }
}

/// A web server in Python with TLS. It prints its port, and then the posted messages.
const OF_PYTHON: &str = r#"
import http.server, ssl, sys

class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        print("posted", self.path, self.headers["Authorization"], self.headers["Content-Type"], body, flush=True)
        self.send_response(201)
        self.send_header("Content-Length", "0")
        self.end_headers()

context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
context.load_cert_chain(sys.argv[1], sys.argv[2])
server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
server.socket = context.wrap_socket(server.socket, server_side=True)
print("at", server.server_address[1], flush=True)
server.serve_forever()
"#;

#[tokio::test]
async fn a_web_server_of_others_takes_it_with_the_token_beside_or_within_its_address() {
    let home = tempfile::tempdir().unwrap();
    let signed = signs_itself("localhost", NOW);
    let files = [("cert.pem", &signed.cert), ("key.pem", &signed.key)];
    let [cert, key] = files.map(|(name, text)| file(home.path(), name, text));
    let token = file(home.path(), "token", "T0/B1/secret\n");
    std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
    let mut python = Running::start(Command::new("python3").args(["-c", OF_PYTHON]).args([cert, key]));
    let port = python.receives("at ").trim_start_matches("at ").to_owned();
    for (target, seen) in [
        ("in?key=1", "/in?key=1 Bearer T0/B1/secret"),
        ("services/{token}?x", "/services/T0/B1/secret?x None"),
    ] {
        let url = Url::parse(&format!("https://localhost:{port}/{target}")).unwrap();
        let token_file = Some(token.clone());
        let notify =
            Notify { name: "notify[0]".into(), url, on: vec![ALARM], token_file, ca: None, body: None };
        let server = Server::of(&notify, tls::plant_client(Some(signed.cert.as_bytes())).map(Arc::new));
        assert_eq!(server.post(BODY).await, Ok(()));
        assert_eq!(python.receives("posted"), format!("posted {seen} application/json {BODY}"));
    }
}

#[tokio::test]
async fn a_server_whom_nobody_trusts_gets_no_message_and_it_is_said_why() {
    let (authority, other) = (Authority::new(), Authority::named("other"));
    for (signed, ca, words) in [
        (authority.signs("localhost", NOW), &other.cert, "no trusted authority has signed"),
        (authority.signs("elsewhere", NOW), &authority.cert, "write the name in the certificate into `url`"),
        (authority.signs("localhost", (2001, 2002)), &authority.cert, "has expired"),
    ] {
        let (address, reported) = secured(&signed).await;
        let server = to(&format!("https://localhost:{}/", address.port()), Some(ca));
        let failure = server.post(BODY).await.unwrap_err().to_string();
        assert!(failure.contains(words), "{words}: {failure}");
        assert!(reported.await.is_err(), "it was told all the same");
    }
    let plain = answering("HTTP/1.1 400 Bad\r\n\r\n").await;
    let failure = to(&format!("https://{plain}/"), Some(&authority.cert)).post(BODY).await.unwrap_err();
    assert!(failure.to_string().contains("does not speak TLS"), "{failure}");
    let server = Server::of(
        &Notify {
            name: "notify[0]".into(),
            url: Url::parse(&format!("https://{plain}/")).unwrap(),
            on: vec![ALARM],
            token_file: None,
            ca: None,
            body: None,
        },
        Err("this computer has no trusted authorities".to_owned()),
    );
    let none = server.reached(Duration::from_secs(1)).await.unwrap_err();
    assert!(matches!(none, Failure::Tls(_) | Failure::Refused), "{none}");
}

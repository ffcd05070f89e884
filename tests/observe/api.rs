//! The API: methods of its addresses, compression of the page, and its description in OpenAPI, which a validator compares
//! with running gateways.

use std::io::Read;
use std::path::Path;
use std::process::Command;

use flate2::read::GzDecoder;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use crate::http::{OPERATOR, log};
use crate::support::fake::{Door, VIEWER};
use crate::support::process::{Running, isotherm};

/// Compares the description of the API with the API at this address. `token` is the operator's token.
fn compared(address: &str, token: Option<&str>) -> String {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().unwrap();
    let python = target.join("tools/venv/bin/python");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/openapi.py");
    let ended = Command::new(&python).arg(script).arg(address).args(token).output();
    let ended =
        ended.unwrap_or_else(|error| panic!("{}: {error}: `tests/run tools` makes it", python.display()));
    let said = [ended.stdout, ended.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(ended.status.success(), "{said}\n(without openapi-spec-validator: `tests/run tools`)");
    said
}

#[tokio::test]
async fn every_answer_is_as_the_description_of_the_api_says() {
    let home = tempfile::tempdir().unwrap();
    let door = Door::open(Some(OPERATOR)).await;
    door.keeps(vec![log(home.path())]);
    let address = format!("http://{}", door.address);
    let said = tokio::task::spawn_blocking(move || compared(&address, Some(OPERATOR))).await.unwrap();
    for line in [
        "GET /api/status 200",
        "GET /api/live 200",
        "GET /api/events 200",
        "GET /api/history 200",
        "GET /api/history.csv 200",
        "GET /api/history?points=1 400",
        "GET /readyz 503",
        "GET /openapi.json 200",
        "POST /api/arm 401",
        "POST /api/arm 200",
        "POST /api/zero 409",
        "POST /api/axes/z/measured 200",
        "POST /api/axes/z/measured 400",
        "POST /api/axes/z/measured 409",
        "DELETE /api/axes/nothing/measured 404",
        "POST /api/logout 200",
    ] {
        assert!(said.lines().any(|known| known == line), "{line} in {said}");
    }
}

#[test]
fn the_answers_of_a_compensating_gateway_are_as_the_description_of_the_api_says() {
    let home = tempfile::tempdir().unwrap();
    let mut running = isotherm(home.path());
    let day = ["--speed", "600", "--for", "240h"];
    let mut running = Running::start(running.args(["demo", "--listen", "127.0.0.1:0"]).args(day));
    let address = running.receives("page  http://").trim_start_matches("page  ").to_owned();
    let said = compared(&address, None);
    for line in ["GET /api/status 200", "GET /metrics 200", "GET /healthz 200"] {
        assert!(said.lines().any(|known| known == line), "{line} in {said}");
    }
}

#[tokio::test]
async fn a_wrong_method_is_refused_before_the_token_is_checked() {
    let door = Door::open(Some(OPERATOR)).await;
    for (method, path, allowed) in [
        ("DELETE", "/api/status", "GET,HEAD"),
        ("POST", "/metrics", "GET,HEAD"),
        ("GET", "/api/arm", "POST"),
        ("OPTIONS", "/api/arm?axis=z", "POST"),
        ("PUT", "/api/axes/z/measured", "POST,DELETE"),
        ("DELETE", "/login", "GET,POST,HEAD"),
        ("POST", "/page/main.js", "GET,HEAD"),
        ("POST", "/", "GET,HEAD"),
    ] {
        let wrong = [("Authorization", "Bearer wrong")];
        for headers in [&[][..], &wrong] {
            let reply = door.send(method, path, headers, "").await;
            assert_eq!((reply.code, reply.header("allow")), (405, allowed), "{method} {path}");
        }
    }
    assert_eq!(door.askers().len(), 0, "it is no event");
    assert_eq!(door.commands().len(), 0);
    // The methods of an address still require a token.
    for (method, path) in [("GET", "/api/status"), ("HEAD", "/api/status"), ("POST", "/api/arm")] {
        assert_eq!(door.send(method, path, &[], "").await.code, 401, "{method} {path}");
    }
    assert_eq!(door.send("PUT", "/nothing", &[], "").await.code, 401, "there is no such address");
}

/// Requests a path. Returns the head of the answer, and its body as bytes.
async fn bytes(door: &Door, path: &str, headers: &str) -> (String, Vec<u8>) {
    let mut socket = tokio::net::TcpStream::connect(door.address).await.unwrap();
    let request =
        format!("GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n{headers}\r\n", door.address);
    socket.write_all(request.as_bytes()).await.unwrap();
    let mut answer = Vec::new();
    socket.read_to_end(&mut answer).await.unwrap();
    let end = answer.windows(4).position(|window| window == b"\r\n\r\n").unwrap();
    let body = answer.split_off(end + 4);
    (String::from_utf8(answer).unwrap().to_lowercase(), body)
}

#[tokio::test]
async fn the_page_and_its_files_are_compressed_for_clients_that_accept_it() {
    let door = Door::open(None).await;
    let (mut plain, mut packed) = (0, 0);
    for path in [
        "/",
        "/?view=wall",
        "/page/main.js",
        "/page/uPlot.js",
        "/page/page.css",
        "/page/icon.svg",
        "/openapi.json",
    ] {
        let (head, text) = bytes(&door, path, "").await;
        assert!(!head.contains("content-encoding") && head.contains("vary: accept-encoding"), "{head}");
        for _ in 0..2 {
            let (head, body) = bytes(&door, path, "Accept-Encoding: gzip, deflate, br\r\n").await;
            assert!(
                head.starts_with("http/1.1 200") && head.contains("\r\ncontent-encoding: gzip\r\n"),
                "{head}"
            );
            assert!(head.contains("\r\nvary: accept-encoding\r\n"), "{head}");
            assert!(head.contains(&format!("\r\ncontent-length: {}\r\n", body.len())), "{head}");
            let mut read = Vec::new();
            GzDecoder::new(&*body).read_to_end(&mut read).unwrap();
            assert_eq!(read, text, "{path}");
            packed += body.len();
        }
        let (head, _) = bytes(&door, path, "Accept-Encoding: gzip;q=0, *\r\n").await;
        assert!(!head.contains("content-encoding"), "{head}");
        plain += 2 * text.len();
    }
    assert!(packed < plain / 2, "{packed} of {plain} bytes");
    // Figures and streams are sent as they are.
    for path in ["/api/status", "/metrics"] {
        let (head, _) = bytes(&door, path, "Accept-Encoding: gzip\r\n").await;
        assert!(!head.contains("content-encoding"), "{head}");
    }
}

#[tokio::test]
async fn the_description_of_the_api_requires_what_reading_requires() {
    let door = Door::open(Some(OPERATOR)).await;
    assert_eq!(door.get("/openapi.json").await.code, 401);
    let viewer = format!("Bearer {VIEWER}");
    let reply = door.send("GET", "/openapi.json", &[("Authorization", viewer.as_str())], "").await;
    assert_eq!((reply.code, reply.header("content-type")), (200, "application/json"));
    let document: serde_json::Value = serde_json::from_str(&reply.body).unwrap();
    assert_eq!(document["openapi"], "3.1.0");
}

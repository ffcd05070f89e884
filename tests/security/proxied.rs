//! The page behind a proxy: nginx with the configuration of the manual, and headers that only a trusted proxy may send.

use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::path::Path;
use std::process::Command;

use crate::certificates::Authority;
use crate::https::{Secured, secured};
use crate::process::{Running, file, free_port, until};
use crate::site::{BOTH, OPERATOR, Reply, Site, VIEWER, bearer, connected};
use crate::who::arms_in_a_browser;

/// Profile line that trusts a proxy on this computer.
const TRUSTS: &str = "trusted_proxies = [\"127.0.0.1\"]\n";
/// Address of a client of the proxy.
const CLIENT: IpAddr = IpAddr::V4(Ipv4Addr::new(127, 0, 0, 2));

/// nginx as a separate process, with the configuration of the manual.
struct Nginx {
    address: SocketAddr,
    authority: Authority,
    _running: Running,
    _home: tempfile::TempDir,
}

impl Nginx {
    /// Starts nginx in front of a gateway.
    fn before(gateway: SocketAddr) -> Nginx {
        let (home, authority) = (tempfile::tempdir().unwrap(), Authority::new());
        let address = SocketAddr::from(([127, 0, 0, 1], free_port()));
        let signed = authority.signs("127.0.0.1", (2020, 2090));
        let [cert, key] = [("gw7.pem", &signed.cert), ("gw7.key", &signed.key)]
            .map(|(name, text)| file(home.path(), name, text).display().to_string());
        let mut server = of_the_manual();
        for (theirs, ours) in [
            ("listen              443 ssl;", format!("listen {address} ssl;")),
            ("/etc/nginx/gw7.pem", cert),
            ("/etc/nginx/gw7.key", key),
            ("http://127.0.0.1:8080/", format!("http://{gateway}/")),
        ] {
            assert_eq!(server.matches(theirs).count(), 1, "{theirs} in {server}");
            server = server.replace(theirs, &ours);
        }
        let at = home.path().display();
        let temporary: String = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"]
            .map(|kind| format!("{kind}_temp_path {at}/{kind};\n"))
            .concat();
        let text = format!(
            "daemon off;\nmaster_process off;\npid {at}/pid;\nerror_log stderr warn;\nevents {{}}\n\
             http {{\naccess_log off;\n{temporary}{server}}}\n"
        );
        let configuration = file(home.path(), "nginx.conf", &text);
        let found = ["/usr/sbin/nginx", "/usr/local/sbin/nginx", "/usr/bin/nginx"];
        let program = found.iter().find(|path| Path::new(path).exists());
        let program = program.expect("nginx is not installed: `tests/run security` does it");
        let mut running =
            Running::start(Command::new(program).args(["-e", "stderr", "-c"]).arg(&configuration));
        until("nginx listens", || {
            let tried = TcpStream::connect(address).map(drop);
            tried.map_err(|error| format!("{error}: {}", running.so_far().join("\n")))
        });
        Nginx { address, authority, _running: running, _home: home }
    }

    /// TLS connection from the client.
    fn connect(&self) -> Secured {
        secured(&self.authority.cert, connected(CLIENT, self.address))
    }

    fn send(&self, method: &str, path: &str, headers: &str, body: &str) -> Reply {
        let (mut stream, length) = (self.connect(), body.len());
        let head = format!("{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n", self.address);
        let request = format!("{head}{headers}Content-Length: {length}\r\n\r\n{body}");
        stream.write_all(request.as_bytes()).unwrap();
        let mut text = Vec::new();
        // nginx may close the connection without a last message of TLS.
        match stream.read_to_end(&mut text) {
            Err(error) if error.kind() != ErrorKind::UnexpectedEof => panic!("{method} {path}: {error}"),
            _ => Reply::parse(&String::from_utf8(text).unwrap()),
        }
    }
}

/// Server block of the manual.
fn of_the_manual() -> String {
    let chapter = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/proxy.md");
    let text = std::fs::read_to_string(chapter).unwrap();
    let (_, rest) = text.split_once("\n```nginx\n").expect("docs/proxy.md has no configuration of nginx");
    rest.split("\n```").next().unwrap().to_owned() + "\n"
}

#[test]
fn behind_nginx_that_ends_tls_the_page_is_below_a_path_and_its_client_is_known() {
    let site = Site::with(&format!("{BOTH}{TRUSTS}"));
    site.is_known();
    let nginx = Nginx::before(site.address);
    let moved = nginx.send("GET", "/grinder-3", "", "");
    assert!(moved.code == 301 && moved.header("location").ends_with("/grinder-3/"), "{moved:?}");

    // Without a token, a person gets the sign-in page, whose addresses are right below the path.
    let html = "Accept: text/html\r\n";
    for (path, form) in
        [("/grinder-3/", "action=\"login\""), ("/grinder-3/api/status", "action=\"../login\"")]
    {
        let page = nginx.send("GET", path, html, "");
        assert!(page.code == 401 && page.body.contains(form), "{path}: {page:?}");
        assert!(!page.body.contains("\"/"), "an address is not relative: {}", page.body);
    }
    assert_eq!(nginx.send("GET", "/grinder-3/page/login.css", "", "").code, 200);

    let origin = format!("Origin: https://{}\r\n", nginx.address);
    let form = format!("token={OPERATOR}");
    let entered = nginx.send("POST", "/grinder-3/login", &origin, &form);
    assert_eq!((entered.code, entered.header("location")), (303, "./"), "{entered:?}");
    let (cookie, attributes) = entered.header("set-cookie").split_once("; ").unwrap();
    assert!(cookie.starts_with(&format!("__Secure-isotherm_visit_{}=", site.address.port())), "{cookie}");
    assert_eq!(attributes, "Path=/grinder-3/; HttpOnly; SameSite=Strict; Secure");

    let visit = format!("Cookie: {cookie}\r\n");
    let page = nginx.send("GET", "/grinder-3/", &visit, "");
    assert!(page.code == 200 && page.body.contains("data-may=\"true\""), "{page:?}");
    for (origin, code) in [
        (origin.clone(), 200),
        (origin.replace("https", "http"), 403),
        ("Origin: https://evil.example\r\n".to_owned(), 403),
    ] {
        let reply = nginx.send("POST", "/grinder-3/api/arm", &format!("{visit}{origin}"), "");
        assert_eq!(reply.code, code, "{origin}: {reply:?}");
    }
    // Forged headers of the client are removed by the proxy.
    let forged = "X-Forwarded-For: 192.0.2.66\r\nForwarded: for=192.0.2.66;proto=http\r\n";
    let reply = nginx.send("GET", "/grinder-3/api/status", &format!("{visit}{forged}"), "");
    assert_eq!(reply.code, 200, "{reply:?}");
    let events = site.verb(&["events", "--json"]).1;
    assert!(events.contains("127.0.0.2") && !events.contains("192.0.2.66"), "{events}");
    let out = nginx.send("POST", "/grinder-3/api/logout", &format!("{visit}{origin}{html}"), "");
    assert_eq!((out.code, out.header("location")), (303, "../"), "{out:?}");
    assert_eq!(nginx.send("GET", "/grinder-3/api/status", &visit, "").code, 401);
}

/// A proxy that collects the answer would pass on nothing until the stream ends.
#[test]
fn the_live_stream_comes_through_nginx_piece_by_piece() {
    let site = Site::with(&format!("{BOTH}{TRUSTS}"));
    let nginx = Nginx::before(site.address);
    let mut stream = nginx.connect();
    let head = format!("GET /grinder-3/api/live HTTP/1.1\r\nHost: {}\r\n", nginx.address);
    stream.write_all(format!("{head}{}\r\n", bearer(VIEWER)).as_bytes()).unwrap();
    let (mut text, mut piece) = (Vec::new(), [0; 4096]);
    let events = |text: &[u8]| String::from_utf8_lossy(text).matches("event: status").count();
    while events(&text) < 3 {
        let count = stream.read(&mut piece).unwrap();
        assert_ne!(count, 0, "the stream has ended: {}", String::from_utf8_lossy(&text));
        text.extend_from_slice(&piece[..count]);
    }
}

#[test]
fn a_person_signs_in_behind_nginx_and_the_page_is_live_in_a_real_browser() {
    let site = Site::with(&format!("{BOTH}{TRUSTS}"));
    site.is_known();
    let nginx = Nginx::before(site.address);
    let all_below =
        "eval:performance.getEntriesByType('resource').every(({ name }) => name.includes('/grinder-3/'))";
    arms_in_a_browser(&format!("https://{}/grinder-3/", nginx.address), &["any-certificate"], &[all_below]);
    assert_eq!(site.status()["axes"][0]["armed"], true);
}

#[test]
fn only_a_trusted_proxy_names_its_clients_and_none_of_them_is_local() {
    let site = Site::with(&format!("{BOTH}{TRUSTS}"));
    let of = |client: &str| format!("X-Forwarded-For: {client}\r\n");
    let wrong = bearer("guessed-by-somebody-who-tries");
    // Wrong tokens of one client of the proxy block this client only.
    let codes = [401, 401, 401, 401, 401, 429];
    for code in codes {
        assert_eq!(site.get("/api/status", &format!("{}{wrong}", of("192.0.2.7"))).code, code);
    }
    let right = bearer(OPERATOR);
    assert_eq!(site.get("/api/status", &format!("{}{right}", of("192.0.2.7"))).code, 429);
    assert_eq!(site.get("/api/status", &format!("{}{right}", of("192.0.2.8"))).code, 200);
    assert_eq!(site.get("/api/status", &format!("{}{right}", of("192.0.2.7, 192.0.2.8"))).code, 200);
    // From another address the header counts for nothing: all clients are one.
    for (attempt, code) in codes.into_iter().enumerate() {
        let headers = format!("{}{wrong}", of(&format!("192.0.2.{}", 20 + attempt)));
        assert_eq!(site.send_from("127.0.0.2", "GET", "/api/status", &headers, "").code, code, "{attempt}");
    }
    let differ = format!("{}Forwarded: for=127.0.0.1\r\n", of("192.0.2.8"));
    assert_eq!(site.get("/api/status", &format!("{differ}{right}")).code, 400);
    // The open quote would make the entry of the proxy a part of the client's text.
    let open = "Forwarded: for=192.0.2.8;by=\", for=192.0.2.7\r\n";
    assert_eq!(site.get("/api/status", &format!("{open}{right}")).code, 400);
}

#[test]
fn a_request_from_a_trusted_proxy_needs_a_token_even_without_a_header() {
    // Without `trusted_proxies`, these two lines let everyone on this computer command.
    let site = Site::with(&format!("{BOTH}commands = \"local\"\n{TRUSTS}"));
    for headers in ["", "X-Forwarded-For: 127.0.0.1\r\n", "Forwarded: for=127.0.0.1\r\n"] {
        assert_eq!(site.get("/api/status", headers).code, 401, "{headers}");
        assert_eq!(site.post("/api/arm", headers).code, 401, "{headers}");
    }
    assert_eq!(site.send_from("127.0.0.2", "GET", "/api/status", "", "").code, 200, "this one is no proxy");
    let live = site.get("/healthz", "");
    assert_eq!(live.code, 200);
}

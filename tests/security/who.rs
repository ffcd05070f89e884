//! Permissions for viewing and for commands.

use std::os::unix::fs::PermissionsExt;

use crate::process::{Running, isotherm, until};
use crate::site::{BOTH, OPERATOR, SCRAPER, SCRAPES, Site, VIEWER, bearer};

/// All requests that change something.
const COMMANDS: [(&str, &str, &str); 12] = [
    ("POST", "/api/arm", ""),
    ("POST", "/api/disarm", ""),
    ("POST", "/api/zero", ""),
    ("POST", "/api/cancel", ""),
    ("POST", "/api/sign", ""),
    ("POST", "/api/sign-plus", ""),
    ("POST", "/api/sign-minus", ""),
    ("POST", "/api/sign-none", ""),
    ("POST", "/api/acknowledge", ""),
    ("POST", "/api/axes/z/measured", r#"{"error_um":1}"#),
    ("DELETE", "/api/axes/z/measured", ""),
    ("POST", "/api/arm?axis=z", ""),
];

#[test]
fn without_a_token_nobody_commands_over_http_and_the_page_says_how_to_make_one() {
    let site = Site::with("");
    for (method, path, body) in COMMANDS {
        let reply = site.send(method, path, "", body);
        assert_eq!(reply.code, 403, "{path}: {reply:?}");
        let said = reply.json();
        assert_eq!(said["done"], false);
        assert!(said["answer"].as_str().unwrap().contains("isotherm token --out"), "{said}");
    }
    let page = site.get("/", "Accept: text/html\r\n").body;
    for words in [
        "data-may=\"false\"",
        "isotherm token --out /etc/isotherm/operator.token",
        "token_file = &quot;/etc/isotherm/operator.token&quot;",
    ] {
        assert!(page.contains(words), "{words} in {page}");
    }
    assert_eq!(site.get("/api/status", "").code, 200, "to look is open on loopback");
    site.is_known();
    let (code, said) = site.verb(&["arm"]);
    assert_eq!((code, said.contains("armed")), (0, true), "{said}");
}

#[test]
fn what_a_proxy_has_sent_on_is_never_local() {
    let site = Site::with("commands = \"local\"\n");
    site.is_known();
    for header in [
        "Forwarded: for=192.0.2.7\r\n",
        "X-Forwarded-For: 127.0.0.1\r\n",
        "x-forwarded-for:\r\n",
        "X-Forwarded-Host: localhost\r\n",
        "X-Real-IP: 127.0.0.1\r\n",
        "Via: 1.1 proxy\r\n",
    ] {
        for (method, path, body) in COMMANDS {
            assert_eq!(site.send(method, path, header, body).code, 403, "{header} {path}");
        }
        assert_eq!(site.get("/api/status", header).code, 403, "{header}");
        assert_eq!(site.get("/healthz", header).code, 200);
    }
    // A request of a proxy that sends no header of its own.
    for (request, code) in [("GET /api/status", "403"), ("POST /api/arm", "403"), ("GET /healthz", "200")] {
        let mut line = site.connect("127.0.0.1");
        let text = format!("{request} HTTP/1.0\r\nHost: {}\r\nContent-Length: 0\r\n\r\n", site.address);
        std::io::Write::write_all(&mut line, text.as_bytes()).unwrap();
        let mut answer = String::new();
        std::io::Read::read_to_string(&mut line, &mut answer).unwrap();
        assert_eq!(answer.split(' ').nth(1), Some(code), "{request}: {answer}");
    }
    assert_eq!(site.status()["axes"][0]["armed"], false);
    assert_eq!(site.post("/api/arm", "").code, 200);
    let (_, warned) = site.verb(&["status"]);
    let checked = isotherm(site.home.path()).arg("check").arg(&site.profile).output().unwrap();
    let said = String::from_utf8(checked.stderr).unwrap();
    for words in ["every user of this computer can arm the axes", "ssh -L"] {
        assert!(said.contains(words), "{said} {warned}");
    }
}

#[test]
fn whoever_has_the_viewers_token_looks_at_everything_and_commands_nothing() {
    let site = Site::with(BOTH);
    site.is_known();
    let (looks, commands) = (bearer(VIEWER), bearer(OPERATOR));
    for path in ["/", "/page/main.js", "/api/status", "/api/events", "/metrics", "/?view=wall"] {
        assert_eq!(site.get(path, "").code, 401, "{path}");
        assert_eq!(site.get(path, &looks).code, 200, "{path}");
        assert_eq!(site.get(path, &commands).code, 200, "{path}");
    }
    for (method, path, body) in COMMANDS {
        let nobody = site.send(method, path, "", body);
        assert_eq!((nobody.code, nobody.json()["done"].as_bool()), (401, Some(false)), "{path}");
        let reply = site.send(method, path, &looks, body);
        let answer = reply.json()["answer"].as_str().unwrap().to_owned();
        assert!(reply.code == 403 && answer.contains("Commands require the operator's"), "{path} {reply:?}");
    }
    assert_eq!(site.status()["axes"][0]["armed"], false);
    let page = site.get("/", &looks).body;
    assert!(page.contains("data-may=\"false\"") && page.contains("href=\"login\""), "{page}");
    assert!(site.get("/", &commands).body.contains("data-may=\"true\""));
    assert_eq!(site.post("/api/arm", &commands).code, 200);
}

#[test]
fn whoever_has_the_scrapers_token_reads_the_metrics_and_nothing_else_not_even_by_signing_in() {
    let site = Site::with(&format!("{BOTH}{SCRAPES}"));
    site.is_known();
    let scrapes = bearer(SCRAPER);
    let metrics = site.get("/metrics", &scrapes);
    assert!(metrics.code == 200 && metrics.body.contains("isotherm_axis_cz_meters{"), "{metrics:?}");
    assert_eq!(site.get("/metrics", "").code, 401);
    for path in [
        "/",
        "/page/main.js",
        "/api/status",
        "/api/live",
        "/api/events",
        "/api/history",
        "/readyz",
        "/metrics/",
    ] {
        let refused = site.get(path, &scrapes);
        let answer = refused.json()["answer"].as_str().unwrap().to_owned();
        assert!(
            refused.code == 403 && answer.contains("only permits reading /metrics"),
            "{path} {refused:?}"
        );
    }
    for (method, path, body) in COMMANDS {
        assert_eq!(site.send(method, path, &scrapes, body).code, 403, "{path}");
    }
    assert_eq!(site.send("POST", "/metrics", &scrapes, "").code, 405, "no token changes that");
    let own = format!("Origin: http://{}\r\n", site.address);
    let entered = site.send("POST", "/login", &own, &format!("token={SCRAPER}"));
    assert_eq!((entered.code, entered.header("set-cookie")), (403, ""), "{entered:?}");
    assert_eq!(site.status()["axes"][0]["armed"], false);
    let counted = site.get("/metrics", &scrapes).body;
    let only = counted.lines().find(|line| line.contains("why=\"only-scrapes\"")).unwrap();
    assert!(only.rsplit(' ').next().unwrap().parse::<u32>().unwrap() >= 9, "{only}");

    // On other addresses, a scraper's token alone is sufficient for the page to listen. Viewing is not possible with
    // it.
    let site = Site::at("0.0.0.0", &format!("plain = true\n{SCRAPES}"), |text| text);
    assert_eq!((site.get("/metrics", &scrapes).code, site.get("/api/status", &scrapes).code), (200, 403));
    let from = elsewhere();
    for (headers, code) in [("", 401), (scrapes.as_str(), 200)] {
        assert_eq!(site.send_from(&from, "GET", "/metrics", headers, "").code, code, "{headers}");
    }
    assert_eq!(site.send_from(&from, "GET", "/api/status", &scrapes, "").code, 403);
    assert_eq!(site.send_from(&from, "GET", "/login", "", "").code, 303, "there is nothing to sign in with");
}

#[test]
fn beyond_this_computer_nobody_looks_without_a_token_not_even_from_here() {
    let site = Site::at("0.0.0.0", &format!("plain = true\n{BOTH}"), |text| text);
    let looks = bearer(VIEWER);
    for path in ["/", "/api/status", "/api/events", "/metrics"] {
        assert_eq!(site.get(path, "").code, 401, "{path}");
        assert_eq!(site.get(path, &looks).code, 200, "{path}");
    }
    assert_eq!(site.get("/healthz", "").code, 200);
    assert_eq!(site.post("/api/disarm", &looks).code, 403);
    assert_eq!(site.post("/api/disarm", &bearer(OPERATOR)).code, 200);
    let profile = std::fs::read_to_string(&site.profile).unwrap();
    for (without, words) in [("plain = true\n", "tls"), (BOTH, "token_file")] {
        let profile = crate::process::file(site.home.path(), "open.toml", &profile.replace(without, ""));
        let ended = isotherm(site.home.path()).arg("run").arg(&profile).output().unwrap();
        let said = String::from_utf8(ended.stderr).unwrap();
        assert!(ended.status.code().is_some_and(|code| code != 0) && said.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_stolen_visit_is_no_token_and_ends_when_its_token_does() {
    let site = Site::with(BOTH);
    site.is_known();
    let own = format!("Origin: http://{}\r\n", site.address);
    let sign_in = |token: &str| site.send("POST", "/login", &own, &format!("token={token}"));
    assert_eq!(
        site.send("POST", "/login", "Origin: http://evil.example\r\n", &format!("token={OPERATOR}")).code,
        403
    );
    let visit = |token: &str| {
        let entered = sign_in(token);
        assert_eq!((entered.code, entered.header("location")), (303, "./"), "{entered:?}");
        let (cookie, attributes) = entered.header("set-cookie").split_once("; ").unwrap();
        assert_eq!(attributes, "Path=/; HttpOnly; SameSite=Strict");
        let (name, key) = cookie.split_once('=').unwrap();
        assert_eq!(name, format!("isotherm_visit_{}", site.address.port()));
        assert!(key.len() == 32 && !entered.head.contains(token), "{}", entered.head);
        key.to_owned()
    };
    let (first, second, looks) = (visit(OPERATOR), visit(OPERATOR), visit(VIEWER));
    assert_ne!(first, second);
    let cookie = |key: &str| format!("Cookie: a=b; isotherm_visit_{}={key}\r\n{own}", site.address.port());
    assert_eq!(site.get("/api/status", &bearer(&first)).code, 401);
    assert_eq!(sign_in(&first).code, 401);
    assert_eq!(
        site.get(&format!("/?token={OPERATOR}"), "").code,
        401,
        "an address is kept in too many places"
    );
    assert_eq!(site.post("/api/arm", &cookie(&first)).code, 200);
    assert_eq!(
        site.post("/api/zero", &cookie(&first).replace(&own, "Origin: http://evil.example\r\n")).code,
        403
    );
    assert_eq!(site.get("/api/status", &cookie(&looks)).code, 200);
    assert_eq!(site.post("/api/zero", &cookie(&looks)).code, 403);
    let wrong = cookie(&first.chars().rev().collect::<String>());
    assert_eq!(site.get("/api/status", &wrong).code, 401);

    let gone = site.post("/api/logout", &cookie(&second));
    assert!(gone.code == 200 && gone.header("set-cookie").contains("Max-Age=0"), "{gone:?}");
    assert_eq!(site.get("/api/status", &cookie(&second)).code, 401);
    assert_eq!(site.get("/api/status", &cookie(&first)).code, 200, "the other one stays");
    let mut watched = site.connect("127.0.0.1");
    let request = format!(
        "GET /api/live HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n{}\r\n",
        site.address,
        cookie(&first)
    );
    std::io::Write::write_all(&mut watched, request.as_bytes()).unwrap();

    site.token("operator.token", "another-one-from-now-on");
    until("the old one is gone", || match site.get("/api/status", &cookie(&first)).code {
        401 => Ok(()),
        code => Err(code.to_string()),
    });
    assert_eq!(site.get("/api/status", &bearer("another-one-from-now-on")).code, 200);
    assert_eq!(site.get("/api/status", &cookie(&looks)).code, 200, "that of another role stays");
    let mut seen = String::new();
    std::io::Read::read_to_string(&mut watched, &mut seen).unwrap();
    assert!(seen.contains("event: status"), "and what it looked at has ended: {seen}");
    std::fs::remove_file(site.home.path().join("operator.token")).unwrap();
    until("nobody commands", || match site.post("/api/zero", &bearer("another-one-from-now-on")).code {
        401 | 429 => Ok(()),
        code => Err(code.to_string()),
    });
    until("what became of the token is in the events", || {
        let events = site.verb(&["events", "--json"]).1;
        assert!(!events.contains("another-one-from-now-on"), "{events}");
        let words = ["token-changed", "operator's token has changed", "token-gone", "does not exist: create"];
        if words.iter().all(|words| events.contains(words)) { Ok(()) } else { Err(events) }
    });
}

/// Address of this computer that is not loopback. A client at loopback counts as one address.
fn elsewhere() -> String {
    let socket = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
    // `connect` of a UDP socket sends nothing.
    socket
        .connect("198.51.100.1:9")
        .expect("a network: from this computer's own addresses nobody is elsewhere");
    socket.local_addr().unwrap().ip().to_string()
}

#[test]
fn a_hundred_thousand_wrong_tokens_are_a_few_lines_and_the_right_one_from_elsewhere_works_meanwhile() {
    let mut site = Site::at("0.0.0.0", &format!("plain = true\n{BOTH}"), |text| text);
    let elsewhere = elsewhere();
    let memory = || {
        let status = std::fs::read_to_string(format!("/proc/{}/status", site.gateway.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap().to_owned();
        line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap()
    };
    let before = memory();
    let wrong = bearer("guessed-by-somebody-who-tries");
    let mut worked = 0;
    let codes = site.floods(("GET", "/api/status", &wrong, ""), |sent| {
        if sent % 10_000 == 0 {
            let reply = site.send_from(&elsewhere, "GET", "/api/status", &bearer(OPERATOR), "");
            assert_eq!(reply.code, 200, "{reply:?}");
            worked += 1;
        }
        sent < 100_000
    });
    let wrong_ones = codes.iter().find(|(code, _)| *code == 401).unwrap().1;
    // Five wrong tokens each minute are checked, for every minute that the test took.
    assert!(wrong_ones <= 20 && codes.iter().map(|(_, count)| count).sum::<usize>() == 100_000, "{codes:?}");
    assert_eq!(worked, 11);
    let posted = site.floods(("POST", "/api/disarm", &wrong, ""), |sent| sent < 1000);
    assert_eq!(posted.iter().map(|(_, count)| count).sum::<usize>(), 1000, "{posted:?}");
    let closed = site.send_from("127.0.0.2", "GET", "/api/status", &bearer(OPERATOR), "");
    assert_eq!(closed.code, 429, "the right one from there is not looked at either");
    assert!((1..=60).contains(&closed.header("retry-after").parse::<u32>().unwrap()), "{closed:?}");
    assert!(closed.json()["answer"].as_str().unwrap().contains("isotherm arm"), "{closed:?}");
    assert_eq!(site.get("/healthz", "").code, 200);
    let metrics = site.send_from(&elsewhere, "GET", "/metrics", &bearer(VIEWER), "").body;
    let count = |why: &str| {
        let line = metrics.lines().find(|line| {
            line.starts_with("isotherm_refused_total") && line.contains(&format!("why=\"{why}\""))
        });
        line.unwrap().rsplit_once(' ').unwrap().1.parse::<usize>().unwrap()
    };
    assert_eq!(count("wrong-token") + count("too-many-wrong"), 101_001, "{metrics}");
    let grown = memory().saturating_sub(before);
    assert!(grown < 30_000, "{grown} kB more");
    let lines = site.gateway.so_far().iter().filter(|line| line.contains("wrong token")).count();
    assert!(lines <= 4, "{:#?}", site.gateway.said);
    let reported = site.verb(&["events", "--json"]).1;
    assert!(reported.contains("sign in") && reported.contains("127.0.0.1"), "{reported}");
    assert!(
        !reported.contains("disarm"),
        "each wrong token of a command has an event of its own: {reported}"
    );
}

#[test]
fn a_browser_gets_a_page_to_sign_in_and_a_program_an_answer_it_can_read() {
    let site = Site::with(BOTH);
    for (language, words) in
        [("en", "Sign in"), ("de", "Anmelden"), ("ja", "サインイン"), ("zh-CN", "登录"), ("fr", "Sign in")]
    {
        let page = site.get("/", &format!("Accept: text/html,*/*\r\nAccept-Language: {language}\r\n"));
        assert_eq!(page.code, 401);
        assert!(page.body.contains(words) && page.body.contains("type=\"password\""), "{}", page.body);
        // The name tells apart the gateways of a plant; nothing else of the machine is shown.
        assert_eq!(page.body.matches("walker").count(), 2, "title and heading: {}", page.body);
        assert!(page.header("content-security-policy").contains("form-action 'self'"), "{}", page.head);
    }
    for path in ["/page/login.css", "/page/icon.svg", "/login"] {
        assert_eq!(site.get(path, "").code, 200, "{path}");
    }
    let program = site.get("/metrics", "");
    assert_eq!((program.code, program.header("www-authenticate")), (401, "Bearer realm=\"isotherm\""));
    assert_eq!(program.json()["done"], false);
    let wrong = site.send("POST", "/login", "Accept: text/html\r\n", "token=a-token-that-is-none");
    assert!(wrong.code == 401 && wrong.body.contains("This is not a token of this gateway"), "{wrong:?}");
    assert_eq!(site.send("POST", "/login", "", &"x".repeat(5000)).code, 413);
    for _ in 0..4 {
        site.send("POST", "/login", "", "token=%00%ff");
    }
    let closed = site.send("POST", "/login", "Accept: text/html\r\n", &format!("token={OPERATOR}"));
    assert!(closed.code == 429 && closed.body.contains("Wait a minute"), "{closed:?}");
}

/// Signs in at the page, arms the axis and signs out, with chromium and python3 as in `tests/observe/page.rs`. `first`
/// are words for the browser, and `armed` those while the axis is armed.
pub(crate) fn arms_in_a_browser(page: &str, first: &[&str], armed: &[&str]) {
    let type_in = format!(
        "eval:(() => {{ const field = document.querySelector('input[name=token]'); if (field) {{ field.value = '{OPERATOR}'; \
         field.form.requestSubmit(); }} return document.querySelector('.buttons') !== null; }})()"
    );
    let may = "eval:document.querySelector('.buttons button').disabled === false";
    let is_out = "eval:document.querySelector('input[name=token]') !== null";
    let press = "eval:(document.querySelector('#question').open ? document.querySelector('#question-yes').click() : 0, \
                 document.body.innerText.includes('z: armed'))";
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let seen = std::process::Command::new("python3")
        .arg(look)
        .arg(page)
        .args(first)
        .args([&type_in, may, "click:Arm", press])
        .args(armed)
        .args(["click:Sign out", is_out])
        .output();
    let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let said = [seen.stdout, seen.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    assert!(seen.status.success(), "{said}\n(without chromium: `tests/run page`)");
}

#[test]
fn a_person_signs_in_commands_and_signs_out_in_a_real_browser() {
    let site = Site::with(BOTH);
    site.is_known();
    arms_in_a_browser(&format!("http://{}/", site.address), &[], &[]);
    assert_eq!(site.status()["axes"][0]["armed"], true);
}

#[test]
fn a_token_that_others_may_read_or_that_is_short_closes_the_page_and_the_machine_is_compensated() {
    let home = tempfile::tempdir().unwrap();
    let token = home.path().join("operator.token");
    let made = isotherm(home.path()).args(["token", "--out"]).arg(&token).output().unwrap();
    assert!(made.status.success() && made.stdout.is_empty());
    assert_eq!(std::fs::metadata(&token).unwrap().permissions().mode() & 0o777, 0o600);
    let again = isotherm(home.path()).args(["token", "--out"]).arg(&token).output().unwrap();
    assert_eq!(again.status.code(), Some(1), "one that is there is not touched");
    let site = Site::with("");
    // The device has another address, because a second gateway for the same registers would be rejected for that
    // reason.
    let profile = std::fs::read_to_string(&site.profile).unwrap().replace("127.0.0.1", "127.0.0.3");
    let profile = profile.replace("[web]\n", &format!("[web]\ntoken_file = \"{}\"\n", token.display()));
    let profile = crate::process::file(home.path(), "machine.toml", &profile);
    for (text, mode, why) in
        [("0123456789abcdef", 0o644, "chmod 600"), ("short", 0o600, "fewer than 16"), ("", 0o600, "is empty")]
    {
        std::fs::write(&token, text).unwrap();
        std::fs::set_permissions(&token, std::fs::Permissions::from_mode(mode)).unwrap();
        let checked = isotherm(home.path()).arg("check").arg(&profile).output().unwrap();
        let said = String::from_utf8(checked.stderr).unwrap();
        assert!(checked.status.success() && said.contains(why), "{said}");
    }
    let mut gateway = Running::start(isotherm(home.path()).arg("run").arg(&profile));
    gateway.receives("the web page on 127.0.0.3:0 is not served: the token file");
    assert!(!gateway.so_far().iter().any(|line| line.contains("page http://")), "{:#?}", gateway.said);
    std::fs::write(&token, OPERATOR).unwrap();
    gateway.receives("page http://127.0.0.3:");
}

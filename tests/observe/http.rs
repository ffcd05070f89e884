//! The gateway's door, over real sockets: what it shows, whom it lets in, and that it closes in time.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use crate::support::fake;

use std::net::IpAddr;
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::observe::http::Admission;
use isotherm::observe::status::Command;
use isotherm_core::compensation::MeasuredReport;
use isotherm_profile::Commands;
use tokio::time::timeout;

use fake::{Door, Reply, VIEWER, status};

const SECOND: Duration = Duration::from_secs(1);
/// Time that a stop takes on a busy computer if it waits for no peer. A silent peer would take ten seconds.
const SOON: Duration = Duration::from_secs(6);
pub(super) const OPERATOR: &str = "commands; \"and more\"";
const BEARER: &str = "Bearer commands; \"and more\"";

#[tokio::test]
async fn the_page_and_its_files_come_from_the_gateway_alone() {
    let door = Door::open(None).await;
    let page = door.get("/").await;
    assert_eq!(page.code, 200);
    assert!(page.header("content-security-policy").starts_with("default-src 'self'"));
    assert!(page.body.contains("Grinder &quot;3&quot; &lt;west&gt;"), "the name is escaped");
    assert!(page.body.contains("<h1>研削盤 &quot;3&quot;</h1>"), "and so is what people call it");
    assert!(!page.body.contains("http://") && !page.body.contains("https://"));
    assert!(!page.body.contains("style="), "the policy forbids inline style");
    let links = page.body.split(['"']).filter(|text| text.starts_with("page/")).collect::<Vec<_>>();
    assert!(links.len() >= 4);
    for link in links {
        let file = door.get(&format!("/{link}")).await;
        assert_eq!((file.code, file.header("x-content-type-options")), (200, "nosniff"), "{link}");
    }
    for module in [
        "words.js",
        "text.js",
        "states.js",
        "live.js",
        "axis.js",
        "past.js",
        "alarms.js",
        "uPlot.js",
        "probe.js",
        "tables.js",
        "chart.js",
        "events.js",
        "recent.js",
    ] {
        let file = door.get(&format!("/page/{module}")).await;
        assert_eq!(file.header("content-type"), "text/javascript; charset=utf-8", "{module}");
    }
    assert_eq!(door.get("/page/../Cargo.toml").await.code, 404);
    assert_eq!(door.get("/page/%2e%2e%2fCargo.toml").await.code, 404);
}

#[tokio::test]
async fn the_wall_has_no_buttons_and_says_no_more_than_is_read_from_three_metres() {
    let door = Door::open(None).await;
    let wall = door.get("/?view=wall").await;
    assert_eq!((wall.code, wall.body.contains("<button"), wall.body.contains("<table")), (200, false, false));
    assert!(wall.body.contains("page/wall.js") && !wall.body.contains("page/main.js"), "{}", wall.body);
    assert!(door.get("/?view=else").await.body.contains("<button"));
    let door = Door::open(Some(OPERATOR)).await;
    let refused = door.send("GET", "/?view=wall", &[("Accept", "text/html")], "").await;
    assert_eq!((refused.code, refused.body.contains("name=\"view\" value=\"wall\"")), (401, true));
    let looks = [("Accept", "text/html")];
    let entered = door.send("POST", "/login", &looks, &format!("view=wall&token={VIEWER}")).await;
    assert_eq!((entered.code, entered.header("location")), (303, "./?view=wall"));
}

#[tokio::test]
async fn signing_in_leads_to_the_page_of_devices_that_was_requested() {
    let door = Door::open(Some(OPERATOR)).await;
    let looks = [("Accept", "text/html")];
    let refused = door.send("GET", "/?page=2&view=wall", &looks, "").await;
    for field in ["name=\"view\" value=\"wall\"", "name=\"page\" value=\"2\""] {
        assert!(refused.body.contains(field), "{field} in {}", refused.body);
    }
    for (form, address) in [
        ("view=wall&page=2&", "./?view=wall&page=2"),
        ("page=3&", "./?page=3"),
        ("page=%2F%2Felsewhere.example&", "./"),
        ("page=0&", "./"),
    ] {
        let entered = door.send("POST", "/login", &looks, &format!("{form}token={VIEWER}")).await;
        assert_eq!((entered.code, entered.header("location")), (303, address), "{form}");
    }
}

#[tokio::test]
async fn the_page_speaks_the_profiles_language_else_the_browsers() {
    let door = Door::open(None).await;
    for (accepted, words) in [
        ("de-AT,de;q=0.9", ["<html lang=\"de\">", "Keine Sicherheitsfunktion"]),
        ("ja", ["<html lang=\"ja\">", "安全機能ではありません"]),
        ("zh-CN", ["<html lang=\"zh\">", "本网关不是安全功能"]),
        ("fr", ["<html lang=\"en\">", "Not a safety function"]),
    ] {
        let page = door.send("GET", "/", &[("Accept-Language", accepted)], "").await;
        words.into_iter().for_each(|word| assert!(page.body.contains(word), "{word} in {}", page.body));
        let wall = door.send("GET", "/?view=wall", &[("Accept-Language", accepted)], "").await;
        assert!(wall.body.contains(words[0]), "{}", wall.body);
    }
    let door = Door::open(None).await;
    door.change(|status| status.language = Some(isotherm_profile::Language::Zh));
    let page = door.send("GET", "/", &[("Accept-Language", "de")], "").await;
    assert!(page.body.contains("<html lang=\"zh\">"), "{}", page.body);
}

#[tokio::test]
async fn the_status_is_one_json_document() {
    let door = Door::open(None).await;
    let reply = door.get("/api/status").await;
    let status: serde_json::Value = serde_json::from_str(&reply.body).unwrap();
    assert_eq!(reply.header("content-type"), "application/json");
    assert_eq!(status["axes"][0]["cz_um"], 12.5);
    assert_eq!(status["axes"][0]["raw_um"], serde_json::Value::Null);
}

#[tokio::test]
async fn unknown_addresses_and_methods_are_refused_in_words() {
    let door = Door::open(None).await;
    let unknown = door.get("/nothing").await;
    assert_eq!((unknown.code, unknown.body.contains("The web page is at /")), (404, true));
    let method = door.send("DELETE", "/api/status", &[], "").await;
    assert_eq!((method.code, method.header("allow")), (405, "GET,HEAD"));
    assert_eq!(door.get("/api/arm").await.code, 405, "a link can not arm a machine");
    let head = door.send("HEAD", "/api/status", &[], "").await;
    assert_eq!((head.code, head.body.as_str()), (200, ""));
    assert_eq!(door.send("HEAD", "/api/live", &[], "").await.code, 200);
}

#[tokio::test]
async fn a_command_reaches_the_gateway_and_its_answer_comes_back() {
    let door = Door::open(None).await;
    let done = door.send("POST", "/api/arm", &[], "").await;
    assert_eq!((done.code, done.body.as_str()), (200, r#"{"done":true,"answer":"axis z armed"}"#));
    assert_eq!(door.send("POST", "/api/disarm", &[], "").await.code, 200);
    let refused = door.send("POST", "/api/zero", &[], "").await;
    assert_eq!((refused.code, refused.body.as_str()), (409, r#"{"done":false,"answer":"axis z moves"}"#));
    assert_eq!(door.commands(), [Command::Arm, Command::Disarm, Command::Zero]);
}

#[tokio::test]
async fn a_measured_error_reaches_the_gateway_and_what_is_none_is_refused_in_words() {
    let door = Door::open(None).await;
    let path = "/api/axes/z/measured";
    let done = door.send("POST", path, &[], r#"{ "error_um": -3.2 }"#).await;
    assert_eq!((done.code, done.body.as_str()), (200, r#"{"done":true,"answer":"z: as you say"}"#));
    assert_eq!(door.send("DELETE", path, &[], "").await.code, 200);
    let refused = door.send("POST", path, &[], r#"{"error_um":26}"#).await;
    assert_eq!((refused.code, refused.body.contains("not learned from")), (409, true));
    let named = r#"{"error_um":1.5,"time":"2026-01-31T13:00:00+01:00","id":"part-17/2"}"#;
    assert_eq!(door.send("POST", path, &[], named).await.code, 200);
    let named = MeasuredReport::new(1.5, Some("2026-01-31T12:00:00Z"), Some("part-17/2")).unwrap();
    let reports = [Some((-3.2).into()), None, Some(26.0.into()), Some(named)];
    assert_eq!(door.measured(), reports.map(|report| ("z".to_owned(), report)));
    for body in [
        "",
        "3.2",
        "{}",
        r#"{"error_um":"3.2"}"#,
        r#"{"error_mm":3}"#,
        r#"{"error_um":1e999}"#,
        r#"{"error_um":NaN}"#,
        r#"{"error_um":1,"id":17}"#,
        r#"{"error_um":1,"id":"two words"}"#,
        r#"{"error_um":1,"time":"2026-01-31T12:00:00"}"#,
    ] {
        let reply = door.send("POST", path, &[], body).await;
        assert_eq!((reply.code, reply.body.contains("error_um")), (400, true), "{body}: {}", reply.body);
    }
    let strange = door.send("POST", "/api/axes/q/measured", &[], r#"{"error_um":1}"#).await;
    assert_eq!((strange.code, strange.body.as_str()), (404, "There is no axis q; the axes are z.\n"));
    assert_eq!(door.send("POST", path, &[], &"x".repeat(2000)).await.code, 413);
    assert_eq!(door.get(path).await.code, 405);
    assert_eq!(door.measured().len(), 4);
}

#[tokio::test]
async fn a_measured_error_is_a_command_and_wants_what_commands_want() {
    let path = "/api/axes/z/measured";
    let door = Door::open(Some(OPERATOR)).await;
    for (method, body) in [("POST", r#"{"error_um":1}"#), ("DELETE", "")] {
        assert_eq!(door.send(method, path, &[], body).await.code, 401, "{method}");
        let bearer = [("Authorization", BEARER)];
        assert_eq!(door.send(method, path, &bearer, body).await.code, 200, "{method}");
    }
    let door = Door::open(None).await;
    for (method, body) in [("POST", r#"{"error_um":1}"#), ("DELETE", "")] {
        let foreign = [("Origin", "http://evil.example")];
        assert_eq!(door.send(method, path, &foreign, body).await.code, 403, "{method}");
    }
    assert_eq!(door.measured().len(), 0);
}

#[tokio::test]
async fn a_long_body_is_refused_and_nothing_done() {
    let door = Door::open(None).await;
    let reply = door.send("POST", "/api/arm", &[], &"x".repeat(2000)).await;
    assert_eq!((reply.code, door.commands().len()), (413, 0));
}

/// A row a second from 10:00 on, for two hours.
pub(super) fn log(directory: &std::path::Path) -> std::path::PathBuf {
    let path = directory.join("m-2026-07-02.csv");
    let rows = (0..7200).map(|second| {
        let (hour, minute) = (10 + second / 3600, second / 60 % 60);
        let peak = if second == 5000 { 99.5 } else { 21.0 };
        format!("2026-07-02T{hour}:{minute:02}:{:02}Z,,{peak},off,,,-1.5,,off,\n", second % 60)
    });
    let header = "time,t1,t2,z_permit,z_from_um,z_raw_um,z_cz_um,z_model,z_state,z_acted\n";
    std::fs::write(&path, std::iter::once(header.to_owned()).chain(rows).collect::<String>()).unwrap();
    path
}

#[tokio::test]
async fn what_was_comes_from_the_logs_in_few_points_with_every_peak() {
    let home = tempfile::tempdir().unwrap();
    let door = Door::open(None).await;
    assert_eq!(door.get("/api/history").await.code, 404, "nothing is kept");
    door.keeps(vec![log(home.path())]);
    let reply = door.get("/api/history?from=2h&columns=t2,z_cz_um&points=100").await;
    assert_eq!(reply.code, 200, "{}", reply.body);
    let found: serde_json::Value = serde_json::from_str(&reply.body).unwrap();
    let values = |place: usize, key: &str| found["columns"][place][key].as_array().unwrap().clone();
    assert_eq!((found["rows"].as_u64(), found["time"].as_array().unwrap().len()), (Some(7200), 100));
    let peaks = values(0, "max").iter().filter(|value| **value == 99.5).count();
    assert_eq!((peaks, values(0, "min").iter().all(|value| *value == 21.0)), (1, true));
    assert_eq!((values(1, "min")[0].as_f64(), &found["columns"][1]["unit"]), (Some(-1.5), &"um".into()));
    let all: serde_json::Value = serde_json::from_str(&door.get("/api/history").await.body).unwrap();
    let names = all["columns"].as_array().unwrap().iter().map(|column| column["name"].as_str().unwrap());
    assert_eq!(names.collect::<Vec<_>>(), ["z_cz_um", "z_raw_um", "t1", "t2", "t3"]);
}

#[tokio::test]
async fn a_span_that_is_none_is_refused_in_words() {
    let door = Door::open(None).await;
    door.keeps(Vec::new());
    for (query, word) in [
        ("from=yesterday", "from: `yesterday` is not a time"),
        ("from=1h&to=2h", "ends before it begins"),
        ("columns=t9", "no column t9; the columns are z_cz_um, z_raw_um, t1"),
        ("columns=", "no column ;"),
        ("points=1", "2 to 4000"),
        ("points=9999999", "2 to 4000"),
        ("points=x", "2 to 4000"),
    ] {
        let reply = door.get(&format!("/api/history?{query}")).await;
        assert_eq!((reply.code, reply.body.contains(word)), (400, true), "{query}: {}", reply.body);
    }
    let nothing = door.get("/api/history").await;
    assert_eq!((nothing.code, nothing.body.contains(r#""time":[]"#)), (200, true), "{}", nothing.body);
    let door = Door::open(Some(OPERATOR)).await;
    assert_eq!(door.get("/api/history").await.code, 401);
    assert_eq!(door.get("/api/history.csv").await.code, 401);
}

#[tokio::test]
async fn the_same_span_is_downloaded_as_rows() {
    let home = tempfile::tempdir().unwrap();
    let door = Door::open(None).await;
    door.keeps(vec![log(home.path())]);
    let query = "from=2026-07-02T10:59:58Z&to=2026-07-02T11:00:00Z&columns=t2,z_cz_um";
    let reply = door.get(&format!("/api/history.csv?{query}")).await;
    assert_eq!(reply.header("content-type"), "text/csv; charset=utf-8");
    assert!(
        reply.header("content-disposition").starts_with("attachment; filename=\"Grinder__3_"),
        "{:?}",
        reply.header("content-disposition")
    );
    for line in ["time,t2,z_cz_um\n", "2026-07-02T10:59:58Z,21,-1.5\n", "2026-07-02T11:00:00Z,21,-1.5\n"] {
        assert!(reply.body.contains(line), "{line} in {}", reply.body);
    }
    assert_eq!(reply.body.matches("2026-07-02T").count(), 3);
}

/// Checks that a client that does not read its download keeps its turn while connected, and no longer.
#[tokio::test]
async fn few_read_at_once_and_who_has_gone_gives_his_turn_back() {
    let home = tempfile::tempdir().unwrap();
    let path = log(home.path());
    let rows = std::fs::read_to_string(&path).unwrap();
    let (header, rows) = rows.split_once('\n').unwrap();
    std::fs::write(&path, format!("{header}\n{}", rows.repeat(60))).unwrap();
    let door = Door::open(None).await;
    door.keeps(vec![path]);
    let query = "/api/history.csv?from=12h&to=2026-07-02T13:00:00Z";
    let mut idle = Vec::new();
    for _ in 0..2 {
        let mut line = door.connect().await;
        line.write(&format!("GET {query} HTTP/1.1\r\nHost: {}\r\n\r\n", door.address)).await;
        line.until("time,").await;
        idle.push(line);
    }
    let refused = door.get("/api/history?from=2h").await;
    assert_eq!((refused.code, refused.header("retry-after")), (503, "2"), "{}", refused.body);
    assert_eq!(door.get("/api/status").await.code, 200);
    drop(idle);
    for _ in 0..600 {
        tokio::time::sleep(SECOND / 10).await;
        if door.get("/api/history?from=2h").await.code == 200 {
            return;
        }
    }
    panic!("the turns never came back");
}

#[tokio::test]
async fn to_acknowledge_an_alarm_wants_what_commands_want() {
    let door = Door::open(Some(OPERATOR)).await;
    let bearer = [("Authorization", BEARER), ("isotherm-way", "page")];
    assert_eq!(door.send("POST", "/api/acknowledge?alarm=signal%20bed", &[], "").await.code, 401);
    assert_eq!(door.send("GET", "/api/acknowledge", &bearer, "").await.code, 405);
    let done = door.send("POST", "/api/acknowledge?alarm=signal%20bed", &bearer, "").await;
    assert_eq!((done.code, done.body.as_str()), (200, r#"{"done":true,"answer":"one alarm acknowledged"}"#));
    assert_eq!(door.send("POST", "/api/acknowledge?alarm=nothing", &bearer, "").await.code, 409);
    assert_eq!(
        door.askers()[1..],
        ["by 127.0.0.1 on the web page has seen signal bed", "by 127.0.0.1 on the web page has seen nothing"]
    );
    let door = Door::open(None).await;
    let foreign = [("Origin", "http://evil.example")];
    assert_eq!(door.send("POST", "/api/acknowledge", &foreign, "").await.code, 403);
}

#[tokio::test]
async fn without_a_token_a_foreign_page_can_not_command() {
    let door = Door::open(None).await;
    let own = format!("http://{}", door.address);
    for (headers, code) in [
        (vec![("Origin", own.as_str())], 200),
        (vec![("Origin", own.as_str()), ("Sec-Fetch-Site", "same-origin")], 200),
        (vec![("Origin", "http://evil.example")], 403),
        (vec![("Origin", "http://127.0.0.1:1")], 403),
        (vec![("Origin", "null")], 403),
        (vec![("Origin", "")], 403),
        (vec![("Sec-Fetch-Site", "cross-site")], 403),
    ] {
        let reply = door.send("POST", "/api/arm", &headers, "").await;
        assert_eq!(reply.code, code, "{headers:?}: {}", reply.body);
    }
    assert_eq!(door.commands().len(), 2);
}

#[tokio::test]
async fn without_a_token_only_its_own_names_are_answered() {
    let door = Door::open(None).await;
    let port = door.address.port();
    for (host, code) in [
        ("localhost".to_owned(), 200),
        (format!("LOCALHOST:{port}"), 200),
        ("127.0.0.1:9".to_owned(), 200),
        (format!("[::1]:{port}"), 200),
        (format!("evil.example:{port}"), 421),
        ("127.0.0.1.evil.example".to_owned(), 421),
        ("localhost.evil.example".to_owned(), 421),
        ("192.0.2.7".to_owned(), 421),
        (String::new(), 421),
    ] {
        for path in ["/api/status", "/", "/metrics"] {
            assert_eq!(door.send("GET", path, &[("Host", &host)], "").await.code, code, "{host} {path}");
        }
        let same = format!("http://{host}");
        let reply = door.send("POST", "/api/arm", &[("Host", &host), ("Origin", &same)], "").await;
        assert_eq!(reply.code, code, "{host}");
        assert_eq!(door.send("GET", "/healthz", &[("Host", &host)], "").await.code, 200);
    }
}

#[tokio::test]
async fn without_a_token_another_computer_may_neither_look_nor_command() {
    let Some(elsewhere) = own_address_that_is_not_loopback() else {
        eprintln!("this computer has no address but loopback: nothing to try");
        return;
    };
    let admission = Admission { commands: Commands::Local, ..Admission::default() };
    let door = Door::open_at("0.0.0.0:0", admission, tempfile::tempdir().unwrap()).await.seen_from(elsewhere);
    assert_eq!(door.get("/api/status").await.code, 403);
    let reply = door.send("POST", "/api/arm", &[], "").await;
    assert_eq!((reply.code, door.commands().len()), (403, 0));
    assert_eq!(door.send("GET", "/healthz", &[("Host", "gateway.example")], "").await.code, 200);
}

#[tokio::test]
async fn with_a_token_everything_but_health_asks_for_it() {
    let door = Door::open(Some(OPERATOR)).await;
    for path in ["/", "/page/main.js", "/api/status", "/api/live", "/metrics", "/readyz", "/nothing"] {
        let refused = door.get(path).await;
        assert_eq!(
            (refused.code, refused.header("www-authenticate")),
            (401, "Bearer realm=\"isotherm\""),
            "{path}"
        );
    }
    assert_eq!(door.get("/healthz").await.code, 200);
    assert_eq!(door.send("POST", "/api/arm", &[], "").await.code, 401);
    for (given, code) in [
        (BEARER, 200),
        ("bearer commands; \"and more\"", 200),
        ("Bearer commands; \"and more", 401),
        ("x", 401),
    ] {
        assert_eq!(
            door.send("GET", "/api/status", &[("Authorization", given)], "").await.code,
            code,
            "{given}"
        );
        assert_eq!(
            door.send("POST", "/api/arm", &[("Authorization", given)], "").await.code,
            code,
            "{given}"
        );
    }
    let by_name = [("Authorization", BEARER), ("Host", "gateway.example")];
    assert_eq!(door.send("GET", "/metrics", &by_name, "").await.code, 200, "the token stands for the name");
}

#[tokio::test]
async fn the_live_stream_tells_the_status_every_second_and_ends_with_the_gateway() {
    let mut door = Door::open(None).await;
    let mut stream = door.stream("/api/live").await;
    for _ in 0..3 {
        let event = timeout(60 * SECOND, stream.until("\n\n")).await.unwrap();
        let data = event.lines().find_map(|line| line.strip_prefix("data: ")).unwrap();
        assert!(event.contains("event: status"), "{event}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(data).unwrap()["axes"][0]["name"], "z");
    }
    door.change(|status| status.stopping = true);
    timeout(SOON, door.shut()).await.expect("stops at once").unwrap();
    let last = timeout(SOON, stream.rest()).await.expect("and the stream is at its end");
    assert!(last.contains(r#""stopping":true"#), "the last status says that it was stopped: {last}");
}

#[tokio::test]
async fn one_status_a_second_serves_every_reader_and_none_is_made_for_nobody() {
    let door = Door::open(None).await;
    assert_eq!(door.get("/healthz").await.code, 200);
    tokio::time::sleep(SECOND + SECOND / 2).await;
    assert_eq!(door.asked(), 0, "nobody listens");
    let clock = Clock::wall();
    let begun = clock.now();
    let mut streams = Vec::new();
    for _ in 0..10 {
        streams.push(door.stream("/api/live").await);
    }
    // On a busy computer that takes longer than two seconds.
    while door.asked() < 12 && clock.now().since(begun) < 60 * SECOND {
        tokio::time::sleep(SECOND / 10).await;
    }
    let (asked, seconds) = (door.asked(), clock.now().since(begun).as_secs());
    let most = 11 + usize::try_from(seconds).unwrap();
    assert!((12..=most).contains(&asked), "one for each at once, then one a second: {asked} in {seconds} s");
    drop(streams);
}

#[tokio::test]
async fn a_peer_that_never_finishes_its_request_does_not_keep_it_from_stopping() {
    let mut door = Door::open(None).await;
    let _silent = door.connect().await;
    let mut half = door.connect().await;
    half.write("POST /api/arm HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\n\r\nx").await;
    tokio::time::sleep(Duration::from_millis(50)).await;
    timeout(SOON, door.shut()).await.expect("stops at once").unwrap();
}

#[tokio::test]
async fn ready_tells_what_is_missing() {
    let door = Door::open(None).await;
    let reply = door.get("/readyz").await;
    let missing: Vec<String> = serde_json::from_str(&reply.body).unwrap();
    assert_eq!(reply.code, 503);
    assert_eq!(
        missing,
        [
            "a device has not answered since the start, or an axis has not made a decision",
            "device rtd: lost: no answer in time",
            "axis z: holding: t1: stale",
        ]
    );
    door.change(|status| {
        status.ready = true;
        status.devices[0].state = "ok";
        status.axes[0].state = "degraded";
    });
    let reply = door.get("/readyz").await;
    assert_eq!((reply.code, reply.body.as_str()), (200, "[]"));
    assert_eq!(door.get("/healthz").await.body, "ok");
}

#[tokio::test]
async fn metrics_are_valid_and_leave_out_what_is_not_known() {
    let door = Door::open(None).await;
    let reply = door.get("/metrics").await;
    assert_eq!(reply.header("content-type"), "text/plain; version=0.0.4; charset=utf-8");
    let samples = fake::exposition(&reply.body);
    let machine = r#"machine="Grinder \"3\" <west>\n\\x""#;
    let expect = |name: &str, labels: &str, value: &str| {
        let wanted = format!("{name}{{{machine}{labels}}}");
        let found = samples.get(&wanted).unwrap_or_else(|| panic!("{wanted} in\n{}", reply.body));
        assert_eq!(found, value, "{wanted}");
    };
    expect("isotherm_build_info", r#",version="1.2.3""#, "1");
    expect("isotherm_axis_cz_meters", r#",axis="z""#, "0.0000125");
    expect("isotherm_axis_expected_meters", r#",axis="z""#, &(2.1_f64 / 1e6).to_string());
    expect("isotherm_axis_state", r#",axis="z",state="holding""#, "1");
    expect("isotherm_axis_state", r#",axis="z",state="active""#, "0");
    expect("isotherm_axis_armed", r#",axis="z""#, "1");
    expect("isotherm_axis_wanted", r#",axis="z""#, "1");
    expect("isotherm_probe_correction_meters", r#",axis="z""#, "-0.0000015");
    expect("isotherm_probe_residual_meters", r#",axis="z""#, "0.000003");
    expect("isotherm_probe_residual_rms_meters", r#",axis="z""#, "0.000003");
    expect("isotherm_probe_residuals", r#",axis="z""#, "1");
    expect("isotherm_probe_warn_meters", r#",axis="z""#, "0.000004");
    expect("isotherm_probe_worse", r#",axis="z""#, "0");
    expect("isotherm_probe_gain_change", r#",axis="z",model="a",signal="t1",term="0""#, "0.05");
    expect("isotherm_axis_warned", r#",axis="z""#, "1");
    expect("isotherm_axis_extrapolating", r#",axis="z""#, "0");
    expect("isotherm_axis_excess_ratio", r#",axis="z""#, "-0.2");
    expect("isotherm_guard_acting", r#",axis="z",stage="limit""#, "1");
    expect("isotherm_guard_acting", r#",axis="z",stage="round""#, "0");
    expect("isotherm_signal_value", r#",signal="t2",unit="degC""#, "21.25");
    expect("isotherm_signal_good", r#",signal="t1""#, "0");
    expect("isotherm_signal_age_seconds", r#",signal="t2""#, "0.5");
    expect("isotherm_device_up", r#",device="rtd",bus="cell""#, "0");
    expect("isotherm_device_requests_total", r#",device="rtd",bus="cell""#, "40");
    expect("isotherm_device_failures_total", r#",device="rtd",bus="cell",blame="timeout""#, "7");
    expect("isotherm_device_failures_total", r#",device="rtd",bus="cell",blame="link""#, "0");
    expect("isotherm_bus_connected", r#",bus="cell""#, "1");
    expect("isotherm_bus_cycles_total", r#",bus="cell""#, "31");
    expect("isotherm_bus_overruns_total", r#",bus="cell""#, "2");
    expect("isotherm_bus_jitter_seconds_bucket", r#",bus="cell",le="0.001""#, "20");
    expect("isotherm_bus_jitter_seconds_bucket", r#",bus="cell",le="0.005""#, "30");
    expect("isotherm_bus_jitter_seconds_bucket", r#",bus="cell",le="+Inf""#, "31");
    expect("isotherm_bus_jitter_seconds_count", r#",bus="cell""#, "31");
    expect("isotherm_output_value", r#",output="z_offset",axis="z",unit="µm""#, "12.5");
    expect("isotherm_output_verified", r#",output="z_offset",axis="z""#, "1");
    expect("isotherm_output_state", r#",output="z_offset",axis="z",state="verified""#, "1");
    expect("isotherm_output_state", r#",output="z_offset",axis="z",state="foreign""#, "0");
    expect("isotherm_alarms", r#",level="error",acknowledged="no""#, "0");
    expect("isotherm_output_writes_total", r#",output="z_offset",axis="z""#, "9");
    expect("isotherm_log_dropped_total", "", "3");
    expect("isotherm_refused_total", r#",why="wrong-token""#, "0");
    expect("isotherm_events_total", r#",kind="signal-bad""#, "4");
    assert!(!reply.body.contains("isotherm_axis_raw_meters"), "the model gives nothing");
    assert!(!reply.body.contains("isotherm_axis_tripped{"), "the axis has no error level");
    assert!(!reply.body.contains(r#"isotherm_signal_value{machine="Grinder \"3\" <west>\n\\x",signal="t1""#));
    assert!(!reply.body.contains("NaN"));
}

#[tokio::test]
async fn many_readers_at_once_are_all_answered() {
    let door = Door::open(None).await;
    let mut streams = Vec::new();
    // As many as one address may have, but one.
    for _ in 0..15 {
        streams.push(door.stream("/api/live").await);
    }
    for stream in &mut streams {
        let first = timeout(60 * SECOND, stream.until("\n\n")).await.unwrap();
        assert!(first.contains("event: status"));
    }
    let Reply { code, body, .. } = door.get("/api/status").await;
    assert_eq!((code, body), (200, serde_json::to_string(&status()).unwrap()));
}

fn own_address_that_is_not_loopback() -> Option<IpAddr> {
    // Connecting a datagram socket sends nothing; it only chooses the address it would send from.
    let probe = std::net::UdpSocket::bind("0.0.0.0:0").ok()?;
    probe.connect("192.0.2.1:9").ok()?;
    Some(probe.local_addr().ok()?.ip()).filter(|ip| !ip.is_loopback() && !ip.is_unspecified())
}

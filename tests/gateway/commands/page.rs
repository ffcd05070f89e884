//! The page in a real browser while arming waits: what the operator sees and presses. Needs chromium and python3, as
//! `tests/observe/page.rs`.

use std::process::Command;

use crate::commands::bench::{Bench, OPEN_CIRCUIT};
use crate::commands::process::until;

#[test]
fn a_person_sees_what_arming_waits_for_takes_it_back_and_reads_what_happened_before_the_restart() {
    let mut bench = Bench::manual();
    bench.ask(&["disarm"]);
    bench.restart();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    bench.ask(&["arm", "--no-wait"]);
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let seen = Command::new("python3")
        .arg(look)
        .arg(format!("http://{}/", bench.page))
        .args([
            "writes nothing yet: bed has an open circuit",
            "over the command socket; expires in ",
            "stopped; ",
        ])
        .args([
            "click:Show the last 24 hours",
            "stopped; ",
            "click:Cancel",
            "the request to arm is cancelled",
        ])
        .args(["To do: arm the axis again", "cancelled by 127.0.0.1 on the web page"])
        .output();
    let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let said = [seen.stdout, seen.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
    assert!(seen.status.success(), "{said}\n(without chromium: `tests/run page`)");
    assert_eq!(bench.axis()["state"], "off");
    let command = bench.events(&[]).into_iter().rfind(|event| event["kind"] == "command").unwrap();
    assert_eq!(command["data"]["way"], "page");
}

#[test]
fn an_alarm_stands_until_its_end_and_that_somebody_has_seen_it_survives_the_page_and_changes_nothing() {
    let bench = Bench::manual();
    bench.device.asks(OPEN_CIRCUIT);
    bench.why("bed has an open circuit");
    let before = bench.axis();
    let look = |words: &[&str]| {
        let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
        let page = format!("http://{}/", bench.page);
        let seen = Command::new("python3").arg(look).arg(page).args(words).output();
        let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
        let said = [seen.stdout, seen.stderr].map(|said| String::from_utf8(said).unwrap()).concat();
        assert!(seen.status.success(), "{said}\n(without chromium: `tests/run page`)");
    };
    look(&[
        "Active alarms",
        "signal bed: open circuit",
        "click:Acknowledge",
        "seen at",
        "by 127.0.0.1 on the web page",
    ]);
    // Another page, and a program.
    let no_button = "eval:[...document.querySelectorAll('.alarms button')].every((button) => button.hidden)";
    look(&["signal bed: open circuit", "seen at", no_button]);
    let alarm = bench.status()["alarms"][0].clone();
    assert_eq!((&alarm["id"], &alarm["level"]), (&"signal bed".into(), &"warning".into()), "{alarm}");
    assert_eq!(alarm["acknowledged"]["by"], "by 127.0.0.1 on the web page");
    let command = bench.events(&[]).into_iter().rfind(|event| event["kind"] == "command").unwrap();
    assert_eq!(
        (&command["data"]["command"], &command["data"]["way"]),
        (&"acknowledge signal bed".into(), &"page".into())
    );
    for what in ["state", "armed", "cz_um", "why"] {
        assert_eq!(bench.axis()[what], before[what], "{what}");
    }
    let (code, body) = bench.http("POST", "/api/acknowledge?alarm=signal%20column", "");
    assert_eq!((code, body.contains("there is no such alarm")), (409, true), "{body}");
    bench.device.asks(200);
    let stand = |count: usize| {
        until("alarms", || {
            let alarms = bench.status()["alarms"].clone();
            (alarms.as_array().map(Vec::len) == Some(count)).then_some(()).ok_or(alarms.to_string())
        });
    };
    stand(0);
    bench.device.asks(OPEN_CIRCUIT);
    stand(1);
    assert_eq!(
        bench.status()["alarms"][0]["acknowledged"],
        serde_json::Value::Null,
        "a new one was not seen"
    );
}

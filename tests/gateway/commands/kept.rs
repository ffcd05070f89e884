//! Events are known after a restart, and changes of their file are reported.

use std::io::Write;

use crate::commands::bench::Bench;
use crate::commands::process::{isotherm, until};

#[test]
fn what_happened_before_a_restart_stands_in_the_verb_the_api_and_the_page() {
    let mut bench = Bench::manual();
    bench.ask(&["disarm"]);
    bench.restart();
    bench.ask(&["disarm"]);

    let kinds = |bench: &Bench| -> Vec<String> {
        bench.events(&[]).iter().map(|event| event["kind"].as_str().unwrap().to_owned()).collect()
    };
    until("all is kept", || {
        let kinds = kinds(&bench);
        let count = |wanted: &str| kinds.iter().filter(|kind| *kind == wanted).count();
        match ["started", "command", "stopping", "stopped"].map(count) {
            [2, 2, 1, 1] => Ok(()),
            _ => Err(format!("{kinds:?}")),
        }
    });
    let status = bench.status();
    let stopped = |events: &serde_json::Value| {
        events.as_array().unwrap().iter().filter(|event| event["kind"] == "stopped").count()
    };
    assert_eq!(stopped(&status["events"]), 1, "the page shows what was before");
    assert_eq!(status["event_counts"]["stopped"], serde_json::Value::Null, "and counts from the start");
    let (code, events) = bench.http("GET", "/api/events?since=1h", "");
    let events: serde_json::Value = serde_json::from_str(&events).unwrap();
    assert_eq!((code, stopped(&events["events"])), (200, 1));
    assert_eq!(events["damage"], serde_json::json!([]));
    let (code, _) = bench.http("GET", "/api/events?since=soon", "");
    assert_eq!(code, 400);

    assert!(bench.events(&["--since", "2099-01-01T00:00:00Z"]).is_empty());
    let (code, said) = bench.ask(&["events", "--since", "yesterday"]);
    assert_eq!((code, said.contains("write a duration such as 12h or a time")), (1, true), "{said}");
    // Without a profile, as text for an operator.
    let state = bench.home.path().join("state");
    let said = isotherm(bench.home.path()).args(["events", "--state"]).arg(&state).output().unwrap();
    let said = String::from_utf8(said.stdout).unwrap();
    assert!(said.contains("info     walker: the gateway runs"), "{said}");
    let empty = isotherm(bench.home.path()).arg("events").output().unwrap();
    assert!(!empty.status.success());
}

#[test]
fn a_line_that_somebody_changed_is_reported_and_the_gateway_goes_on_behind_half_a_line() {
    let mut bench = Bench::manual();
    bench.ask(&["disarm"]);
    bench.restart();
    until("the second start is kept", || match bench.reported("started").len() {
        2 => Ok(()),
        count => Err(count.to_string()),
    });
    bench.gateway.signal("KILL");
    bench.gateway.ends_within(crate::commands::process::PATIENCE);
    let state = bench.home.path().join("state");
    let is_of_events = |path: &std::path::Path| path.to_string_lossy().ends_with(".events.jsonl");
    let files = std::fs::read_dir(&state).unwrap().map(|entry| entry.unwrap().path());
    let path = files.filter(|path| is_of_events(path)).max().unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen("disarm", "disaRm", 1)).unwrap();
    let mut file = std::fs::OpenOptions::new().append(true).open(&path).unwrap();
    file.write_all(b"{\"n\":99,\"after\":\"00").unwrap();
    bench.restart_killed();
    let events = bench.events_and_warnings();
    assert!(events.contains("the line was changed: its checksum is wrong"), "{events}");
    assert!(events.contains("not an event: the line is cut or overwritten"), "{events}");
    assert_eq!(events.matches("\"kind\":\"started\"").count(), 3, "{events}");
}

#[test]
fn what_changed_in_a_template_since_the_last_run_is_told_once_and_by_check() {
    let mut bench = Bench::manual();
    let own = "title = \"a module\"\nsource = \"its manual\"\n[channel.tc]\nregister = \"input:1\"\ntype = \"i16\"\nscale = 0.1\n\
               unit = \"degC\"\n";
    let template = bench.home.path().join("devices/own.toml");
    std::fs::create_dir(template.parent().unwrap()).unwrap();
    std::fs::write(&template, own).unwrap();
    let text = std::fs::read_to_string(&bench.profile).unwrap();
    std::fs::write(&bench.profile, text.replacen("unit = 1\n", "unit = 1\ntemplate = \"own\"\n", 1)).unwrap();
    let state = bench.home.path().join("state");
    let kept = state.join("walker.templates.json");
    bench.restart();
    until("the template is kept", || kept.exists().then_some(()).ok_or_else(|| "it is not".to_owned()));
    std::fs::write(&template, own.replace("0.1", "0.01")).unwrap();

    let change = "template own has changed since the last run of this machine: channel.tc.scale: 0.1 → 0.01";
    let check = isotherm(bench.home.path())
        .arg("check")
        .arg(&bench.profile)
        .arg("--state")
        .arg(&state)
        .output()
        .unwrap();
    let said = String::from_utf8(check.stderr).unwrap();
    assert!(check.status.success() && said.contains(change), "{said}");
    bench.restart();
    until("it is reported", || match bench.reported("template-changed").len() {
        1 => Ok(()),
        count => Err(count.to_string()),
    });
    bench.restart();
    until("the fourth start is kept", || match bench.reported("started").len() {
        4 => Ok(()),
        count => Err(count.to_string()),
    });
    assert_eq!(bench.reported("template-changed").len(), 1, "once");
}

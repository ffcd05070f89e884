//! Effect and longest duration of a stop, as `check` reports them.

use isotherm_profile::OnStop;
use isotherm_profile::preview::Preview;

use super::{GRINDER, only_error, parse};

const FIRST: &str = "[machine]\n";

#[allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
fn stop_of(text: &str) -> (String, serde_json::Value) {
    let preview = Preview::of(&parse(text).unwrap().profile);
    let shown = preview.to_string();
    let line = shown.lines().skip_while(|line| *line != "stop").nth(1).unwrap().trim().to_owned();
    (line, serde_json::to_value(&preview).unwrap()["stop"].clone())
}

#[test]
fn check_says_how_long_a_stop_takes_at_most_and_how_much_a_late_write_adds() {
    // 40 µm at 0.5 µm/s, two steps of 2 s more; six timeouts of 300 ms, and 2 s at the end.
    let (line, json) = stop_of(GRINDER);
    let whole = "the fault actions run, without their waiting time: at most 1m 28s, and 30s more if a write \
                 without an answer may still arrive";
    assert_eq!(line, whole);
    assert_eq!(json, serde_json::json!({ "on_stop": "fault-action", "longest_s": 88, "late_s": 30 }));
}

#[test]
fn check_says_that_a_stop_with_hold_moves_nothing() {
    let text = GRINDER.replacen(FIRST, "[machine]\non_stop = \"hold\"\n", 1);
    assert_eq!(parse(&text).unwrap().profile.on_stop, OnStop::Hold);
    let (line, json) = stop_of(&text);
    assert_eq!(line, "the registers keep their values: at most 4s");
    assert_eq!(json, serde_json::json!({ "on_stop": "hold", "longest_s": 4, "late_s": null }));
}

#[test]
fn a_stop_that_nobody_knows_is_refused_with_the_words_that_there_are() {
    let text = GRINDER.replacen(FIRST, "[machine]\non_stop = \"holds\"\n", 1);
    let error = only_error(&text, "machine.on_stop", "\"holds\"").to_string();
    assert!(error.contains("did you mean `hold`?") && error.contains("fault-action"), "{error}");
}

#[test]
fn a_profile_of_another_version_is_refused_with_what_to_do() {
    let of = |version: &str| GRINDER.replacen(FIRST, &format!("[machine]\nversion = {version}\n"), 1);
    assert!(parse(&of("1")).is_ok());
    let error = only_error(&of("2"), "machine.version", "2").to_string();
    assert!(
        error.contains("this isotherm supports only version 1")
            && error.contains("install the isotherm version"),
        "{error}"
    );
    only_error(&of("\"1\""), "machine.version", "\"1\"");
}

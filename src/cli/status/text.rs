//! Status of the gateway as text for a terminal, in the order of the web page.

use std::fmt::Write as _;
use std::time::Duration;

use serde_json::Value;

use crate::cli::hints::{Hints, cause};
use crate::observe::events::found_worse;
use crate::observe::status::OutputStatus;
use isotherm_core::display::Display;
use isotherm_core::quantity::Micron;
use isotherm_profile::{Unit, labelled};
use isotherm_profile::{counted, duration_text};

/// Number of last events that are shown; `isotherm events` shows all.
const LAST_EVENTS: usize = 5;
/// Indentation of a hint below the line of its fault, in characters.
const UNDER: usize = 6;

pub(super) fn of(status: &Value) -> String {
    // The alarms come first, so the hints are at the alarms.
    let mut hints = Hints::default();
    let mut text = head(status, &mut hints);
    for (name, axis) in status["axes"].as_object().into_iter().flatten() {
        text += &axis_lines(name, axis, status["dry_run"] == true, &mut hints);
    }
    text += &rows("settings that override the profile", &status["overridden"], |one| {
        let profile = one["profile"].as_str().unwrap_or("nothing");
        let (key, now, from) = (word(&one["key"]), word(&one["now"]), word(&one["from"]));
        format!("  {key} = {now}, in the profile {profile}, from {from}\n")
    });
    text += &rows("signals", &status["signals"], |one| signal(one, &mut hints));
    text += &rows("outputs", &status["outputs"], |one| output(one, &hints));
    text += &rows("devices", &status["devices"], |one| device(one, &mut hints));
    let events = status["events"].as_array().map_or(&[][..], Vec::as_slice);
    let last = Value::Array(events[events.len().saturating_sub(LAST_EVENTS)..].to_vec());
    text + &rows("last events", &last, |event| {
        let hint = event["data"]["hint"].as_str();
        let line = format!("  {}  {}\n", moment(&event["at"]), cause(word(&event["text"]), hint));
        line + &hints.line(UNDER, hint)
    })
}

/// Returns the lines about the machine and its clock, whether the gateway is stopping or writes nothing, and the active
/// alarms.
fn head(status: &Value, hints: &mut Hints) -> String {
    let mut text = format!(
        "{} at {} UTC, clock {}, up for {}\n",
        labelled(word(&status["machine"]), word(&status["label"])),
        moment(&status["now"]),
        word(&status["clock"]),
        span(&status["uptime_s"])
    );
    if status["stopping"] == true {
        text += "the gateway is stopping, as requested\n";
    }
    if status["dry_run"] == true {
        text += "dry run: the gateway computes and shows values, and writes nothing\n";
    }
    let changed: Vec<&str> =
        status["profile_changed"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    if !changed.is_empty() {
        let files = changed.join(", ");
        text += &format!(
            "changed on disk since the start: {files}; `isotherm restart PROFILE --keep` loads the changed \
             files\n"
        );
    }
    text + &broker(&status["mqtt"]) + &rows("alarms", &status["alarms"], |one| alarm(one, hints))
}

/// Returns a line about publishing to the MQTT broker; empty if the profile has none.
fn broker(mqtt: &Value) -> String {
    if mqtt.is_null() {
        return String::new();
    }
    let goes = match (mqtt["connected"] == true, word(&mqtt["fault"])) {
        (true, _) => format!("connected, {} published", counted(&mqtt["published"], "message")),
        (false, "") => "not connected yet".to_owned(),
        (false, fault) => fault.to_owned(),
    };
    let waits = match (mqtt["queued"].as_u64(), mqtt["dropped"].as_u64()) {
        (Some(0), Some(0)) => String::new(),
        (queued, dropped) => format!(", {} queued, {} dropped", queued.unwrap_or(0), dropped.unwrap_or(0)),
    };
    let host = match (mqtt["connected"] == true, word(&mqtt["primary_host"])) {
        (false, _) | (true, "" | "online") => String::new(),
        (true, state) => format!(", waits for the primary host ({state})"),
    };
    let refused: Vec<&str> =
        mqtt["refused"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let refused = match refused.as_slice() {
        [] => String::new(),
        topics => format!(", refuses {}", topics.join(", ")),
    };
    format!("broker {}: {goes}{waits}{host}{refused}\n", word(&mqtt["broker"]))
}

fn alarm(alarm: &Value, hints: &mut Hints) -> String {
    let seen = match &alarm["acknowledged"] {
        Value::Null => String::new(),
        seen => format!(" (seen at {} {})", moment(&seen["at"]), word(&seen["by"])),
    };
    let hint = alarm["hint"].as_str();
    let line = format!("  {}  {}{seen}\n", moment(&alarm["since"]), cause(word(&alarm["text"]), hint));
    line + &hints.line(UNDER, hint)
}

fn axis_lines(name: &str, axis: &Value, dry_run: bool, hints: &mut Hints) -> String {
    let mut text = format!("\naxis {}: {}\n", labelled(name, word(&axis["label"])), word(&axis["display"]));
    // Writing to a string never fails.
    let why = word(&axis["cause"]);
    if !why.is_empty() {
        let _ = writeln!(text, "  {why}");
    }
    text += &hints.line(2, axis["hint"].as_str());
    if let waiting @ Value::Object(_) = &axis["waiting"] {
        let _ = writeln!(
            text,
            "  requested: {}; the request expires in {}",
            word(&waiting["asked"]),
            span(&waiting["expires_s"])
        );
    }
    if axis["has_model"] == false {
        return text;
    }
    let age = axis["verified_age_s"].as_f64().map_or(String::new(), |age| format!(", {age:.0} s ago"));
    let held = match (dry_run, axis["verified_um"].is_null()) {
        (true, _) => "nothing is written".to_owned(),
        (false, true) => "nothing verified yet".to_owned(),
        (false, false) => format!("{} verified{age}", micron(&axis["verified_um"])),
    };
    let unknown = match axis["shown"] == Display::Unreachable.name() {
        true => "; the control may hold another value now",
        false => "",
    };
    let limit = axis["limit_um"].as_f64().unwrap_or_default();
    let _ = writeln!(text, "  Cz {held}{unknown}; target {}, limit ±{limit} µm", micron(&axis["cz_um"]));
    if let Some(model) = axis["model"].as_str() {
        let acted: Vec<&str> =
            axis["acted"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let guard = if acted.is_empty() { String::new() } else { format!("; guard: {}", acted.join(", ")) };
        let expected = axis["expected_um"].as_f64();
        let touches = match axis["expected_touches"].as_u64() {
            None | Some(0) => String::new(),
            Some(touches) => format!(", touches: {touches}"),
        };
        let expected =
            expected.map_or(String::new(), |um| format!(", expected within ±{um:.1} µm (1 σ{touches})"));
        let _ = writeln!(text, "  model {model} requests {}{expected}{guard}", micron(&axis["raw_um"]));
    }
    if let outside @ Value::Object(_) = &axis["extrapolating"] {
        let _ = writeln!(text, "  {}", word(&outside["text"]));
    }
    let probed = &axis["probe"]["last"];
    if let Some(why) = probed["refused"].as_str() {
        let (at, error) = (moment(&probed["at"]), micron(&probed["error_um"]));
        let _ = writeln!(text, "  probed {error} at {at}, not used for the correction: {why}");
    }
    if let worse @ Value::Object(_) = &axis["probe"]["worse"] {
        let _ = writeln!(text, "  {}", worse_model(worse));
    }
    if let learned @ Value::Object(_) = &axis["learned"] {
        text += &learned_model(learned);
    }
    text
}

/// Returns lines about the learned model of an axis and its candidate.
fn learned_model(learned: &Value) -> String {
    let named = |name: &str| match name {
        "" => "the model of the profile".to_owned(),
        name => format!("model {name}"),
    };
    let mut text = String::new();
    if let Some(adopted) = learned["adopted"].as_str() {
        let _ = writeln!(text, "  follows the learned model {adopted}");
    }
    if let Some(waiting) = learned["waiting"].as_str() {
        let _ = writeln!(
            text,
            "  the change to {} waits until Cz can be kept, or for the next datum",
            named(waiting)
        );
    }
    let candidate = &learned["candidate"];
    let Some(model) = candidate["model"].as_str().filter(|model| learned["adopted"] != *model) else {
        return text;
    };
    let Some((in_use, left)) = candidate["in_use_um"].as_f64().zip(candidate["candidate_um"].as_f64()) else {
        let _ = writeln!(text, "  candidate {model}: not judged yet");
        return text;
    };
    let next = match (candidate["better"] == true, learned["auto"] == true) {
        (true, true) => "; it is adopted at the next datum",
        (true, false) => "; `isotherm adopt` adopts it",
        (false, _) => "",
    };
    let _ = writeln!(
        text,
        "  candidate {model}: since {}, it would have left a residual error of {left:.1} instead of \
         {in_use:.1} µm (days: {}, touches: {}){next}",
        word(&candidate["since"]),
        candidate["days"],
        candidate["touches"]
    );
    text
}

/// Returns a sentence that says since when a model is worse than no compensation, and how its axis reacts.
fn worse_model(worse: &Value) -> String {
    let left = |key: &str| worse[key].as_f64().and_then(Micron::new).unwrap_or_default();
    let touches = worse["touches"].as_u64().and_then(|count| usize::try_from(count).ok());
    let found = found_worse(touches.unwrap_or(0), left("with_um"), left("without_um"));
    let does = match worse["ramps"] == true {
        true => "Cz goes to zero until touches show that the model is better",
        false => "Cz still follows the model",
    };
    format!("{found}; {does}")
}

fn signal(signal: &Value, hints: &mut Hints) -> String {
    let unit = Unit::named(word(&signal["unit"])).map_or(String::new(), |unit| unit.to_string());
    let (value, unit) = match signal["value"].as_f64() {
        Some(value) if unit == "bool" => (if value > 0.0 { "on" } else { "off" }.to_owned(), ""),
        Some(value) => (format!("{value:.3}"), unit.as_str()),
        None => ("—".to_owned(), unit.as_str()),
    };
    let hint = signal["hint"].as_str();
    let quality = if signal["quality"] == "good" { "good" } else { cause(word(&signal["reason"]), hint) };
    let line = format!("  {:<16}{value:>12} {unit:<6} {quality}{}\n", word(&signal["name"]), aside(signal));
    line + &hints.line(UNDER, hint)
}

fn output(output: &Value, hints: &Hints) -> String {
    let unit = OutputStatus::unit_of(word(&output["writes"]));
    let decimals = if unit == "µm" { 1 } else { 4 };
    let value = output["value"].as_f64().map_or("—".to_owned(), |value| format!("{value:.decimals$}"));
    let notes = [&output["note"], &output["handshake"]].map(|note| hints.without(word(note)));
    let notes: String =
        notes.iter().filter(|note| !note.is_empty()).map(|note| format!(": {note}")).collect();
    let name = word(&output["name"]);
    let (state, device, register) =
        (word(&output["state"]), word(&output["device"]), word(&output["register"]));
    format!("  {name:<16}{value:>12} {unit:<6} {state}{notes}  ({device}, {register})\n")
}

fn device(device: &Value, hints: &mut Hints) -> String {
    let hint = device["hint"].as_str();
    let fault = cause(word(&device["fault"]), hint);
    let fault = if fault.is_empty() { String::new() } else { format!(": {fault}") };
    let line = format!("  {:<16}{}{fault}{}\n", word(&device["name"]), word(&device["state"]), aside(device));
    line + &hints.line(UNDER, hint)
}

/// Returns a heading and a line for each element; empty if there are no elements.
fn rows(heading: &str, of: &Value, row: impl FnMut(&Value) -> String) -> String {
    let rows: String = of.as_array().into_iter().flatten().map(row).collect();
    if rows.is_empty() { rows } else { format!("\n{heading}\n{rows}") }
}

pub(super) fn word(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

fn micron(value: &Value) -> String {
    value.as_f64().map_or("—".to_owned(), |value| format!("{value:+.1} µm"))
}

fn span(value: &Value) -> String {
    let span = Duration::try_from_secs_f64(value.as_f64().unwrap_or_default()).unwrap_or_default();
    duration_text(Duration::from_secs(span.as_secs()))
}

fn moment(value: &Value) -> String {
    word(value).get(..19).unwrap_or_default().replace('T', " ")
}

/// Returns the label of a signal, output or device in brackets; empty without a label. The label is at the end of the
/// line, because characters of some scripts are wider than others.
fn aside(what: &Value) -> String {
    match word(&what["label"]) {
        "" => String::new(),
        label => format!("  ({label})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn lines(axis: &Value) -> String {
        axis_lines("z", axis, false, &mut Hints::default())
    }

    #[test]
    fn a_hint_is_printed_once_below_the_first_line_that_needs_it() {
        let (why, hint) = ("no program listens at this port", "is the port right?");
        let joined = format!("{why}: {hint}");
        let signal = |name: &str| json!({ "name": name, "quality": "timeout", "reason": joined, "hint": hint, "unit": "degC" });
        let mut status = json!({
            "machine": "press", "label": "", "now": "2026-01-05T12:00:00Z", "clock": "synchronised", "uptime_s": 5.0,
            "alarms": [{ "since": "2026-01-05T12:00:00Z", "text": format!("device module: {joined}"), "hint": hint }],
            "axes": { "z": { "display": "frozen", "cause": why, "hint": hint, "has_model": false } },
            "signals": [signal("bed"), signal("column")],
            "devices": [{ "name": "module", "state": "lost", "fault": joined, "hint": hint }],
            "events": [{ "at": "2026-01-05T12:00:00Z", "text": joined, "data": { "hint": hint } }]
        });
        let text = of(&status);
        assert_eq!((text.matches(hint).count(), text.matches(why).count()), (1, 6), "{text}");
        assert!(text.contains(&format!("device module: {why}\n      to do: {hint}\n")), "{text}");
        // Without an alarm, the hint is at the next line that needs it.
        status["alarms"] = json!([]);
        let text = of(&status);
        assert!(text.contains(&format!("axis z: frozen\n  {why}\n  to do: {hint}\n")), "{text}");
        assert_eq!(text.matches(hint).count(), 1, "{text}");
    }

    #[test]
    fn beside_what_a_model_asks_for_stands_how_wrong_it_is_expected_to_be_and_why_a_probing_was_not_believed()
    {
        let mut axis = json!({
            "display": "compensating", "cz_um": -12.3, "verified_um": -12.3, "limit_um": 40.0, "model": "rises",
            "raw_um": -12.34, "expected_um": 2.13, "acted": ["round"],
            "probe": { "last": { "at": "2026-01-05T12:00:00Z", "error_um": 9.0, "refused": "measure again" } }
        });
        let text = lines(&axis);
        assert!(
            text.contains("model rises requests -12.3 µm, expected within ±2.1 µm (1 σ); guard: round\n"),
            "{text}"
        );
        assert!(
            text.contains(
                "probed +9.0 µm at 2026-01-05 12:00:00, not used for the correction: measure again\n"
            ),
            "{text}"
        );
        axis["expected_touches"] = json!(24);
        let text = lines(&axis);
        assert!(text.contains("expected within ±2.1 µm (1 σ, touches: 24); guard: round\n"), "{text}");
        (axis["expected_um"], axis["probe"]["last"]["refused"]) = (Value::Null, Value::Null);
        let text = lines(&axis);
        assert!(text.contains("requests -12.3 µm; guard: round\n") && !text.contains("probed"), "{text}");
    }

    #[test]
    fn a_learned_model_and_its_candidate_are_named_with_the_gain() {
        let mut axis = json!({
            "display": "compensating", "cz_um": 3.0, "verified_um": 3.0, "limit_um": 40.0,
            "learned": { "adopted": null, "before": null, "waiting": null, "auto": false, "candidate": {
                "model": "learned-2026-01-31-3fa2", "runs": 9, "since": "2026-01-26", "days": 5, "touches": 40,
                "in_use_um": 6.94, "candidate_um": 3.81, "better": true
            } }
        });
        let text = lines(&axis);
        let words = "  candidate learned-2026-01-31-3fa2: since 2026-01-26, it would have left a residual \
                     error of 3.8 instead of 6.9 µm (days: 5, touches: 40); `isotherm adopt` adopts it\n";
        assert!(text.ends_with(words), "{text}");
        (axis["learned"]["waiting"], axis["learned"]["auto"]) = (json!(""), json!(true));
        let text = lines(&axis);
        assert!(text.contains("the change to the model of the profile waits until Cz can be kept"), "{text}");
        assert!(text.ends_with("; it is adopted at the next datum\n"), "{text}");
        axis["learned"]["adopted"] = json!("learned-2026-01-31-3fa2");
        let text = lines(&axis);
        assert!(text.contains("follows the learned model learned-2026-01-31-3fa2\n"), "{text}");
        assert!(!text.contains("candidate"), "{text}");
        axis["learned"] = Value::Null;
        assert!(!lines(&axis).contains("learned"));
    }

    #[test]
    fn a_model_that_is_worse_than_no_compensation_is_named_with_its_figures_and_what_the_axis_does() {
        let mut axis = json!({
            "display": "compensating", "cz_um": 3.0, "verified_um": 3.0, "limit_um": 40.0,
            "probe": { "worse": { "touches": 5, "without_um": 2.04, "with_um": 3.16, "ramps": false } }
        });
        assert!(
            lines(&axis).ends_with(
                "\n  the model is worse than no compensation: the residual error is 3.2 µm with the model, \
                 2.0 µm without (root mean square of the last 5 touches); Cz still follows the model\n"
            ),
            "{}",
            lines(&axis)
        );
        (axis["probe"]["worse"]["touches"], axis["probe"]["worse"]["ramps"]) = (json!(0), json!(true));
        assert!(
            lines(&axis).ends_with(
                "\n  the model is worse than no compensation: touches before the \
                 last datum (zero point of Cz) show this; Cz goes to zero until touches show that the model is better\n"
            ),
            "{}",
            lines(&axis)
        );
        axis["probe"]["worse"] = Value::Null;
        assert!(!lines(&axis).contains("worse"));
    }
}

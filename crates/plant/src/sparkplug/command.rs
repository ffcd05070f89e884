//! What hosts ask for.

use std::time::Duration;

use isotherm_core::compensation::MeasuredReport;
use isotherm_core::quantity::Moment;

use super::born::{Born, REBIRTH, axes, measured, measured_axis, milliseconds};
use super::datum::{DataType, Datum};
use super::payload::{Metric, Payload, PropertyRaw, Raw};
use crate::seam::{Command, Outcome, Snapshot};

/// A measured error that is older is of another Cz than the one that stands now.
const HEEDED_FOR: Duration = Duration::from_secs(60);

/// So much of a name is repeated.
const MOST_LETTERS: usize = 64;

/// What has come of a command.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Heard {
    pub(super) asks_for_birth: bool,
    /// When, by its own clock, ms since 1970.
    pub(super) sent: Option<u64>,
    pub(super) outcome: Option<Outcome>,
}

/// What is to be done about a command that has arrived, from whomever. Of a message that asks for several things, nothing but
/// the birth is done.
pub(super) fn hear(
    bytes: &[u8],
    now: Moment,
    snapshot: &Snapshot,
    born: &Born,
    takes_measured: bool,
) -> Heard {
    let payload = match Payload::arrived(bytes) {
        Ok(payload) => payload,
        Err(error) => return Heard { outcome: Some(refused("NCMD", error.to_string())), ..Heard::default() },
    };
    let mut heard = Heard { sent: payload.timestamp, ..Heard::default() };
    let mut others = Vec::new();
    for metric in &payload.metrics {
        // By its name only: it has no alias.
        match (metric.name.as_deref() == Some(REBIRTH), &metric.value) {
            (true, Some(Raw::Boolean(true))) => heard.asks_for_birth = true,
            (true, _) => {
                let why = "only `true` asks for a birth".to_owned();
                heard.outcome.get_or_insert(refused(REBIRTH, why));
            }
            (false, _) => others.push(metric),
        }
    }
    match others.as_slice() {
        [] => {}
        [metric] => {
            let outcome = other(metric, heard.sent, now, snapshot, born, takes_measured);
            heard.outcome = Some(outcome);
        }
        [first, ..] => {
            let why = format!("{} values in one message; one at a time is taken", others.len());
            heard.outcome = Some(refused(&spoken(first, born), why));
        }
    }
    heard
}

fn other(
    metric: &Metric,
    sent: Option<u64>,
    now: Moment,
    snapshot: &Snapshot,
    born: &Born,
    takes_measured: bool,
) -> Outcome {
    let command = spoken(metric, born);
    let Some(axis) = born.name_of(metric).and_then(measured_axis) else {
        let why =
            "nothing that arrives over MQTT arms, disarms or moves, and this is nothing else that is taken";
        return refused(&command, why.to_owned());
    };
    if !takes_measured {
        let why = "the profile does not take it: `[mqtt] commands = [\"measured\"]` would";
        return refused(&command, why.to_owned());
    }
    if !axes(snapshot).contains(&axis) {
        return refused(&command, "there is no axis of this name".to_owned());
    }
    if let Err(why) = is_of_now(sent, now) {
        return refused(&command, why);
    }
    let Some(error_um) = error_of(metric) else {
        return refused(&command, "its value is no number of micrometres (Double or Float)".to_owned());
    };
    match report_of(metric, error_um) {
        Ok(report) => Outcome::Asked(Command::Measured { axis: axis.to_owned(), report }),
        Err(why) => refused(&command, why),
    }
}

/// The error with the properties `time`, as text or in milliseconds since 1970, and `id`.
fn report_of(metric: &Metric, error_um: f64) -> Result<MeasuredReport, String> {
    let time = match property(metric, "time") {
        Some(PropertyRaw::Long(milliseconds)) => Some(format!("{milliseconds}e-3")),
        time => text_of(time),
    };
    let id = text_of(property(metric, "id"));
    MeasuredReport::new(error_um, time.as_deref(), id.as_deref())
}

fn property<'a>(metric: &'a Metric, key: &str) -> Option<&'a PropertyRaw> {
    let properties = metric.properties.as_ref()?;
    let place = properties.keys.iter().position(|known| known == key)?;
    let property = properties.values.get(place).filter(|property| property.is_null != Some(true))?;
    property.value.as_ref()
}

/// A value that is no text is none that can be read.
fn text_of(value: Option<&PropertyRaw>) -> Option<String> {
    value.map(|value| if let PropertyRaw::String(text) = value { text.clone() } else { String::new() })
}

fn is_of_now(sent: Option<u64>, now: Moment) -> Result<(), String> {
    let Some(sent) = sent else {
        return Err("it does not say when it was sent".to_owned());
    };
    let apart = Duration::from_millis(milliseconds(now).abs_diff(sent));
    if apart <= HEEDED_FOR {
        return Ok(());
    }
    let word = if sent < milliseconds(now) { "ago" } else { "from now" };
    let limit = HEEDED_FOR.as_secs();
    Err(format!(
        "it was sent {} s {word} by its own clock; {limit} s are heeded: it waited somewhere, or a clock is wrong",
        apart.as_secs()
    ))
}

fn error_of(metric: &Metric) -> Option<f64> {
    let raw = metric.value.as_ref().filter(|_| metric.is_null != Some(true))?;
    let kind = match (metric.datatype, raw) {
        (Some(number), _) => DataType::from_number(number)?,
        // A command need not say its type.
        (None, Raw::Float(_)) => DataType::Float,
        (None, _) => DataType::Double,
    };
    match kind.read(raw)? {
        Datum::Real(value) => value.is_finite().then_some(value),
        _ => None,
    }
}

/// What is said of a measured error that is the last one once more.
pub(super) fn came_twice(command: &Command) -> Outcome {
    let Command::Measured { axis, .. } = command;
    refused(&measured(axis), "it came a second time, and was taken the first time".to_owned())
}

fn refused(command: &str, why: String) -> Outcome {
    Outcome::Refused { command: command.to_owned(), why }
}

/// How a metric that somebody has sent is spoken of: not longer than a line, and without what a terminal obeys.
fn spoken(metric: &Metric, born: &Born) -> String {
    match (born.name_of(metric), metric.alias) {
        (Some(name), _) => name.chars().take(MOST_LETTERS).flat_map(char::escape_debug).collect(),
        (None, Some(alias)) => format!("alias {alias}"),
        (None, None) => "a value without a name".to_owned(),
    }
}

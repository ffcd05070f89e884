//! Commands that Sparkplug hosts send to the gateway.

use std::time::Duration;

use isotherm_core::compensation::MeasuredReport;
use isotherm_core::quantity::Moment;

use super::birth::{BirthMetrics, REBIRTH, axes, measured, measured_axis, milliseconds};
use super::datum::{DataType, Datum};
use super::payload::{Metric, Payload, PropertyRaw, Raw};
use crate::interface::{Command, Outcome, Snapshot};

/// Maximum difference between the current time and the time stamp of a message with a measured error. An
/// older message may contain an error that was measured with another compensation value (Cz).
const HEEDED_FOR: Duration = Duration::from_secs(60);

/// Maximum length of a metric name in a refusal, in characters. The rest of a longer name is cut.
const MOST_LETTERS: usize = 64;

/// Content of a received command message, after evaluation.
#[derive(Debug, Default, PartialEq)]
pub(super) struct CommandResult {
    pub(super) asks_for_birth: bool,
    /// Time at which the message was sent, by the sender's clock, in ms since 1970.
    pub(super) sent: Option<u64>,
    pub(super) outcome: Option<Outcome>,
}

/// Evaluates a received command message from an untrusted sender. A message may contain a request for a birth
/// and one other command. If it contains several other commands, all of these are refused.
pub(super) fn receive(
    bytes: &[u8],
    now: Moment,
    snapshot: &Snapshot,
    born: &BirthMetrics,
    takes_measured: bool,
) -> CommandResult {
    let payload = match Payload::arrived(bytes) {
        Ok(payload) => payload,
        Err(error) => {
            return CommandResult {
                outcome: Some(refused("NCMD", error.to_string())),
                ..CommandResult::default()
            };
        }
    };
    let mut heard = CommandResult { sent: payload.timestamp, ..CommandResult::default() };
    let mut others = Vec::new();
    for metric in &payload.metrics {
        // The metric is identified by its name only, because it has no alias.
        match (metric.name.as_deref() == Some(REBIRTH), &metric.value) {
            (true, Some(Raw::Boolean(true))) => heard.asks_for_birth = true,
            (true, _) => {
                let why = "send `true` to request a birth message".to_owned();
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
            let why = format!("{} values in one message; send one value in each message", others.len());
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
    born: &BirthMetrics,
    takes_measured: bool,
) -> Outcome {
    let command = spoken(metric, born);
    let Some(axis) = born.name_of(metric).and_then(measured_axis) else {
        let why = "the gateway accepts only a measured error or a request for a birth message over MQTT; no \
                   message can arm, disarm or move an axis";
        return refused(&command, why.to_owned());
    };
    if !takes_measured {
        let why = "the profile does not accept measured errors: write `[mqtt] commands = [\"measured\"]`";
        return refused(&command, why.to_owned());
    }
    if !axes(snapshot).contains(&axis) {
        return refused(&command, "the profile has no axis with this name".to_owned());
    }
    if let Err(why) = is_of_now(sent, now) {
        return refused(&command, why);
    }
    let Some(error_um) = error_of(metric) else {
        return refused(
            &command,
            "the value of the metric is not a number (Double or Float, in µm)".to_owned(),
        );
    };
    match report_of(metric, error_um) {
        Ok(report) => Outcome::Asked(Command::Measured { axis: axis.to_owned(), report }),
        Err(why) => refused(&command, why),
    }
}

/// Makes the report of a measured error from a metric. The optional properties are `time` (text or ms since 1970) and
/// `id` (text).
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

/// Returns the text of a property. A property of another type becomes an empty text, which the caller rejects.
fn text_of(value: Option<&PropertyRaw>) -> Option<String> {
    value.map(|value| if let PropertyRaw::String(text) = value { text.clone() } else { String::new() })
}

fn is_of_now(sent: Option<u64>, now: Moment) -> Result<(), String> {
    let Some(sent) = sent else {
        return Err("the message has no timestamp".to_owned());
    };
    let apart = Duration::from_millis(milliseconds(now).abs_diff(sent));
    if apart <= HEEDED_FOR {
        return Ok(());
    }
    let word = if sent < milliseconds(now) { "ago" } else { "from now" };
    let limit = HEEDED_FOR.as_secs();
    Err(format!(
        "by the sender's clock, the message was sent {} s {word}; the limit is {limit} s: the message was \
         delayed, or a clock is wrong",
        apart.as_secs()
    ))
}

fn error_of(metric: &Metric) -> Option<f64> {
    let raw = metric.value.as_ref().filter(|_| metric.is_null != Some(true))?;
    let kind = match (metric.datatype, raw) {
        (Some(number), _) => DataType::from_number(number)?,
        // The type is optional in a command.
        (None, Raw::Float(_)) => DataType::Float,
        (None, _) => DataType::Double,
    };
    match kind.read(raw)? {
        Datum::Real(value) => value.is_finite().then_some(value),
        _ => None,
    }
}

/// Returns the refusal of a measured error that the broker delivered twice.
pub(super) fn repeated_outcome(command: &Command) -> Outcome {
    let Command::Measured { axis, .. } = command;
    refused(&measured(axis), "the message is a duplicate: the gateway accepted the first copy".to_owned())
}

fn refused(command: &str, why: String) -> Outcome {
    Outcome::Refused { command: command.to_owned(), why }
}

/// Returns the name of a received metric for a message to people: shortened, and without control characters.
fn spoken(metric: &Metric, born: &BirthMetrics) -> String {
    match (born.name_of(metric), metric.alias) {
        (Some(name), _) => name.chars().take(MOST_LETTERS).flat_map(char::escape_debug).collect(),
        (None, Some(alias)) => format!("alias {alias}"),
        (None, None) => "a value without a name".to_owned(),
    }
}

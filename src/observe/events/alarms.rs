//! Alarms: faults that have not ended. One event raises an alarm, another event ends it.
//!
//! An operator acknowledges an alarm after seeing it. The acknowledgement only marks the alarm. If the same alarm is
//! raised again, the new alarm is not acknowledged.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use super::journal::Entry;
use isotherm_core::events::{EventKind, Level};

/// Alarm that was raised and has not ended.
#[derive(Clone, Debug, PartialEq, JsonSchema, Serialize)]
pub struct Alarm {
    /// Subject of the alarm, by which it is acknowledged, for example `signal bed`.
    pub id: String,
    /// Kind of the event that raised the alarm.
    pub kind: String,
    /// Severity of the alarm.
    #[schemars(schema_with = "super::data::level_schema")]
    pub level: Level,
    /// Time since which the alarm is active, RFC 3339.
    pub since: String,
    /// Text of the event that raised the alarm.
    pub text: String,
    /// Present cause of the alarm; `None` if it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// Hint: remedy for the cause.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// Acknowledgement; `None` if the alarm was not acknowledged.
    pub acknowledged: Option<Acknowledgement>,
}

/// Acknowledgement of an alarm.
#[derive(Clone, Debug, PartialEq, Eq, JsonSchema, Serialize)]
pub struct Acknowledgement {
    /// Time of the acknowledgement, RFC 3339.
    pub at: String,
    /// Requester of the acknowledgement, with its channel.
    pub by: String,
}

/// Alarms that an event has raised or ended, by their subjects.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Change {
    /// Subject of the alarm that was raised; `None` if the event raises no alarm.
    pub raised: Option<String>,
    /// Subjects of the alarms that were active and that the event has ended.
    pub ended: Vec<String>,
}

/// Active alarms. The key is the subject of the alarm.
#[derive(Debug, Default)]
pub(super) struct Alarms(BTreeMap<String, Alarm>);

impl Alarms {
    /// Raises and ends the alarms of an event, as the event catalogue defines. Returns the alarms that were
    /// raised or ended.
    pub(super) fn note(&mut self, kind: EventKind, entry: &Entry) -> Change {
        let raised = kind.raises().filter(|_| entry.level != Level::Info);
        let ends: &[&str] = if raised.is_some() { &[] } else { kind.ends() };
        let raised = raised.map(|alarm| id_of(alarm, &entry.data));
        let mut ended: Vec<String> = ends.iter().map(|alarm| id_of(alarm, &entry.data)).collect();
        ended.retain(|id| self.0.remove(id).is_some());
        if let Some(id) = raised.clone() {
            let field = |name: &str| entry.data.get(name).and_then(|value| value.as_str()).map(str::to_owned);
            // An alarm that is active keeps its beginning. Its new cause is not acknowledged yet.
            let since = self.0.get(&id).filter(|known| known.kind == *entry.kind);
            let since = since.map_or_else(|| entry.at.clone(), |known| known.since.clone());
            let alarm = Alarm {
                id: id.clone(),
                kind: entry.kind.to_string(),
                level: entry.level,
                since,
                text: entry.text.clone(),
                cause: field("cause"),
                hint: field("hint"),
                acknowledged: None,
            };
            self.0.insert(id, alarm);
        }
        Change { raised, ended }
    }

    /// Returns all alarms, newest first.
    pub(super) fn all(&self) -> Vec<Alarm> {
        let mut all: Vec<Alarm> = self.0.values().cloned().collect();
        all.sort_by(|one, other| other.since.cmp(&one.since));
        all
    }

    /// Acknowledges one alarm, or all alarms if `id` is `None`. Returns the number of alarms that were not acknowledged
    /// before. Returns `None` if the alarm does not exist.
    pub(super) fn acknowledge(&mut self, id: Option<&str>, seen: &Acknowledgement) -> Option<usize> {
        let meant = self.0.values_mut().filter(|alarm| id.is_none_or(|id| id == alarm.id));
        let mut meant = meant.peekable();
        meant.peek()?;
        let new = meant.filter(|alarm| alarm.acknowledged.is_none());
        Some(new.map(|alarm| alarm.acknowledged = Some(seen.clone())).count())
    }
}

/// Returns the subject of an alarm: the pattern, in which each `{name}` is replaced by the field `name` of the event's
/// data.
fn id_of(pattern: &str, data: &Value) -> String {
    let parts = pattern.split(['{', '}']).enumerate();
    parts
        .map(|(place, part)| match place % 2 {
            0 => part,
            _ => data[part].as_str().unwrap_or_default(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observe::events::Event;
    use isotherm_core::explained::Explained;
    use isotherm_core::quantity::{Micron, Moment};

    fn seen(by: &str) -> Acknowledgement {
        Acknowledgement { at: "2026-07-02T12:00:00Z".to_owned(), by: by.to_owned() }
    }

    fn bad() -> Event {
        Event::SignalBad { signal: "bed".into(), reason: "open circuit".into() }
    }

    fn state(to: &'static str, stopping: bool) -> Event {
        Event::AxisState { axis: "z".into(), from: "active", to, why: Explained::default(), stopping }
    }

    #[test]
    fn an_alarm_stands_until_its_end_and_one_that_is_raised_anew_was_not_seen() {
        let mut alarms = Alarms::default();
        let note =
            |alarms: &mut Alarms, event: &Event| alarms.note(event.kind(), &event.entry(Moment::default()));
        assert_eq!(note(&mut alarms, &bad()).raised.as_deref(), Some("signal bed"));
        note(&mut alarms, &state("holding", false));
        let ids = |alarms: &Alarms| alarms.all().into_iter().map(|alarm| alarm.id).collect::<Vec<_>>();
        assert_eq!(ids(&alarms), ["axis z", "signal bed"]);
        assert_eq!(alarms.acknowledge(Some("signal bad"), &seen("a")), None);
        assert_eq!(alarms.acknowledge(Some("signal bed"), &seen("a")), Some(1));
        assert_eq!(alarms.acknowledge(None, &seen("b")), Some(1), "the other one");
        assert_eq!(alarms.acknowledge(None, &seen("c")), Some(0));
        let by = |alarms: &Alarms| -> Vec<_> {
            alarms.all().into_iter().map(|alarm| alarm.acknowledged.map(|seen| seen.by)).collect()
        };
        assert_eq!(by(&alarms), [Some("b".to_owned()), Some("a".to_owned())]);
        note(&mut alarms, &Event::SignalGood { signal: "bed".into(), bad_for: std::time::Duration::ZERO });
        let change = note(&mut alarms, &state("active", false));
        assert_eq!(
            change,
            Change { raised: None, ended: vec!["axis z".to_owned()] },
            "its Cz never raised one"
        );
        assert_eq!(ids(&alarms), Vec::<String>::new());
        note(&mut alarms, &bad());
        assert_eq!(by(&alarms), [None]);
    }

    #[test]
    fn the_alarm_of_the_warning_level_names_cz_and_ends_with_the_axis() {
        let mut alarms = Alarms::default();
        let um = |um| Micron::new(um).unwrap();
        let warned = Event::Warned { axis: "z".into(), cz: um(31.0), warn: um(30.0) };
        let raised = alarms.note(warned.kind(), &warned.entry(Moment::default())).raised;
        assert_eq!(raised.as_deref(), Some("Cz of axis z"));
        let over = state("active", false);
        let ended = alarms.note(over.kind(), &over.entry(Moment::default())).ended;
        assert_eq!(ended, ["Cz of axis z"]);
    }

    #[test]
    fn an_alarm_shows_the_present_cause_and_since_when_something_is_wrong() {
        let mut alarms = Alarms::default();
        let down = |hint: &'static str, cause: &str| Event::LinkDown {
            bus: "cell".into(),
            address: "10.0.0.7:802".into(),
            fault: Explained::new(cause, hint),
            excludes_wiring: false,
        };
        let (begun, later) = (Moment::default(), Moment::from_nanos(60_000_000_000));
        let refused = down("is the port right?", "nothing listens there");
        alarms.note(refused.kind(), &refused.entry(begun));
        alarms.acknowledge(None, &seen("a"));
        let untrusted = down("put it into `tls.ca`", "its certificate is not trusted");
        alarms.note(untrusted.kind(), &untrusted.entry(later));
        let [alarm] = &alarms.all()[..] else { panic!("{alarms:?}") };
        assert_eq!(alarm.cause.as_deref(), Some("its certificate is not trusted"));
        let hint = Some("put it into `tls.ca`");
        assert_eq!((alarm.hint.as_deref(), &alarm.acknowledged), (hint, &None), "nobody has seen this cause");
        assert_eq!(alarm.since, refused.entry(begun).at);
        let data = refused.entry(begun).data;
        assert_eq!(data["fault"], "nothing listens there: is the port right?");
        assert_eq!(
            (&data["cause"], &data["hint"]),
            (&"nothing listens there".into(), &"is the port right?".into())
        );
    }

    #[test]
    fn an_orderly_stop_raises_none_and_ends_those_of_the_axes() {
        let mut alarms = Alarms::default();
        for (event, count) in
            [(state("holding", false), 1), (state("ramping", true), 0), (state("zeroed", true), 0)]
        {
            alarms.note(event.kind(), &event.entry(Moment::default()));
            assert_eq!(alarms.all().len(), count, "{event:?}");
        }
    }
}

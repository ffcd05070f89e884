//! Format of the event data for programs (JSON): maximum lengths of texts and lists, and the form of levels and
//! durations.

use std::time::Duration;

use schemars::{Schema, SchemaGenerator, json_schema};
use serde::Serializer;
use serde_json::Value;

use crate::clock::Correction;
use isotherm_core::events::Level;
use isotherm_core::quantity::Moment;
use isotherm_profile::safe_file::cut;

/// Maximum number of characters of an event's sentence, and of each text in its data. A long text from outside must not
/// fill the event file of a day, or the status.
pub(super) const LONGEST: usize = 800;
/// Maximum number of entries of a list in an event's data.
const MOST: usize = 100;

/// Shortens each text to [`LONGEST`] characters, and each list to [`MOST`] entries.
pub(super) fn bound(data: &mut Value) {
    match data {
        Value::String(text) if text.len() > LONGEST => *text = cut(text, LONGEST).into_owned(),
        Value::Array(list) => {
            list.truncate(MOST);
            list.iter_mut().for_each(bound);
        }
        Value::Object(fields) => fields.values_mut().for_each(bound),
        _ => {}
    }
}

/// Returns the JSON schema of the level of an event: a text that must be the name of a level.
pub(super) fn level_schema(_: &mut SchemaGenerator) -> Schema {
    let levels = [Level::Info, Level::Warning, Level::Error].map(Level::name);
    json_schema!({ "type": "string", "enum": levels })
}

pub(super) fn in_text<S: Serializer>(moment: &Moment, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(moment)
}

pub(super) fn both_in_text<S: Serializer>(set: &Correction, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map([("from", set.from.to_string()), ("to", set.to.to_string())])
}

pub(super) fn in_seconds<S: Serializer>(span: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(span.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use crate::observe::events::Event;
    use isotherm_core::quantity::Moment;

    #[test]
    fn an_event_stays_short_however_much_others_write() {
        let long = "µ\u{1b}".repeat(30_000);
        let names = vec![long.clone(); 300];
        for event in [
            Event::LogsDeleted { names, why: long.clone() },
            Event::LinkDown {
                bus: long.clone(),
                address: long.clone(),
                fault: long.into(),
                excludes_wiring: false,
            },
        ] {
            let entry = event.entry(Moment::default());
            assert_eq!(entry.text.chars().count(), 801, "{}", entry.text);
            assert!(entry.text.ends_with('…'));
            assert!(entry.data.to_string().len() < 1_000_000);
        }
    }
}

//! Conversion of the events of the gateway to OPC UA events.

use ::opcua::nodes::BaseEventType;
use ::opcua::types::{ByteString, LocalizedText, NodeId, ObjectTypeId, UAString};

use super::convert::date_time;
use crate::observe::events::{Entry, Level};
use crate::observe::status::Status;
use isotherm_core::quantity::{Moment, time};

/// Source of the OPC UA events. It finds the events that are new since the last sample of the status.
#[derive(Debug)]
pub(super) struct EventFeed {
    /// Number of events that the gateway had reported since its start when the last sample was taken.
    seen: u64,
    /// Start time of the server, which makes the identifiers of the events unique.
    start: Moment,
}

impl EventFeed {
    /// Creates a feed that begins with the events after this status.
    pub(super) fn after(status: &Status, start: Moment) -> EventFeed {
        EventFeed { seen: total(status), start }
    }

    /// Returns the new events, oldest first, each with its own number. Events that the status no longer contains are
    /// not sent to OPC UA clients; `isotherm events` still shows them.
    pub(super) fn take_new<'s>(&mut self, status: &'s Status) -> Vec<(u64, &'s Entry)> {
        let all = total(status);
        let new = usize::try_from(all.saturating_sub(self.seen)).unwrap_or(usize::MAX);
        self.seen = all;
        let shown = new.min(status.events.len());
        let first = all - u64::try_from(shown).unwrap_or(0);
        (first..all).zip(&status.events[status.events.len() - shown..]).collect()
    }

    /// Converts an event to an OPC UA event. `source` is the node of the machine.
    pub(super) fn event(
        &self,
        (number, entry): (u64, &Entry),
        source: &NodeId,
        machine: &str,
    ) -> BaseEventType {
        let id = [self.start.as_nanos().to_be_bytes(), number.to_be_bytes()].concat();
        let at = date_time(time::parse(&entry.at).unwrap_or_default());
        let message = LocalizedText::from(entry.text.as_str());
        BaseEventType::new(ObjectTypeId::BaseEventType, ByteString::from(id), message, at)
            .set_source_node(source.clone())
            .set_source_name(UAString::from(machine))
            .set_severity(severity(entry.level))
    }
}

fn total(status: &Status) -> u64 {
    status.event_counts.values().sum()
}

/// Returns the OPC UA severity of an event: low, medium or high.
fn severity(level: Level) -> u16 {
    match level {
        Level::Info => 100,
        Level::Warning => 500,
        Level::Error => 900,
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::{event, status};
    use super::*;

    #[test]
    fn each_new_event_comes_once_with_a_number_of_its_own() {
        let mut now = status();
        let mut feed = EventFeed::after(&now, Moment::default());
        assert!(feed.take_new(&now).is_empty());
        now.events.push(event("a"));
        now.events.push(event("b"));
        now.event_counts.insert("signal-bad", 4);
        let new = feed.take_new(&now);
        let found: Vec<(u64, &str)> =
            new.iter().map(|(number, entry)| (*number, entry.text.as_str())).collect();
        assert_eq!(found, [(2, "a"), (3, "b")]);
        assert!(feed.take_new(&now).is_empty());
        // More events than the status contains.
        now.event_counts.insert("signal-bad", 1000);
        let new = feed.take_new(&now);
        assert_eq!((new.len(), new[0].0), (4, 996));
        let source = NodeId::new(2, "machine");
        let [one, two] = [0, 1].map(|place| feed.event(new[place], &source, "press"));
        assert!(one.event_id != two.event_id && one.severity == 500);
        assert_eq!(one.source_name.as_ref(), "press");
    }
}

//! Namespaces that the profile names by index: what is remembered of a server, and what is reported and refused when the server has
//! them elsewhere. [`isotherm_core::namespaces`] decides.

use std::path::Path;

use super::core::Core;
use crate::fieldbus::namespaces::NamespaceTable;
use crate::observe::events::Event;
use isotherm_core::continuity::{Difference, Found};
use isotherm_core::namespaces::{KnownNamespaces, Located};
use isotherm_profile::Bus;

/// The namespaces of one server, as they were reported last.
#[derive(Debug, Default)]
pub(super) struct NamespaceWatch {
    /// Changes of the table that were looked at.
    seen: u64,
    found: Vec<(u16, Located)>,
    known: KnownNamespaces,
    /// URIs of the server, by index.
    array: Vec<String>,
}

impl NamespaceWatch {
    /// Looks whether anything has changed since the last look: remembers it and reports it. Returns whether it has.
    pub(super) fn look(&mut self, bus: &Bus, table: &NamespaceTable, core: &mut Core) -> bool {
        let changes = table.changes();
        if changes == self.seen {
            return false;
        }
        let found = table.found();
        (self.seen, self.known, self.array) = (changes, table.known(), table.array().to_vec());
        for one in found.iter().filter(|one| !self.found.contains(one)) {
            core.events.extend(self.event(bus, one));
        }
        self.found = found;
        if core.places.remember_namespaces(&bus.address, &self.known) {
            core.storage.remember_soon();
        }
        true
    }

    fn event(&self, bus: &Bus, (index, located): &(u16, Located)) -> Option<Event> {
        let bus = bus.name.clone();
        let uri = self.known.uri(*index)?.to_owned();
        match located {
            Located::New(_) => Some(Event::NamespaceRecorded { bus, index: *index, uri }),
            Located::Moved(to) => Some(Event::NamespaceMoved { bus, uri, from: *index, to: *to }),
            Located::Unidentified | Located::Same | Located::Gone | Located::Ambiguous => None,
        }
    }

    /// Returns why a device of the server may not be used: a difference for each index whose namespace cannot be told.
    pub(super) fn differences(&self, profile: &Path, device: &str) -> Vec<Difference> {
        let lost = self.found.iter().filter(|(index, located)| located.index(*index).is_none());
        let difference = |(index, located): &(u16, Located)| {
            let uri = self.known.uri(*index).unwrap_or_default();
            let is_now = match self.array.get(usize::from(*index)) {
                Some(now) if now == uri => String::new(),
                Some(now) => format!(", ns={index} is {now} now"),
                None => format!(", it has no ns={index} now"),
            };
            let found = match located {
                Located::Ambiguous => format!("the server has namespace {uri} (ns={index}) more than once"),
                _ => format!("the server does not have namespace {uri} (ns={index}) any more{is_now}"),
            };
            Difference {
                what: format!("ns={index}"),
                was: uri.to_owned(),
                is: Found::Described(found),
                meaning: String::new(),
                remedy: format!(
                    "is it the right server? If it is, isotherm confirm {} {device}",
                    profile.display()
                ),
            }
        };
        lost.map(difference).collect()
    }
}

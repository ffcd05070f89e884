//! Namespaces of one OPC UA server that a profile names by index. The bus line and the gateway share this table. The
//! line reads the namespace array of the server with each connection. The line translates each index of the profile
//! into the present index of the server. The gateway stores the URIs and reports changes. [`isotherm_core::namespaces`]
//! decides what an index means.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use isotherm_core::namespaces::{KnownNamespaces, Located};

/// Table of the namespaces of one server. Clones share their content.
#[derive(Clone, Debug, Default)]
pub struct NamespaceTable(Arc<Mutex<Table>>);

#[derive(Debug, Default)]
struct Table {
    known: KnownNamespaces,
    /// Namespace array of the server, as read with the last connection.
    array: Arc<[String]>,
    /// Last known location of each namespace in the server's array, by the requested index of the profile.
    found: BTreeMap<u16, Located>,
    /// Number of changes of `found` so far.
    changes: u64,
}

impl NamespaceTable {
    fn lock(&self) -> MutexGuard<'_, Table> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Restores the namespaces that an earlier run of the gateway has stored.
    pub fn begin_with(&self, known: KnownNamespaces) {
        self.lock().known = known;
    }

    /// Sets the namespace array of the server, as read with a new connection.
    pub fn connected(&self, array: Vec<String>) {
        let mut table = self.lock();
        if *table.array == *array {
            return;
        }
        table.array = array.into();
        table.locate_again();
    }

    /// Returns the namespace array of the server, as read with the last connection.
    pub fn array(&self) -> Arc<[String]> {
        self.lock().array.clone()
    }

    /// Returns the present index at the server for the index `named` in the profile. Returns `None` if no node of this
    /// namespace may be requested. Records the URI of a new index.
    pub fn index(&self, named: u16) -> Option<u16> {
        let mut table = self.lock();
        if let Some(found) = table.found.get(&named) {
            return found.index(named);
        }
        table.locate(named)
    }

    /// Returns the number of changes so far, both of the stored namespaces and of their locations.
    pub fn changes(&self) -> u64 {
        self.lock().changes
    }

    /// Returns the namespaces that the gateway stores for the next run.
    pub fn known(&self) -> KnownNamespaces {
        self.lock().known.clone()
    }

    /// Returns each requested index of the profile with its last location in the server's array.
    pub fn found(&self) -> Vec<(u16, Located)> {
        self.lock().found.iter().map(|(index, found)| (*index, found.clone())).collect()
    }

    /// Accepts the namespace that the server now has at each index whose stored namespace was lost. The caller makes
    /// sure that the operator has confirmed this. Returns these indices with their new URIs.
    pub fn confirm(&self) -> Vec<(u16, String)> {
        let mut table = self.lock();
        let lost = table.found.iter().filter(|(_, found)| found.is_lost());
        let lost: Vec<u16> = lost.map(|(index, _)| *index).collect();
        let array = table.array.clone();
        let accept = |index: u16| {
            let uri = table.known.accept(index, &array)?.to_owned();
            table.locate(index);
            Some((index, uri))
        };
        lost.into_iter().filter_map(accept).collect()
    }
}

impl Table {
    fn locate(&mut self, named: u16) -> Option<u16> {
        let found = self.known.locate(named, &self.array);
        match &found {
            Located::New(uri) => self.known.remember(named, uri.clone()),
            Located::Same => self.known.is_seen(named),
            _ => {}
        }
        let index = found.index(named);
        if named != 0 && self.found.insert(named, found.clone()) != Some(found) {
            self.changes += 1;
        }
        index
    }

    fn locate_again(&mut self) {
        for named in self.found.keys().copied().collect::<Vec<_>>() {
            self.locate(named);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(uris: &[&str]) -> Vec<String> {
        ["ua", "server"].iter().chain(uris).map(|uri| (*uri).to_owned()).collect()
    }

    #[test]
    fn a_new_uri_is_remembered_once_and_followed_over_connections() {
        let table = NamespaceTable::default();
        table.connected(array(&["urn:mill"]));
        assert_eq!((table.index(2), table.index(0), table.changes()), (Some(2), Some(0), 1));
        assert_eq!((table.index(2), table.changes()), (Some(2), 1), "nothing new");
        assert_eq!(table.known().uri(2), Some("urn:mill"));
        table.connected(array(&["urn:mill"]));
        assert_eq!(table.changes(), 1, "the same array");
        table.connected(array(&["urn:lathe", "urn:mill"]));
        assert_eq!((table.index(2), table.found()), (Some(3), vec![(2, Located::Moved(3))]));
        table.connected(array(&["urn:mill"]));
        assert_eq!((table.index(2), table.found()), (Some(2), vec![(2, Located::Same)]));
    }

    #[test]
    fn what_is_gone_has_no_index_until_it_is_back_or_a_person_confirms() {
        let table = NamespaceTable::default();
        table.connected(array(&["urn:mill"]));
        assert_eq!(table.index(2), Some(2));
        table.connected(array(&["urn:lathe"]));
        assert_eq!((table.index(2), table.known().uri(2)), (None, Some("urn:mill")));
        let later = NamespaceTable::default();
        later.begin_with(table.known());
        later.connected(array(&["urn:lathe"]));
        assert_eq!(later.index(2), None, "remembered over a restart");
        let changes = later.changes();
        assert_eq!(later.confirm(), [(2, "urn:lathe".to_owned())]);
        assert_eq!((later.index(2), later.known().uri(2)), (Some(2), Some("urn:lathe")));
        assert!(later.changes() > changes);
        table.connected(array(&["urn:mill"]));
        assert_eq!((table.index(2), table.confirm()), (Some(2), vec![]));
    }
}

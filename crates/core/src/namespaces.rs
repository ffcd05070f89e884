//! Namespaces of an OPC UA server that a profile names by index (`ns=2`). A server may give the index to another namespace when it
//! restarts. [`KnownNamespaces`] remembers the URI behind each index and finds where the namespace is now.
//!
//! | remembered of an index | array of the server | result |
//! |---|---|---|
//! | nothing | a URI there, once | [`Located::New`] |
//! | nothing | no URI there, or one that it has twice | [`Located::Unidentified`] |
//! | a URI | has it there, and nowhere else | [`Located::Same`] |
//! | a URI | has it once, elsewhere | [`Located::Moved`] |
//! | a URI | does not have it | [`Located::Gone`] |
//! | a URI | has it more than once | [`Located::Ambiguous`] |
//! | a URI, accepted by a person | has it there, perhaps also elsewhere | [`Located::Same`] |
//! | a URI, in doubt because the profile was changed | has it once, elsewhere | [`Located::Unclear`] |
//!
//! Source: OPC 10000-3, 8.2.2 and OPC 10000-5, 6.3.13: only the indices 0 and 1 are fixed; clients shall store URIs.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// URIs behind the indices of one server, as remembered.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KnownNamespaces(BTreeMap<u16, Known>);

/// URI behind one index, and whether the profile means it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Known {
    uri: String,
    #[serde(default)]
    meaning: Meaning,
}

/// Whether the profile means this namespace by the index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Meaning {
    /// The server had it at the index.
    #[default]
    Seen,
    /// A person has accepted what the server has at the index.
    Accepted,
    /// Nodes of the index were added to the profile since. They may be meant as the server has its namespaces now.
    Unclear,
}

/// Where the namespace behind an index is now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Located {
    /// The namespace of OPC UA itself, or one that no URI identifies: the index is all that is known.
    Unidentified,
    /// At the index, for the first time: this URI is to be remembered.
    New(String),
    /// At the index, as remembered.
    Same,
    /// At this index now.
    Moved(u16),
    /// Nowhere.
    Gone,
    /// At more than one index.
    Ambiguous,
    /// At another index now, and the profile may mean the one that is at its index.
    Unclear,
}

impl Located {
    /// Index to send to the server for this index of the profile. `None` if nothing may be sent.
    pub fn index(&self, named: u16) -> Option<u16> {
        match self {
            Located::Unidentified | Located::New(_) | Located::Same => Some(named),
            Located::Moved(index) => Some(*index),
            Located::Gone | Located::Ambiguous | Located::Unclear => None,
        }
    }

    /// Returns whether nobody can tell which namespace is meant, so that nothing may be sent.
    pub fn is_lost(&self) -> bool {
        self.index(0).is_none()
    }
}

impl KnownNamespaces {
    /// Finds the namespace that the profile names by this index in the array of the server.
    pub fn locate(&self, index: u16, array: &[String]) -> Located {
        if index == 0 {
            return Located::Unidentified;
        }
        let count = |uri: &str| array.iter().filter(|known| *known == uri).count();
        let Some(Known { uri, meaning }) = self.0.get(&index) else {
            let uri = array.get(usize::from(index)).filter(|uri| !uri.is_empty() && count(uri) == 1);
            return uri.map_or(Located::Unidentified, |uri| Located::New(uri.clone()));
        };
        let place = (0..=u16::MAX).zip(array).find(|(_, known)| *known == uri).map(|(place, _)| place);
        if *meaning == Meaning::Accepted && array.get(usize::from(index)) == Some(uri) {
            return Located::Same;
        }
        match (count(uri), place) {
            (1, Some(place)) if place == index => Located::Same,
            (1, Some(_)) if *meaning == Meaning::Unclear => Located::Unclear,
            (1, Some(place)) => Located::Moved(place),
            (0, _) | (_, None) => Located::Gone,
            _ => Located::Ambiguous,
        }
    }

    /// Remembers the URI behind an index.
    pub fn remember(&mut self, index: u16, uri: String) {
        self.0.insert(index, Known { uri, meaning: Meaning::Seen });
    }

    /// A person has confirmed that the profile means what the server has at this index now. Returns its URI. Without a URI nothing is
    /// accepted.
    pub fn accept(&mut self, index: u16, array: &[String]) -> Option<&str> {
        let uri = array.get(usize::from(index)).filter(|uri| !uri.is_empty())?;
        self.0.insert(index, Known { uri: uri.clone(), meaning: Meaning::Accepted });
        self.uri(index)
    }

    /// The server has the namespace at this index: the profile means it.
    pub fn is_seen(&mut self, index: u16) {
        if let Some(known) = self.0.get_mut(&index).filter(|known| known.meaning == Meaning::Unclear) {
            known.meaning = Meaning::Seen;
        }
    }

    /// The profile has been read. `is_clear`: it has only nodes of this index that the former one had.
    pub fn doubt_unless(&mut self, is_clear: impl Fn(u16) -> bool) {
        for (_, known) in self.0.iter_mut().filter(|(index, _)| !is_clear(**index)) {
            known.meaning = Meaning::Unclear;
        }
    }

    /// Returns whether another one remembers the same of an index.
    pub fn agrees(&self, index: u16, other: &KnownNamespaces) -> bool {
        self.0.get(&index) == other.0.get(&index)
    }

    /// Takes what another one remembers of an index.
    pub fn take(&mut self, index: u16, other: &KnownNamespaces) {
        match other.0.get(&index) {
            Some(known) => self.0.insert(index, known.clone()),
            None => self.0.remove(&index),
        };
    }

    /// Returns the URI that is remembered of an index.
    pub fn uri(&self, index: u16) -> Option<&str> {
        self.0.get(&index).map(|known| known.uri.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(uris: &[&str]) -> Vec<String> {
        [&["http://opcfoundation.org/UA/", "urn:server"], uris]
            .concat()
            .into_iter()
            .map(str::to_owned)
            .collect()
    }

    #[test]
    fn a_remembered_namespace_is_found_where_it_is_now_or_not_at_all() {
        let mut known = KnownNamespaces::default();
        known.remember(2, "urn:mill".to_owned());
        let table: [(&[&str], Located, Option<u16>); 7] = [
            (&["urn:mill"], Located::Same, Some(2)),
            (&["urn:mill", "urn:lathe"], Located::Same, Some(2)),
            (&["urn:lathe", "urn:mill"], Located::Moved(3), Some(3)),
            (&["urn:lathe"], Located::Gone, None),
            (&[], Located::Gone, None),
            (&["urn:mill", "urn:mill"], Located::Ambiguous, None),
            (&["urn:lathe", "urn:mill", "urn:mill"], Located::Ambiguous, None),
        ];
        for (uris, expected, index) in table {
            let found = known.locate(2, &array(uris));
            assert_eq!((&found, found.index(2)), (&expected, index), "{uris:?}");
        }
        assert_eq!(known.locate(2, &[]), Located::Gone, "the array cannot be read any more");
    }

    #[test]
    fn what_is_not_remembered_has_the_index_of_the_profile() {
        let known = KnownNamespaces::default();
        let new = |uri: &str| Located::New(uri.to_owned());
        let table: [(u16, &[&str], Located); 6] = [
            (0, &["urn:mill"], Located::Unidentified),
            (1, &[], new("urn:server")),
            (2, &["urn:mill"], new("urn:mill")),
            (3, &["urn:mill"], Located::Unidentified),
            (2, &[""], Located::Unidentified),
            (2, &["urn:mill", "urn:mill"], Located::Unidentified),
        ];
        for (index, uris, expected) in table {
            let found = known.locate(index, &array(uris));
            assert_eq!((&found, found.index(index)), (&expected, Some(index)), "{index}, {uris:?}");
        }
    }

    #[test]
    fn what_a_person_has_accepted_holds_at_its_index_and_what_is_unclear_until_it_is_seen_there() {
        let twice = array(&["urn:mill", "urn:mill"]);
        let mut known = KnownNamespaces::default();
        known.remember(2, "urn:mill".to_owned());
        assert_eq!(
            (known.locate(2, &twice), known.accept(2, &twice)),
            (Located::Ambiguous, Some("urn:mill"))
        );
        assert_eq!(known.locate(2, &twice), Located::Same);
        assert_eq!(known.locate(2, &array(&["urn:lathe", "urn:mill"])), Located::Moved(3), "not forgotten");
        assert_eq!(known.locate(2, &array(&["urn:lathe", "urn:mill", "urn:mill"])), Located::Ambiguous);
        known.doubt_unless(|_| true);
        assert_eq!(known.locate(2, &array(&["urn:lathe", "urn:mill"])), Located::Moved(3));
        known.doubt_unless(|index| index != 2);
        assert_eq!(known.locate(2, &array(&["urn:lathe", "urn:mill"])), Located::Unclear);
        assert_eq!(known.locate(2, &array(&["urn:mill"])), Located::Same);
        known.is_seen(2);
        assert_eq!(known.locate(2, &array(&["urn:lathe", "urn:mill"])), Located::Moved(3));
        assert_eq!(known.accept(2, &[]), None, "the array cannot be read");
        assert_eq!(known.uri(2), Some("urn:mill"));
    }
}

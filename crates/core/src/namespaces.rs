//! Namespaces of an OPC UA server that a profile names by index (`ns=2`). A server may assign another index to a
//! namespace when it restarts. [`KnownNamespaces`] stores the URI of each index, and finds the present index of the
//! URI.
//!
//! | stored for an index | namespace array of the server | result |
//! |---|---|---|
//! | nothing | has a URI at the index, and only there | [`Located::New`] |
//! | nothing | has no URI at the index, or a URI that occurs twice | [`Located::Unidentified`] |
//! | a URI | has it at the index, and nowhere else | [`Located::Same`] |
//! | a URI | has it once, at another index | [`Located::Moved`] |
//! | a URI | does not have it | [`Located::Gone`] |
//! | a URI | has it more than once | [`Located::Ambiguous`] |
//! | a URI, accepted by the operator | has it at the index, perhaps also elsewhere | [`Located::Same`] |
//! | a URI, in doubt because the profile was changed | has it once, at another index | [`Located::Unclear`] |
//!
//! Source: OPC 10000-3, 8.2.2 and OPC 10000-5, 6.3.13. Only the indices 0 and 1 are fixed, and clients shall store
//! URIs.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// URI of the namespace that the profile means by each index, for one server.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KnownNamespaces(BTreeMap<u16, StoredUri>);

/// URI that is stored for one index, and how certain its meaning is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredUri {
    uri: String,
    #[serde(default)]
    meaning: Meaning,
}

/// Certainty that the profile means the stored namespace by its index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Meaning {
    /// The server had the stored namespace at this index.
    #[default]
    Seen,
    /// The operator has confirmed that the profile means the namespace that the server has at this index.
    Accepted,
    /// Nodes with this index were added to the profile after the URI was stored. They may mean the namespace that the
    /// server now has at the index.
    Unclear,
}

/// Result of the search for the namespace that the profile means by an index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Located {
    /// The index means the namespace of OPC UA itself, or a namespace that no URI identifies. The gateway uses the
    /// index of the profile unchanged.
    Unidentified,
    /// No URI has been stored for the index yet. The caller stores this URI, which the server has at the index.
    New(String),
    /// The server has the stored namespace at the index of the profile.
    Same,
    /// The server has the stored namespace at this other index.
    Moved(u16),
    /// The server does not have the stored namespace.
    Gone,
    /// The server has the stored namespace at more than one index.
    Ambiguous,
    /// The server has the stored namespace at another index, but the profile may mean the namespace that is now at the
    /// index of the profile.
    Unclear,
}

impl Located {
    /// Returns the index that the OPC UA server uses for the namespace with the index `named` in the profile. `None` if
    /// no request with this namespace may be sent.
    pub fn index(&self, named: u16) -> Option<u16> {
        match self {
            Located::Unidentified | Located::New(_) | Located::Same => Some(named),
            Located::Moved(index) => Some(*index),
            Located::Gone | Located::Ambiguous | Located::Unclear => None,
        }
    }

    /// Returns whether the index of the namespace on the OPC UA server is unknown, so that no request with this
    /// namespace may be sent.
    pub fn is_lost(&self) -> bool {
        self.index(0).is_none()
    }
}

impl KnownNamespaces {
    /// Finds the namespace that the profile means by `index` in `array`, the namespace array of the server.
    pub fn locate(&self, index: u16, array: &[String]) -> Located {
        if index == 0 {
            return Located::Unidentified;
        }
        let count = |uri: &str| array.iter().filter(|known| *known == uri).count();
        let Some(StoredUri { uri, meaning }) = self.0.get(&index) else {
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

    /// Stores the URI of the namespace that the server has at the index.
    pub fn remember(&mut self, index: u16, uri: String) {
        self.0.insert(index, StoredUri { uri, meaning: Meaning::Seen });
    }

    /// Stores the operator's confirmation that the profile means the namespace at this index of the server's array.
    /// Returns the URI of the namespace; `None` if the array has no URI at the index; then nothing is stored.
    pub fn accept(&mut self, index: u16, array: &[String]) -> Option<&str> {
        let uri = array.get(usize::from(index)).filter(|uri| !uri.is_empty())?;
        self.0.insert(index, StoredUri { uri: uri.clone(), meaning: Meaning::Accepted });
        self.uri(index)
    }

    /// Marks the meaning of an index as certain again, because the server has the stored namespace at the index.
    pub fn is_seen(&mut self, index: u16) {
        if let Some(known) = self.0.get_mut(&index).filter(|known| known.meaning == Meaning::Unclear) {
            known.meaning = Meaning::Seen;
        }
    }

    /// Marks the meaning of the stored indices as unclear after the profile was read. Indices for which `is_clear`
    /// returns true stay unchanged. An index is clear if all its nodes in the profile were in the former profile too.
    pub fn doubt_unless(&mut self, is_clear: impl Fn(u16) -> bool) {
        for (_, known) in self.0.iter_mut().filter(|(index, _)| !is_clear(**index)) {
            known.meaning = Meaning::Unclear;
        }
    }

    /// Returns whether both lists have the same entry for an index. Also true if both lists have no entry for the
    /// index.
    pub fn agrees(&self, index: u16, other: &KnownNamespaces) -> bool {
        self.0.get(&index) == other.0.get(&index)
    }

    /// Copies the entry of an index from another list. Removes the entry if the other list has no entry for the index.
    pub fn take(&mut self, index: u16, other: &KnownNamespaces) {
        match other.0.get(&index) {
            Some(known) => self.0.insert(index, known.clone()),
            None => self.0.remove(&index),
        };
    }

    /// Returns the stored URI of an index; `None` if no URI is stored.
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

//! Entry of one output in the register ledger, which is a part of the state document.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use isotherm_core::output;
use isotherm_core::place::OutputPlace;
use isotherm_core::quantity::Counts;

/// Maximum number of counts in a valid entry. The limit is larger than any register value.
const MOST: u64 = 1 << 40;

/// Entries of the register ledger, by the names of the outputs.
pub(in crate::gateway) type Entries = BTreeMap<String, Entry>;

/// Entry of the register ledger: the register of one output, and the saved data about that register.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct Entry {
    /// Register of the output. `None` in a document of layout 5 or earlier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(in crate::gateway) place: Option<OutputPlace>,
    /// Register of the output as a text, in a document of layout 5 or earlier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(in crate::gateway) register: Option<String>,
    pub(in crate::gateway) kept: output::SavedOutput,
}

impl Entry {
    /// Creates the entry of an output with this register.
    pub(in crate::gateway) fn new(place: OutputPlace, kept: output::SavedOutput) -> Entry {
        Entry { place: Some(place), register: None, kept }
    }

    /// Returns whether the entry belongs to the register `place`, and all its counts are valid.
    pub(in crate::gateway) fn lies_at(&self, place: &OutputPlace) -> bool {
        self.place.as_ref().is_some_and(|known| known.is_same_register(place)) && all_fit(&self.kept)
    }

    /// Returns whether the entry belongs to the register `place`. `in_words` is the text that identifies this
    /// register in a document of layout 5.
    pub(in crate::gateway) fn is_of(&self, place: &OutputPlace, in_words: &str) -> bool {
        match (&self.place, &self.register) {
            (Some(known), _) => known.is_same_register(place),
            (None, known) => known.as_deref() == Some(in_words),
        }
    }
}

/// Returns a part of a sentence about an entry with counts that are too large for a register. `None` if all entries
/// are valid.
pub(super) fn misfit(entries: &Entries) -> Option<String> {
    let (name, _) = entries.iter().find(|(_, entry)| !all_fit(&entry.kept))?;
    Some(format!("the number of counts for {name} is larger than any register can contain"))
}

/// Returns whether a register can hold this number of counts.
pub(in crate::gateway) fn fits(counts: Counts) -> bool {
    counts.unsigned_abs() <= MOST
}

fn all_fit(kept: &output::SavedOutput) -> bool {
    let account = kept.account.iter().flat_map(|account| [account.base, account.share]);
    let promises = kept.promises.iter().map(|promise| promise.value);
    account.chain(promises).chain(kept.stood).all(fits)
}

//! What the document says of one output.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use isotherm_core::output;
use isotherm_core::quantity::Counts;

/// More counts than any register holds. An entry with more is not one of ours.
const MOST: u64 = 1 << 40;

/// What is kept, by output.
pub(in crate::gateway) type Entries = BTreeMap<String, Entry>;

/// What is kept of one output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct Entry {
    /// Register, and what a count is worth there.
    pub(in crate::gateway) register: String,
    pub(in crate::gateway) kept: output::Kept,
}

/// A clause about an entry that no register of ours can have.
pub(super) fn misfit(entries: &Entries) -> Option<String> {
    let (name, _) = entries.iter().find(|(_, entry)| !all_fit(&entry.kept))?;
    Some(format!("no register holds as many counts as it says of {name}"))
}

/// A register of ours can hold so many counts.
pub(in crate::gateway) fn fits(counts: Counts) -> bool {
    counts.unsigned_abs() <= MOST
}

fn all_fit(kept: &output::Kept) -> bool {
    let account = kept.account.iter().flat_map(|account| [account.base, account.share]);
    let promises = kept.promises.iter().map(|promise| promise.value);
    account.chain(promises).chain(kept.stood).all(fits)
}

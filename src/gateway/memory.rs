//! What the gateway remembers over a restart: time since machine start, references, lags, datums, what probings taught,
//! what it last wrote and verified.
//!
//! One JSON file in the state directory, [sealed](super::sealed), replaced atomically. With one that is not believed the
//! gateway starts as if it had none, and a person arms.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use super::sealed::Found;
use super::sign::SignMemory;
use isotherm_core::compensation::Remembered;
use isotherm_core::quantity::{Moment, Shift, Shifted};
use isotherm_profile::Profile;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Memory {
    pub(super) at: Moment,
    /// The signals that references and terms count by.
    pub(super) signals: Vec<String>,
    #[serde(rename = "machine")]
    pub(super) remembered: Remembered,
    /// Cz as last verified in each offset output, µm.
    pub(super) verified_um: BTreeMap<String, f64>,
    /// By axis: what is known of its sign.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) signs: BTreeMap<String, SignMemory>,
}

#[derive(Debug, Default)]
pub(super) struct Recalled {
    /// Its moments are stamps, as the clock of that run had them.
    pub(super) remembered: Remembered,
    /// When it was kept.
    pub(super) at: Option<Moment>,
    /// The outputs that an offset was verified in.
    pub(super) verified: BTreeSet<String>,
    /// By axis: what is known of its sign.
    pub(super) signs: BTreeMap<String, SignMemory>,
}

impl Memory {
    pub(super) fn new(
        profile: &Profile,
        at: Moment,
        remembered: Remembered,
        verified_um: BTreeMap<String, f64>,
        signs: BTreeMap<String, SignMemory>,
    ) -> Memory {
        let signals = profile.signals.iter().map(|signal| signal.name.clone()).collect();
        Memory { at, signals, remembered, verified_um, signs }
    }

    /// The same as the computer's clock has it.
    pub(super) fn stamped(self, shift: Shift) -> Memory {
        let remembered = self.remembered.counted_until(self.at).shifted(shift);
        Memory { at: self.at.shifted(shift), remembered, ..self }
    }

    /// What was saved.
    ///
    /// # Errors
    /// A clause: it says nothing of a machine.
    pub(super) fn recall(found: Option<Found>, profile: &Profile) -> Result<Recalled, String> {
        let memory = match found {
            None => return Ok(Recalled::default()),
            Some(Found::Sealed(_, content)) => serde_json::from_value(content),
            Some(Found::Earlier(_, bytes)) => earlier(&bytes),
        };
        let memory: Memory = memory.map_err(|error| error.to_string())?;
        let remembered = memory.remembered.for_signals(
            |name| memory.signals.iter().position(|known| known == name),
            profile.signals.iter().map(|signal| signal.name.as_str()),
        );
        let verified = memory.verified_um.into_keys().collect();
        Ok(Recalled { remembered, at: Some(memory.at), verified, signs: memory.signs })
    }
}

/// A state of before there were seals: the first layout had no lags and no datums, the second no corrections by
/// probing.
fn earlier(bytes: &[u8]) -> serde_json::Result<Memory> {
    let mut content: serde_json::Map<String, serde_json::Value> = serde_json::from_slice(bytes)?;
    content.remove("version");
    serde_json::from_value(content.into())
}

#[cfg(test)]
mod tests;

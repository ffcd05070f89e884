//! What the gateway remembers over a restart: time since machine start, references, lags, datums, what probings taught,
//! what it last wrote and verified.
//!
//! One JSON file in the state directory, replaced atomically. A file that cannot be used is set aside, never
//! overwritten, and the gateway starts as if it had none.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::disk::Disk;
use crate::clock::Correction;
use isotherm_core::compensation::Remembered;
use isotherm_core::quantity::{Moment, Shift, Shifted};
use isotherm_profile::Profile;

/// The layout of the file. One of a later layout is set aside; the first had no lags and no datums, the
/// second no corrections by probing.
const VERSION: u32 = 3;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Memory {
    pub(super) version: u32,
    pub(super) at: Moment,
    /// The signals that references and terms count by.
    pub(super) signals: Vec<String>,
    #[serde(rename = "machine")]
    pub(super) remembered: Remembered,
    /// Cz as last verified in each offset output, µm.
    pub(super) verified_um: BTreeMap<String, f64>,
    /// The computer's clock was set so far that days before and after are not days of one row.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) clock_set: Option<Correction>,
}

#[derive(Debug, Default)]
pub(super) struct Recalled {
    /// Its moments are stamps, as the clock of that run had them.
    pub(super) remembered: Remembered,
    /// When it was kept.
    pub(super) at: Option<Moment>,
    pub(super) clock_set: Option<Correction>,
    /// The outputs that an offset was verified in.
    pub(super) verified: BTreeSet<String>,
    /// A sentence where a file was set aside.
    pub(super) trouble: Option<String>,
}

impl Memory {
    pub(super) fn new(
        profile: &Profile,
        at: Moment,
        remembered: Remembered,
        verified_um: BTreeMap<String, f64>,
    ) -> Memory {
        let signals = profile.signals.iter().map(|signal| signal.name.clone()).collect();
        Memory { version: VERSION, at, signals, remembered, verified_um, clock_set: None }
    }

    /// The same as the computer's clock has it.
    pub(super) fn stamped(self, shift: Shift, clock_set: Option<Correction>) -> Memory {
        let remembered = self.remembered.counted_until(self.at).shifted(shift);
        Memory { at: self.at.shifted(shift), remembered, clock_set, ..self }
    }

    /// The file of a machine in a state directory.
    pub(super) fn path(directory: &Path, profile: &Profile) -> PathBuf {
        directory.join(format!("{}.state.json", profile.name))
    }

    /// Replaces the file as a whole, or leaves the old one.
    pub(super) fn save(&self, disk: &dyn Disk, path: &Path) -> std::io::Result<()> {
        let mut text = serde_json::to_vec_pretty(self).map_err(std::io::Error::other)?;
        text.push(b'\n');
        disk.replace(path, &text)
    }

    /// Reads the file; a missing one is a machine that remembers nothing.
    pub(super) fn recall(disk: &dyn Disk, path: &Path, profile: &Profile) -> Recalled {
        let text = match disk.read(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Recalled::default(),
            Err(error) => {
                let trouble =
                    Some(format!("{} cannot be read ({error}); starting without it", path.display()));
                return Recalled { trouble, ..Recalled::default() };
            }
        };
        match serde_json::from_str::<Memory>(&text) {
            Ok(memory) if (1..=VERSION).contains(&memory.version) => {
                let remembered = memory.remembered.for_signals(
                    |name| memory.signals.iter().position(|known| known == name),
                    profile.signals.iter().map(|signal| signal.name.as_str()),
                );
                let verified = memory.verified_um.into_keys().collect();
                let (at, clock_set) = (Some(memory.at), memory.clock_set);
                Recalled { remembered, at, clock_set, verified, trouble: None }
            }
            Ok(memory) => set_aside(
                disk,
                path,
                &format!("it has version {}, this program writes {VERSION}", memory.version),
            ),
            Err(error) => set_aside(disk, path, &error.to_string()),
        }
    }
}

fn set_aside(disk: &dyn Disk, path: &Path, why: &str) -> Recalled {
    let aside = path.with_extension("json.bad");
    let moved = match disk.rename(path, &aside) {
        Ok(()) => format!("it is kept as {}", aside.display()),
        Err(error) => format!("and it could not be set aside ({error})"),
    };
    let trouble = format!(
        "the saved state {} cannot be used: {why}; {moved}; references, lags and the time since machine start begin anew",
        path.display()
    );
    Recalled { trouble: Some(trouble), ..Recalled::default() }
}

#[cfg(test)]
mod tests;

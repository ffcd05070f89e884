//! The templates of the last run: what has changed in one since is said, as after an upgrade of the program that ships it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::disk::{Disk, Files};
use isotherm_profile::{Profile, template};

/// More changes of one template nobody reads.
const SHOWN: usize = 6;

/// The text of each template, by its name.
type Texts = BTreeMap<String, String>;

/// The name of each template that is not as the last run had it, and what has changed, in a line.
pub fn changed(directory: &Path, profile: &Profile) -> Vec<(String, String)> {
    let before = kept(&path(directory, profile)).unwrap_or_default();
    let changed = texts(profile).into_iter().filter_map(|(name, now)| {
        let before = before.get(&name).filter(|before| **before != now)?;
        let changes = template::changes(before, &now);
        let more = changes.len().saturating_sub(SHOWN);
        let mut said = changes.into_iter().take(SHOWN).collect::<Vec<_>>().join("; ");
        if more > 0 {
            said.push_str(&format!("; and {more} more"));
        }
        (!said.is_empty()).then_some((name, said))
    });
    changed.collect()
}

/// Keeps those of this run. Nobody waits for it, and whether it can be done changes nothing else.
pub(super) fn keep(directory: &Path, profile: &Profile) {
    let (path, now) = (path(directory, profile), texts(profile));
    if kept(&path).unwrap_or_default() == now {
        return;
    }
    std::thread::spawn(move || {
        let _ = serde_json::to_vec_pretty(&now).map(|bytes| Files.replace(&path, &bytes));
    });
}

fn path(directory: &Path, profile: &Profile) -> PathBuf {
    directory.join(format!("{}.templates.json", profile.name))
}

/// What cannot be read is as if it were not there: nothing but a sentence rests on it.
fn kept(path: &Path) -> Option<Texts> {
    Files.read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok())
}

fn texts(profile: &Profile) -> Texts {
    let used = profile.devices.iter().filter_map(|device| device.template.as_ref());
    used.map(|template| (template.name.clone(), template.text.clone().into_owned())).collect()
}

//! Device templates as the last run used them. A template that has changed since then is reported, for example after
//! an upgrade of isotherm.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::disk::{Disk, Files};
use isotherm_profile::{Profile, template};

/// Maximum number of changes of one template that an event lists.
const SHOWN: usize = 6;

/// Text of each template. The key is the name of the template.
type Texts = BTreeMap<String, String>;

/// Returns name and changes of each template that has changed since the last run. The changes are in one line of
/// text.
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

/// Saves the templates of this run in a separate thread. If this fails, the next run does not report changed
/// templates.
pub(in crate::gateway) fn keep(directory: &Path, profile: &Profile) {
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

/// Reads the saved templates. Returns `None` if the file is missing or cannot be read.
fn kept(path: &Path) -> Option<Texts> {
    Files.read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok())
}

fn texts(profile: &Profile) -> Texts {
    let used = profile.devices.iter().filter_map(|device| device.template.as_ref());
    used.map(|template| (template.name.clone(), template.text.to_string())).collect()
}

//! Machines that are shipped inside the program: their profiles, by name.

use std::path::{Path, PathBuf};

use crate::virtual_machine::PlantSpec;
use isotherm_profile::Profile;

/// Name and text of each shipped profile; the first one is the default.
const SHIPPED: [(&str, &str); 11] = [
    ("surface-grinder", include_str!("../../profiles/surface-grinder.toml")),
    ("sinker-edm", include_str!("../../profiles/sinker-edm.toml")),
    ("xc100-lathe", include_str!("../../profiles/xc100-lathe.toml")),
    ("xc100-lathe-can", include_str!("../../profiles/xc100-lathe-can.toml")),
    ("ram-mc", include_str!("../../profiles/ram-mc.toml")),
    ("parts-vmc", include_str!("../../profiles/parts-vmc.toml")),
    ("spindle-hmc", include_str!("../../profiles/spindle-hmc.toml")),
    ("jcs018a-vmc", include_str!("../../profiles/jcs018a-vmc.toml")),
    ("screw-axis", include_str!("../../profiles/screw-axis.toml")),
    ("column-hmc", include_str!("../../profiles/column-hmc.toml")),
    ("linuxcnc-mill", include_str!("../../profiles/linuxcnc-mill.toml")),
];

/// Files that the shipped profiles name, such as matrices: name and content.
pub(super) const FILES: [(&str, &[u8]); 1] =
    [("column-hmc.matrix.json", include_bytes!("../../profiles/column-hmc.matrix.json"))];

/// Returns the names of the shipped machines.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    SHIPPED.iter().map(|(name, _)| *name)
}

/// Returns the text of a shipped profile, and the path that its error messages name. Returns `None` for an unknown
/// name.
pub(super) fn text(name: &str) -> Option<(PathBuf, &'static str)> {
    let (name, text) = SHIPPED.iter().find(|(shipped, _)| *shipped == name)?;
    Some((Path::new("profiles").join(format!("{name}.toml")), text))
}

/// Returns the shipped machine with a similar name, for a hint. Returns `None` if a file or a shipped machine has
/// exactly this name, or if no name is similar.
pub(super) fn meant(path: &Path) -> Option<&'static str> {
    let name = path.to_str().filter(|name| !path.exists() && text(name).is_none())?;
    isotherm_profile::nearest_or_longer(name, &names().collect::<Vec<_>>())
}

/// Loads a shipped machine, with the keys in `set` overridden. Returns its profile and its plant (simulated machine).
/// An unknown name is an error.
pub(super) fn with_plant(name: &str, set: &[(String, String)]) -> anyhow::Result<(Profile, PlantSpec)> {
    let Some((path, text)) = text(name) else {
        anyhow::bail!("there is no machine `{name}`; {}", isotherm_profile::allowed(name, names()));
    };
    let loaded = isotherm_profile::parse_with(&path, text, &FILES, set, &[])
        .map_err(|errors| anyhow::anyhow!("{errors}"))?;
    let plant =
        PlantSpec::shipped(name).ok_or_else(|| anyhow::anyhow!("the machine `{name}` has no plant"))??;
    Ok((loaded.profile, plant))
}

#[cfg(test)]
mod tests;

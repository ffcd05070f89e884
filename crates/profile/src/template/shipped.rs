//! Templates that are part of the program. The build script embeds the files of `profiles/devices`.

include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// Iterates over the names of the shipped templates.
pub fn names() -> impl Iterator<Item = &'static str> {
    TEMPLATES.iter().map(|(name, _)| *name)
}

/// Returns the text of the shipped template with this name. `None` if no shipped template has the name.
pub(super) fn text(name: &str) -> Option<&'static str> {
    TEMPLATES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Returns the text of the shipped DBC file with this name, as a template states it. `None` if no such file is shipped.
pub(crate) fn dbc(name: &str) -> Option<&'static str> {
    let name = name.strip_prefix("devices/")?.strip_suffix(".dbc")?;
    DBC_FILES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

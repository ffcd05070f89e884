//! The templates that are part of the program: what the build finds in `profiles/devices`.

include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// Their names.
pub fn names() -> impl Iterator<Item = &'static str> {
    TEMPLATES.iter().map(|(name, _)| *name)
}

/// The text of one.
pub(super) fn text(name: &str) -> Option<&'static str> {
    TEMPLATES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The text of a shipped DBC file, by the name that a template gives it.
pub(crate) fn dbc(name: &str) -> Option<&'static str> {
    let name = name.strip_prefix("devices/")?.strip_suffix(".dbc")?;
    DBC_FILES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

//! Templates that are part of the program. The build script embeds the files of `profiles/devices`.

include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// Names of the shipped templates.
pub fn names() -> impl Iterator<Item = &'static str> {
    TEMPLATES.iter().map(|(name, _)| *name)
}

/// Text of a shipped template.
pub(super) fn text(name: &str) -> Option<&'static str> {
    TEMPLATES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Text of a shipped DBC file, by its name in a template.
pub(crate) fn dbc(name: &str) -> Option<&'static str> {
    let name = name.strip_prefix("devices/")?.strip_suffix(".dbc")?;
    DBC_FILES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

//! Templates of the devices in a profile. Each template lists the signals and outputs that use its channels.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::document::{Section, entries};
use crate::sha256;

/// Template of a device, as the preview shows it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Template {
    /// Name of the template, as the key `template` of the device states it.
    pub name: String,
    /// Variant that the profile chooses. `None` if the template has no variants.
    pub variant: Option<String>,
    /// Manufacturer and type of the device.
    pub title: String,
    /// Manual or web page from which the data of the template was taken.
    pub source: String,
    /// Path of the user's own file. `None` for a shipped template.
    pub own_file: Option<String>,
    /// Text of the template file. The preview shows its SHA-256.
    pub text: Arc<str>,
    /// Notes for the user, which the preview shows.
    pub notes: Vec<String>,
    /// Facts that were not verified with the manual or on the device.
    pub unverified: Vec<String>,
    /// Checks of the template that are not made, each with the reason.
    pub unchecked: Vec<String>,
    /// Signals and outputs that use a channel of the template.
    pub uses: Vec<Use>,
}

impl Template {
    /// Preview of the template: its origin and its notes.
    pub(crate) fn preview(&self) -> Section {
        let variant = self.variant.as_ref().map_or(String::new(), |variant| format!(", variant {variant}"));
        let mut section = Section::default();
        section.line(format!("    template {}{variant}: {}; source: {}", self.name, self.title, self.source));
        section.lines(
            "      ",
            self.own_file.iter().map(|file| format!("read from {file}, not from the shipped templates")),
        );
        let sha256 = sha256(self.text.as_bytes());
        section.line(format!("      sha256 = \"{sha256}\""));
        section.lines("      note: ", &self.notes);
        section.lines("      not verified: ", &self.unverified);
        section.lines("      not checked before arming: ", &self.unchecked);
        entries!(section, name = &self.name, variant = &self.variant, title = &self.title);
        entries!(section, source = &self.source, own_file = &self.own_file, sha256 = &sha256);
        entries!(section, notes = &self.notes, unverified = &self.unverified, unchecked = &self.unchecked);
        section
    }
}

/// Signal or output that takes its registers from a template.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    /// Name of the signal or output in the profile.
    pub name: String,
    /// Name of the template's channel.
    pub channel: String,
    /// Keys of the channel that the profile sets itself, so that the values of the template do not apply.
    pub overridden: Vec<String>,
}

/// Templates by the name of their device.
pub(crate) type Templates = BTreeMap<String, Template>;

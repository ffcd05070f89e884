//! Device templates: knowledge about a type of device, as data. A profile inherits the keys that it does not set.
//!
//! A template is a TOML file. It contains groups of channels with their registers, types, sentinels and status bits,
//! targets for writing, checks before arming, and quirks. It also lists what has not been verified. The shipped
//! templates are part of the program. A file `devices/NAME.toml` next to the profile replaces the shipped template of
//! that name. Keys of the profile take precedence over those of the template.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde_json::{Map, Value};

use crate::document::{Section, entries};
use crate::error::Findings;
use crate::files::Files;
use crate::sha256;
use crate::source_map::{SourceMap, child};

mod changes;
mod channels;
mod checks;
mod conditions;
mod fill;
mod find;
mod outline;
mod schema;
mod shipped;

pub use changes::changes;
pub use outline::{Outline, on_modbus};
pub use schema::schema;
pub(crate) use shipped::dbc;
pub use shipped::names;

/// Template of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Template {
    /// Name of the template.
    pub name: String,
    /// Variant chosen by the profile.
    pub variant: Option<String>,
    /// Manufacturer and type.
    pub title: String,
    /// Manual or page that the template is taken from.
    pub source: String,
    /// Path of the user's own file. `None` for a shipped template.
    pub own_file: Option<String>,
    /// Text of the template.
    pub text: Cow<'static, str>,
    /// Notes for the user.
    pub notes: Vec<String>,
    /// Facts that were not verified with the manual or on the device.
    pub unverified: Vec<String>,
    /// Checks that are omitted, and why.
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
    /// Name in the profile.
    pub name: String,
    /// Name of the channel.
    pub channel: String,
    /// Keys of the template that the profile sets itself.
    pub overridden: Vec<String>,
}

/// Templates by the name of their device.
pub(crate) type Templates = BTreeMap<String, Template>;

/// Adds the keys of templates to the merged layers of a profile.
pub(crate) fn fill(
    profile: &mut Value,
    files: &Files<'_>,
    spans: &mut SourceMap,
    errors: &mut Findings,
) -> Templates {
    let Some(profile) = profile.as_object_mut() else { return Templates::new() };
    fill::Filling::new(profile, files, spans, errors).run()
}

/// Group of similar channels, checks or targets.
type Group = Map<String, Value>;

fn text<'v>(table: &'v Group, key: &str) -> Option<&'v str> {
    table.get(key).and_then(Value::as_str)
}

fn texts(table: &Group, key: &str) -> Vec<String> {
    let list = table.get(key).and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
}

/// Returns the names of one kind of table, in the order of the file.
fn in_order(profile: &Map<String, Value>, table: &str, spans: &SourceMap) -> Vec<String> {
    let names = profile.get(table).and_then(Value::as_object);
    let mut names: Vec<String> = names.into_iter().flat_map(Map::keys).cloned().collect();
    names.sort_by_key(|name| spans.rank(&child(table, name)));
    names
}

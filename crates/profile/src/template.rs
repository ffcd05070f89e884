//! Device templates: what is known of a make of device, as data, put under what a profile says of it.
//!
//! A template is a TOML file: groups of channels with their registers, types, sentinels and status bits, targets that
//! can be written, checks that are read before arming, quirks, and what of all that nobody has verified. The shipped
//! ones are part of the program; a file `devices/NAME.toml` beside the profile comes before the shipped one of its
//! name. What a profile spells out wins over its template, key by key.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde_json::{Map, Value};

use crate::document::Section;
use crate::error::Found;
use crate::files::Files;
use crate::sha256;
use crate::span::{Spans, child};

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

/// What a device has from its template.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Template {
    /// Its name.
    pub name: String,
    /// The variant that the profile chose.
    pub variant: Option<String>,
    /// Make and kind.
    pub title: String,
    /// The manual or page that it is taken from.
    pub source: String,
    /// The file, where it is the user's own and not the shipped one.
    pub own_file: Option<String>,
    /// All of it, as written.
    pub text: Cow<'static, str>,
    /// What a person should know who uses it.
    pub notes: Vec<String>,
    /// What nobody has verified against the manual or on the device.
    pub unverified: Vec<String>,
    /// Checks that are left out, and why.
    pub unchecked: Vec<String>,
    /// Signals and outputs that use a channel of it.
    pub uses: Vec<Use>,
}

impl Template {
    /// Where a device has its channels from, with what a person should know of that.
    pub(crate) fn preview(&self) -> Section {
        let variant = self.variant.as_ref().map_or(String::new(), |variant| format!(", variant {variant}"));
        let mut section = Section::default();
        section.line(format!("    template {}{variant}: {}; after {}", self.name, self.title, self.source));
        section.lines(
            "      ",
            self.own_file.iter().map(|file| format!("taken from {file}, not from the shipped ones")),
        );
        let sha256 = sha256(self.text.as_bytes());
        section.line(format!("      sha256 = \"{sha256}\""));
        section.lines("      note: ", &self.notes);
        section.lines("      not verified: ", &self.unverified);
        section.lines("      not checked before arming: ", &self.unchecked);
        section.entry("name", &self.name);
        section.entry("variant", &self.variant);
        section.entry("title", &self.title);
        section.entry("source", &self.source);
        section.entry("own_file", &self.own_file);
        section.entry("sha256", &sha256);
        section.entry("notes", &self.notes);
        section.entry("unverified", &self.unverified);
        section.entry("unchecked", &self.unchecked);
        section
    }
}

/// A signal or an output that has its registers from a template.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    /// Its name in the profile.
    pub name: String,
    /// The channel.
    pub channel: String,
    /// Keys that the profile spells out over the template.
    pub overridden: Vec<String>,
}

/// The template of each device that has one, by the device's name.
pub(crate) type Templates = BTreeMap<String, Template>;

/// Puts the templates under the merged layers of a profile.
pub(crate) fn fill(
    profile: &mut Value,
    files: &Files<'_>,
    spans: &mut Spans,
    errors: &mut Found,
) -> Templates {
    let Some(profile) = profile.as_object_mut() else { return Templates::new() };
    fill::Filling::new(profile, files, spans, errors).run()
}

/// A group of channels, checks or targets: one or several that are alike.
type Group = Map<String, Value>;

fn text<'v>(table: &'v Group, key: &str) -> Option<&'v str> {
    table.get(key).and_then(Value::as_str)
}

fn texts(table: &Group, key: &str) -> Vec<String> {
    let list = table.get(key).and_then(Value::as_array);
    list.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
}

/// The names of one kind of thing, in the order of the file.
fn in_order(profile: &Map<String, Value>, table: &str, spans: &Spans) -> Vec<String> {
    let names = profile.get(table).and_then(Value::as_object);
    let mut names: Vec<String> = names.into_iter().flat_map(Map::keys).cloned().collect();
    names.sort_by_key(|name| spans.rank(&child(table, name)));
    names
}

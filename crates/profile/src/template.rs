//! Device templates: data about a type of device, for example its registers and their scales. A profile takes
//! from the template every key that the profile does not set itself.
//!
//! A template is a TOML file. Its groups contain channels to read, targets to write, and checks that a device
//! must pass before an axis may write. A channel states its register, its type, its status bits, and the raw
//! values that mean "no measurement". A template also contains quirks (settings for peculiar devices), and
//! lists facts that have not been verified. The shipped templates are part of the program. A file
//! `devices/NAME.toml` next to the profile replaces the shipped template of that name. Keys of the profile
//! take precedence over those of the template.

use serde_json::Value;

use crate::error::Findings;
use crate::files::Files;
use crate::schemas::Schemas;
use crate::source_map::SourceMap;

mod changes;
mod channels;
mod checks;
mod conditions;
mod fill;
mod find;
mod group;
mod outline;
pub(crate) mod schema;
mod shipped;
mod used;

pub use crate::schemas::template_schema as schema;
pub use changes::changes;
pub use outline::{Outline, OutlineTarget, outlines};
pub(crate) use shipped::dbc;
pub use shipped::names;
pub(crate) use used::Templates;
pub use used::{Template, Use};

/// Adds the keys of templates to the merged layers of a profile. Returns the templates of the devices.
pub(crate) fn fill(
    profile: &mut Value,
    (files, schemas): (&Files<'_>, &Schemas),
    spans: &mut SourceMap,
    errors: &mut Findings,
) -> Templates {
    let Some(profile) = profile.as_object_mut() else { return Templates::new() };
    fill::Filling::new(profile, (files, schemas), spans, errors).run()
}

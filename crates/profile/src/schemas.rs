//! JSON schemas of a profile and of a device template.

use std::sync::{LazyLock, OnceLock};

use serde_json::Value;

use crate::tables::schema::of_profile;
use crate::template::schema::of_template;

/// Schemas of a profile and of the templates that it uses.
pub(crate) struct Schemas {
    pub(crate) profile: Value,
    template: OnceLock<Value>,
}

/// Schemas that are generated once and then kept, because generating them takes longer than reading a small profile.
static KEPT: LazyLock<Schemas> = LazyLock::new(Schemas::new);

impl Schemas {
    /// Generates the schema of a profile. The schema of a template is generated when it is first used.
    pub(crate) fn new() -> Schemas {
        Schemas { profile: of_profile(), template: OnceLock::new() }
    }

    pub(crate) fn kept() -> &'static Schemas {
        &KEPT
    }

    pub(crate) fn template(&self) -> &Value {
        self.template.get_or_init(|| of_template(&self.profile))
    }
}

/// JSON Schema of a profile, draft 2020-12. Editors use it for completion, and the loader checks against it.
pub fn schema() -> &'static Value {
    &Schemas::kept().profile
}

/// JSON Schema of a device template, draft 2020-12.
pub fn template_schema() -> &'static Value {
    Schemas::kept().template()
}

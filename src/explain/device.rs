//! What a device has from its template, and what is read of it before arming.

use std::fmt;

use serde::Serialize;

use crate::profile::{Device, Expected, Template};

/// One register that is read before arming.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckExplained {
    /// `coil:268 (00269)`.
    pub register: String,
    /// What it must read.
    pub equals: i64,
    /// What that is.
    pub what: String,
}

/// A device template as it is used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TemplateExplained {
    /// Its name.
    pub name: String,
    /// The variant that the profile chose.
    pub variant: Option<String>,
    /// Make and kind.
    pub title: String,
    /// The manual or page that it is taken from.
    pub source: String,
    /// The file, where it is not the shipped one.
    pub own_file: Option<String>,
    /// What a person should know.
    pub notes: Vec<String>,
    /// What nobody has verified.
    pub unverified: Vec<String>,
    /// Checks that are left out, and why.
    pub unchecked: Vec<String>,
}

impl CheckExplained {
    pub(super) fn of(expected: &Expected) -> CheckExplained {
        let (register, what) = (expected.to_string(), expected.what.clone());
        CheckExplained { register, equals: expected.equals, what }
    }
}

impl TemplateExplained {
    pub(super) fn of(template: &Template) -> TemplateExplained {
        TemplateExplained {
            name: template.name.clone(),
            variant: template.variant.clone(),
            title: template.title.clone(),
            source: template.source.clone(),
            own_file: template.own_file.clone(),
            notes: template.notes.clone(),
            unverified: template.unverified.clone(),
            unchecked: template.unchecked.clone(),
        }
    }
}

/// `channel 0 of icp-das-m7019r; the profile says scale`.
pub(super) fn channel(device: &Device, user: &str) -> Option<String> {
    let template = device.template.as_ref()?;
    let used = template.uses.iter().find(|used| used.name == user)?;
    let own = match used.overridden.as_slice() {
        [] => String::new(),
        keys => format!("; the profile itself says {}", keys.join(", ")),
    };
    Some(format!("channel {} of {}{own}", used.channel, template.name))
}

impl fmt::Display for CheckExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "before arming {} must read {}: {}", self.register, self.equals, self.what)
    }
}

impl fmt::Display for TemplateExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let variant = self.variant.as_ref().map_or(String::new(), |variant| format!(", variant {variant}"));
        writeln!(f, "    template {}{variant}: {}; after {}", self.name, self.title, self.source)?;
        if let Some(file) = &self.own_file {
            writeln!(f, "      taken from {file}, not from the shipped ones")?;
        }
        for note in &self.notes {
            writeln!(f, "      note: {note}")?;
        }
        for what in &self.unverified {
            writeln!(f, "      not verified: {what}")?;
        }
        for what in &self.unchecked {
            writeln!(f, "      not checked before arming: {what}")?;
        }
        Ok(())
    }
}

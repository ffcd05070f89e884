//! What a device has from its template, and what is read of it before arming.

use std::fmt;

use serde::Serialize;

use crate::{Device, Expected, Template};

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

impl CheckExplained {
    pub(super) fn of(expected: &Expected) -> CheckExplained {
        let (register, what) = (expected.to_string(), expected.what.clone());
        CheckExplained { register, equals: expected.equals, what }
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

/// Where a device has its channels from, with what a person should know of that.
pub(super) fn write_template(f: &mut fmt::Formatter<'_>, template: &Template) -> fmt::Result {
    let variant = template.variant.as_ref().map_or(String::new(), |variant| format!(", variant {variant}"));
    writeln!(f, "    template {}{variant}: {}; after {}", template.name, template.title, template.source)?;
    if let Some(file) = &template.own_file {
        writeln!(f, "      taken from {file}, not from the shipped ones")?;
    }
    for note in &template.notes {
        writeln!(f, "      note: {note}")?;
    }
    for what in &template.unverified {
        writeln!(f, "      not verified: {what}")?;
    }
    for what in &template.unchecked {
        writeln!(f, "      not checked before arming: {what}")?;
    }
    Ok(())
}

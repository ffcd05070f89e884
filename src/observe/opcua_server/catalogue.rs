//! Catalogue of the status fields, from which the nodes are made: names, types, units and descriptions.
//!
//! The catalogue is the chapter `docs/status.md` of the manual. The chapter is made from the comments of the status
//! structs, and a test compares the two. A new field of the status therefore becomes a new node without a change of
//! this module.

/// Chapter of the manual with all fields of the status.
const CHAPTER: &str = include_str!("../../../docs/status.md");

/// Title of the chapter's section about the machine as a whole.
pub(super) const MACHINE: &str = "The whole";
/// Title of the section about the axes.
pub(super) const AXES: &str = "axes[]";
/// Title of the section about the signals.
pub(super) const SIGNALS: &str = "signals[]";
/// Title of the section about the outputs.
pub(super) const OUTPUTS: &str = "outputs[]";
/// Title of the section about the devices.
pub(super) const DEVICES: &str = "devices[]";
/// Title of the section about the active alarms.
pub(super) const ALARMS: &str = "alarms[]";
/// Title of the section about the last events.
pub(super) const EVENTS: &str = "events[]";

/// Fields that have no node. Another node has the same content in another form, or the content changes with every
/// update.
const LEFT_OUT: [&str; 14] = [
    // The name is a part of the identifier, the label is the display name, the unit is a property.
    "name",
    "label",
    "unit",
    // Ages are the source times of the values that they belong to.
    "age_s",
    "verified_age_s",
    "now",
    "uptime_s",
    "machine_on_s",
    "expires_s",
    "waits_s",
    "requests",
    "writes_done",
    // The MQTT broker has its own clients.
    "mqtt",
    // Only a virtual machine knows it.
    "truth",
];

/// Field of the status, as the manual describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Field {
    /// Name in JSON.
    pub(super) name: &'static str,
    /// Type of the value.
    pub(super) kind: Kind,
    /// Unit of the value; empty if the value has no unit, or if the unit depends on the item.
    pub(super) unit: &'static str,
    /// Description of the field in the manual: one or more sentences.
    pub(super) about: &'static str,
}

/// Type of a status field that has nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Floating-point number.
    Number,
    /// Whole number, not negative.
    Count,
    /// `true` or `false`.
    Flag,
    /// Text.
    Text,
    /// List of texts.
    Texts,
    /// Object; contains the title of the section that describes the fields of the object.
    Object(&'static str),
}

/// Returns the fields of a section that have nodes, in the order of the chapter.
pub(super) fn fields(section: &str) -> Vec<Field> {
    let heading = if section == MACHINE { format!("## {section}") } else { format!("## `{section}`") };
    let lines = CHAPTER.lines().skip_while(|line| **line != heading).skip(1);
    lines.take_while(|line| !line.starts_with("## ")).filter_map(field).collect()
}

/// Parses a row of a table in the chapter. `None` for any other line, and for a field without nodes.
fn field(line: &'static str) -> Option<Field> {
    let row = line.strip_prefix("| `")?;
    let (name, rest) = row.split_once("` | ")?;
    let (is, rest) = rest.split_once(" | ")?;
    let (unit, about) = rest.split_once("| ")?;
    let about = about.strip_suffix('|').unwrap_or(about).trim();
    let field = Field { name, kind: kind(is)?, unit: unit.trim(), about };
    (!LEFT_OUT.contains(&name)).then_some(field)
}

fn kind(is: &'static str) -> Option<Kind> {
    let is = is.strip_suffix("; may be missing").unwrap_or(is);
    let is = is.strip_suffix(" or null").unwrap_or(is);
    Some(match is {
        "number" => Kind::Number,
        "whole number" => Kind::Count,
        "`true`, `false`" => Kind::Flag,
        "text" => Kind::Text,
        "list of text" => Kind::Texts,
        _ => Kind::Object(is.strip_prefix("[`")?.split_once("`]")?.0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(section: &str, name: &str) -> Field {
        let found = fields(section).into_iter().find(|field| field.name == name);
        found.unwrap_or_else(|| panic!("{section} has no {name}"))
    }

    #[test]
    fn a_field_has_the_type_the_unit_and_the_description_of_the_manual() {
        for (section, name, kind, unit) in [
            (AXES, "cz_um", Kind::Number, "µm"),
            (AXES, "verified_um", Kind::Number, "µm"),
            (AXES, "state", Kind::Text, ""),
            (AXES, "acted", Kind::Texts, ""),
            (AXES, "warned", Kind::Flag, ""),
            (AXES, "armed", Kind::Flag, ""),
            (AXES, "probe", Kind::Object("axes[].probe"), ""),
            ("axes[].probe", "correction_um", Kind::Number, "µm"),
            (SIGNALS, "value", Kind::Number, ""),
            (SIGNALS, "quality", Kind::Text, ""),
            (OUTPUTS, "shares", Kind::Object("outputs[].shares"), ""),
            (ALARMS, "cause", Kind::Text, ""),
            (EVENTS, "level", Kind::Text, ""),
            (MACHINE, "ready", Kind::Flag, ""),
            (MACHINE, "log_dropped", Kind::Count, ""),
        ] {
            let found = one(section, name);
            assert_eq!((found.kind, found.unit), (kind, unit), "{section} {name}");
            assert!(found.about.ends_with('.') && found.about.len() > 8, "{found:?}");
        }
    }

    #[test]
    fn every_section_and_every_object_in_it_has_fields() {
        let mut open = vec![MACHINE, AXES, SIGNALS, OUTPUTS, DEVICES, ALARMS, EVENTS];
        while let Some(section) = open.pop() {
            let found = fields(section);
            assert!(!found.is_empty(), "{section}");
            open.extend(found.iter().filter_map(|field| match field.kind {
                Kind::Object(inner) => Some(inner),
                _ => None,
            }));
        }
    }

    #[test]
    fn each_field_that_is_left_out_exists() {
        for name in LEFT_OUT {
            assert!(CHAPTER.contains(&format!("| `{name}` |")), "{name}");
        }
    }
}

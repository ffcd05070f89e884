//! `label`: display name of a machine, an axis, a signal or a device, in any writing system, for example Chinese. It is
//! shown next to the name, and never replaces the name.

use super::KeyContext;

/// Largest length of a label, in characters. A longer label does not fit next to a value on the web page.
const LONGEST: usize = 60;

/// Checks a label. Returns an empty text if there is none.
pub(super) fn resolve(at: &KeyContext<'_>, raw: Option<&String>) -> String {
    let Some(label) = raw.map(|label| label.trim()) else { return String::new() };
    let count = label.chars().count();
    if label.is_empty() {
        at.invalid("the label is empty", "write a name to display, or remove `label`");
    } else if count > LONGEST {
        at.invalid(
            format!("a label of {count} characters is too long for the web page"),
            "allowed: up to 60 characters",
        );
    }
    label.to_owned()
}

/// Formats a name with its label, if it has one: `bed (床温)`.
pub fn labelled(name: &str, label: &str) -> String {
    if label.is_empty() { name.to_owned() } else { format!("{name} ({label})") }
}

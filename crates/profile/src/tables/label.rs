//! `label`: what people call a machine, an axis, a signal or a device, in any script. It stands beside the name, and is
//! never used in its place.

use super::At;

/// More does not fit beside a figure.
const LONGEST: usize = 60;

/// Empty where there is none.
pub(super) fn resolve(at: &At<'_>, raw: Option<&String>) -> String {
    let Some(label) = raw.map(|label| label.trim()) else { return String::new() };
    let count = label.chars().count();
    if label.is_empty() {
        at.wrong("the label is empty", "write what people call it, or remove `label`");
    } else if label.chars().any(is_unseen) {
        let help = "write it in one line, of characters that are seen";
        at.wrong("the label has characters that are not seen", help);
    } else if count > LONGEST {
        at.wrong(format!("a label of {count} characters does not fit beside a figure"), "allowed: up to 60");
    }
    label.to_owned()
}

/// What breaks a line, or turns the direction of what stands behind it.
fn is_unseen(one: char) -> bool {
    one.is_control()
        || matches!(one, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

/// A name with its label, if it has one: `bed (床温)`.
pub fn labelled(name: &str, label: &str) -> String {
    if label.is_empty() { name.to_owned() } else { format!("{name} ({label})") }
}

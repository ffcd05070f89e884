//! Hints about faults in the output of a verb. Each hint is printed once, below the first line that needs it.

use std::collections::BTreeSet;

/// Hints that have been printed already.
#[derive(Debug, Default)]
pub(super) struct Hints(BTreeSet<String>);

impl Hints {
    /// Returns the line of a hint with an indentation of `indent` blanks. Returns an empty text if there is no hint, or
    /// if this hint was printed already.
    pub(super) fn line(&mut self, indent: usize, hint: Option<&str>) -> String {
        match hint.filter(|hint| !hint.is_empty() && self.0.insert((*hint).to_owned())) {
            Some(hint) => format!("{:indent$}to do: {hint}\n", ""),
            None => String::new(),
        }
    }

    /// Removes a hint from the end of a text if the hint was printed already, and returns the rest.
    pub(super) fn without<'t>(&self, text: &'t str) -> &'t str {
        let hint = self.0.iter().find(|hint| text.ends_with(hint.as_str()));
        cause(text, hint.map(String::as_str))
    }
}

/// Removes this hint from the end of a text, and returns the rest: the cause of the fault.
pub(super) fn cause<'t>(text: &'t str, hint: Option<&str>) -> &'t str {
    let hint = hint.filter(|hint| !hint.is_empty());
    let Some(before) = hint.and_then(|hint| text.strip_suffix(hint)) else { return text };
    before.strip_suffix("; ").or_else(|| before.strip_suffix(": ")).unwrap_or(before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::explained::Explained;

    #[test]
    fn cause_and_hint_are_parted_again() {
        for hint in ["is the port right?", "mend the cable"] {
            let joined = Explained::new("nothing listens", hint).to_string();
            assert_eq!(cause(&joined, Some(hint)), "nothing listens", "{joined}");
            assert_eq!(cause(&joined, Some("something else")), joined);
            assert_eq!((cause(&joined, None), cause(&joined, Some(""))), (joined.as_str(), joined.as_str()));
        }
    }

    #[test]
    fn each_hint_is_printed_once() {
        let mut hints = Hints::default();
        assert_eq!(hints.without("broken; mend it"), "broken; mend it");
        assert_eq!(hints.line(4, Some("mend it")), "    to do: mend it\n");
        assert_eq!((hints.line(4, Some("mend it")), hints.line(4, None)), (String::new(), String::new()));
        assert_eq!(hints.without("broken; mend it"), "broken");
        assert_eq!(hints.line(2, Some("is it on?")), "  to do: is it on?\n");
    }
}

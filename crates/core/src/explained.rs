//! Cause of a fault, with a hint for its repair, for people and programs. [`Cause`] detects when a known
//! fault has another cause.

use std::borrow::Cow;
use std::fmt;

use serde::{Serialize, Serializer};

/// Cause of a fault, with an optional hint. `Display` and the serialised form join cause and hint into one sentence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Explained {
    /// Cause of the fault, without the remedy.
    pub cause: String,
    /// Remedy for the cause; `None` if no remedy is known.
    pub hint: Option<Cow<'static, str>>,
}

impl Explained {
    /// Creates an explanation from a cause and its hint.
    pub fn new(cause: impl Into<String>, hint: impl Into<Cow<'static, str>>) -> Explained {
        Explained { cause: cause.into(), hint: Some(hint.into()) }
    }

    /// Adds this hint, unless the cause already has one.
    #[must_use]
    pub fn or_hint(self, hint: impl Into<Cow<'static, str>>) -> Explained {
        Explained { hint: self.hint.or_else(|| Some(hint.into())), ..self }
    }

    /// Replaces the cause by the text that `sentence` makes from it. The hint stays.
    #[must_use]
    pub fn within(self, sentence: impl FnOnce(&str) -> String) -> Explained {
        Explained { cause: sentence(&self.cause), ..self }
    }
}

impl fmt::Display for Explained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.cause)?;
        let Some(hint) = &self.hint else { return Ok(()) };
        let mark = if hint.contains('?') { ':' } else { ';' };
        write!(f, "{mark} {hint}")
    }
}

impl Serialize for Explained {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<T: Into<String>> From<T> for Explained {
    fn from(cause: T) -> Explained {
        Explained { cause: cause.into(), hint: None }
    }
}

/// Cause of a fault that was reported last. Detects when another cause has lasted long enough to be reported.
#[derive(Clone, Debug)]
pub struct Cause<T> {
    reported: T,
    /// Cause that now differs from the reported cause, and how often in a row it was found. `None` if the reported
    /// cause was found last.
    other: Option<(T, u32)>,
}

impl<T: PartialEq> Cause<T> {
    /// Creates the state from a cause that has just been reported.
    pub fn new(reported: T) -> Cause<T> {
        Cause { reported, other: None }
    }

    /// Returns the cause that was reported last.
    pub fn reported(&self) -> &T {
        &self.reported
    }

    /// Records the cause that was found now. Returns true if the cause must be reported: it differs from the reported
    /// cause and was found `often` times in a row. Alternating causes are never reported.
    pub fn is_now(&mut self, cause: T, often: u32) -> bool {
        if self.reported == cause {
            self.other = None;
            return false;
        }
        let found = self.other.take().filter(|(other, _)| *other == cause).map_or(1, |(_, found)| found + 1);
        if found < often {
            self.other = Some((cause, found));
            return false;
        }
        *self = Cause::new(cause);
        true
    }

    /// Records the cause that was found now, for a fault that may be new (`known` is `None`). Returns true if the cause
    /// must be reported: the first cause at once, a different cause after it was found `often` times in a row.
    pub fn is_news(known: &mut Option<Cause<T>>, cause: T, often: u32) -> bool {
        match known {
            Some(known) => known.is_now(cause, often),
            None => {
                *known = Some(Cause::new(cause));
                true
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_cause_is_news_once_it_was_found_twice_in_a_row() {
        let mut cause = None;
        let found = ["refused", "timeout", "refused", "timeout", "certificate", "certificate", "certificate"];
        assert_eq!(
            found.map(|found| Cause::is_news(&mut cause, found, 2)),
            [true, false, false, false, false, true, false]
        );
    }

    #[test]
    fn cause_and_hint_are_one_sentence_for_people() {
        let refused = Explained::new("nothing listens there", "is the port right?");
        assert_eq!(refused.to_string(), "nothing listens there: is the port right?");
        assert_eq!(
            serde_json::to_string(&refused).unwrap(),
            r#""nothing listens there: is the port right?""#
        );
        assert_eq!(serde_json::to_string(&Explained::from("broken")).unwrap(), r#""broken""#);
        assert_eq!(refused.clone().or_hint("no"), refused);
        let within =
            Explained::from("broken").or_hint("mend it").within(|cause| format!("bus cell: {cause}"));
        assert_eq!(within.to_string(), "bus cell: broken; mend it");
    }
}

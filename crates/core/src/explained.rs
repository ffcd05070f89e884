//! Cause and hint of a fault for people and programs, and the detection of a changed cause.

use std::borrow::Cow;
use std::fmt;

use serde::{Serialize, Serializer};

/// Cause of a fault, with an optional hint. `Display` and the serialised form join both into one sentence.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Explained {
    /// Cause, without the remedy.
    pub cause: String,
    /// Remedy for the cause.
    pub hint: Option<Cow<'static, str>>,
}

impl Explained {
    /// Builds a cause with its hint.
    pub fn new(cause: impl Into<String>, hint: impl Into<Cow<'static, str>>) -> Explained {
        Explained { cause: cause.into(), hint: Some(hint.into()) }
    }

    /// Adds a hint unless there is one.
    #[must_use]
    pub fn or_hint(self, hint: impl Into<Cow<'static, str>>) -> Explained {
        Explained { hint: self.hint.or_else(|| Some(hint.into())), ..self }
    }

    /// Replaces the cause by a sentence made from it, and keeps the hint.
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

/// Reported cause of a fault. Each lasting change of the cause is reported once.
#[derive(Clone, Debug)]
pub struct Cause<T> {
    reported: T,
    /// Different cause that was found since, and how often in a row.
    other: Option<(T, u32)>,
}

impl<T: PartialEq> Cause<T> {
    /// Starts with a cause that has just been reported.
    pub fn new(reported: T) -> Cause<T> {
        Cause { reported, other: None }
    }

    /// Records the present cause. Returns whether to report it, which resets the reported cause. A cause is reported if
    /// it differs from the reported one, and was found `often` times in a row. Alternating causes are not reported.
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

    /// Records the present cause of a fault that may be new. Returns whether to report it: the first cause, and each
    /// lasting change.
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

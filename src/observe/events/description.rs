//! Description of an event: its kind, its level, and the parts of its sentence.

use std::borrow::Cow;

use isotherm_core::events::{EventKind, Level};
use isotherm_core::explained::Explained;
use serde_json::Value;

/// Sentence of an event, before the catalogue adds level and hint.
pub(super) struct Sentence {
    about: String,
    why: Option<Explained>,
    is_well: bool,
    takes_hint: bool,
}

/// Sentence without a cause.
pub(super) fn plain(about: impl Into<String>) -> Sentence {
    Sentence { about: about.into(), why: None, is_well: false, takes_hint: true }
}

/// Sentence with a cause. `about` is empty if the cause contains the subject. A cause without a hint gets the one of
/// the catalogue.
pub(super) fn caused(about: impl Into<String>, why: impl Into<Explained>) -> Sentence {
    Sentence { why: Some(why.into()), ..plain(about) }
}

/// Hint of the catalogue, with the values of the fields that it names.
pub(super) fn hint_with(kind: EventKind, fields: &[(&str, &str)]) -> String {
    let hint = kind.hint().unwrap_or_default().to_owned();
    fields.iter().fold(hint, |hint, (name, value)| hint.replace(&format!("{{{name}}}"), value))
}

impl Sentence {
    /// Sets that this event reports no trouble, although others of its kind do.
    pub(super) fn well(self) -> Sentence {
        Sentence { is_well: true, ..self }
    }

    /// Sets that there is nothing to do.
    pub(super) fn without_hint(self) -> Sentence {
        Sentence { takes_hint: false, ..self }
    }

    /// Adds level and hint of a kind.
    pub(super) fn of(self, kind: EventKind) -> EventDescription {
        let Sentence { about, mut why, is_well, takes_hint } = self;
        let level = if is_well { Level::Info } else { kind.level() };
        debug_assert!(level == Level::Info || why.is_some(), "{kind:?} reports trouble without a cause");
        if let Some(why) = &mut why
            && takes_hint
            && level != Level::Info
        {
            why.hint = why.hint.take().or_else(|| kind.hint().map(Cow::Borrowed));
        }
        EventDescription { kind, level, about, why }
    }
}

/// Description of an event.
pub(super) struct EventDescription {
    pub(super) kind: EventKind,
    pub(super) level: Level,
    /// Subject of the event, without the cause.
    about: String,
    /// Cause and hint; `None` if nothing is wrong.
    why: Option<Explained>,
}

impl EventDescription {
    /// Returns the text: subject, cause and hint.
    pub(super) fn text(&self) -> String {
        let why = self.why.iter().map(ToString::to_string).filter(|why| !why.is_empty());
        let about = Some(&self.about).filter(|about| !about.is_empty()).cloned();
        about.into_iter().chain(why).collect::<Vec<_>>().join(": ")
    }

    /// Adds cause and hint to the data for programs.
    pub(super) fn explain(&self, data: &mut Value) {
        let (Some(Explained { cause, hint }), Some(fields)) = (&self.why, data.as_object_mut()) else {
            return;
        };
        fields.insert("cause".to_owned(), cause.as_str().into());
        if let Some(hint) = hint {
            fields.insert("hint".to_owned(), hint.as_ref().into());
        }
    }
}

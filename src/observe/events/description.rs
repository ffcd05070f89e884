//! Description of an event: its kind, its level, and the parts of its sentence.

use std::borrow::Cow;

use isotherm_core::events::{EventKind, Level};
use isotherm_core::explained::Explained;
use serde_json::Value;

/// Sentence of an event, before the level and the hint from the catalogue are added.
pub(super) struct Sentence {
    about: String,
    why: Option<Explained>,
    is_well: bool,
    takes_hint: bool,
}

/// Makes a sentence without a cause.
pub(super) fn plain(about: impl Into<String>) -> Sentence {
    Sentence { about: about.into(), why: None, is_well: false, takes_hint: true }
}

/// Makes a sentence with a cause. `about` is empty if the cause contains the subject. If the cause has no hint, the
/// hint of the catalogue is added later.
pub(super) fn caused(about: impl Into<String>, why: impl Into<Explained>) -> Sentence {
    Sentence { why: Some(why.into()), ..plain(about) }
}

/// Returns the hint that the catalogue has for this kind. Each `{name}` in the hint is replaced by the value of the
/// field `name`.
pub(super) fn hint_with(kind: EventKind, fields: &[(&str, &str)]) -> String {
    let hint = kind.hint().unwrap_or_default().to_owned();
    fields.iter().fold(hint, |hint, (name, value)| hint.replace(&format!("{{{name}}}"), value))
}

impl Sentence {
    /// Gives this event the level `Info`, although other events of the same kind report a fault.
    pub(super) fn well(self) -> Sentence {
        Sentence { is_well: true, ..self }
    }

    /// Omits the hint of the catalogue, because the operator need not act, or because the hint does not fit
    /// the cause.
    pub(super) fn without_hint(self) -> Sentence {
        Sentence { takes_hint: false, ..self }
    }

    /// Adds the level and the hint that the catalogue has for this kind.
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

/// Description of an event: kind, level, and the parts of the text.
pub(super) struct EventDescription {
    pub(super) kind: EventKind,
    pub(super) level: Level,
    /// First part of the sentence, which names the subject. It does not contain the cause.
    about: String,
    /// Cause and hint; `None` if nothing is wrong.
    why: Option<Explained>,
}

impl EventDescription {
    /// Returns the full text of the event: subject, cause and hint.
    pub(super) fn text(&self) -> String {
        let why = self.why.iter().map(ToString::to_string).filter(|why| !why.is_empty());
        let about = Some(&self.about).filter(|about| !about.is_empty()).cloned();
        about.into_iter().chain(why).collect::<Vec<_>>().join(": ")
    }

    /// Returns the text of the event without the hint: subject and cause.
    pub(super) fn text_without_hint(mut self) -> String {
        self.why.iter_mut().for_each(|why| why.hint = None);
        self.text()
    }

    /// Adds the fields `cause` and `hint` to the data for programs.
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

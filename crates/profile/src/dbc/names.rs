//! Names of messages and signals in a DBC file: short names, long names, and names that occur twice.
//!
//! An entry of a DBC file can contain names of at most 32 characters. Editors shorten a longer name in the entry, and
//! store the complete name in an attribute.

use std::collections::HashMap;

use can_dbc::{AttributeValue, Message, MessageId, Signal};

use super::{DbcFile, Wrong};
use crate::error::allowed;

/// Attribute of a DBC file with the long name of a message.
const LONG_MESSAGE: &str = "SystemMessageLongSymbol";
/// Attribute of a DBC file with the long name of a signal.
const LONG_SIGNAL: &str = "SystemSignalLongSymbol";

/// Line of the file that begins the description of a message or a signal, with its short name.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Entry<'t> {
    Message(&'t str),
    Signal(&'t str),
}

impl DbcFile {
    /// Returns the message with this short or long name.
    ///
    /// # Errors
    /// No message has this name, or several have it.
    pub(super) fn message(&self, name: &str) -> Result<&Message, Wrong> {
        let long: Vec<MessageId> = (self.long_messages())
            .filter(|(_, long_name)| *long_name == name)
            .map(|(message, _)| message)
            .collect();
        let is_meant = |message: &&Message| message.name == name || long.contains(&message.id);
        let mut found = self.dbc.messages.iter().filter(is_meant);
        let Some(message) = found.next() else {
            let help = allowed(name, self.message_names());
            return Err(Wrong::about(format!("the DBC file has no message `{name}`"), help));
        };
        let Some(other) = found.next() else { return Ok(message) };
        let help = format!(
            "remove or rename one of the two messages in the DBC file; their identifiers are {} and {}",
            shown(message.id),
            shown(other.id)
        );
        let twice = self.entries().filter(|(_, entry)| *entry == Entry::Message(name)).nth(1);
        let at = twice.map(|(line, _)| (line, 1));
        Err(Wrong { at, message: format!("the DBC file has two messages `{name}`"), help })
    }

    /// Returns the signal with this short or long name in a message.
    ///
    /// # Errors
    /// The message has no signal of this name, or it has several. Or another message has the same identifier and a
    /// signal of this name.
    pub(super) fn signal_in<'f>(&'f self, message: &'f Message, name: &str) -> Result<&'f Signal, Wrong> {
        let long: Vec<&str> = (self.long_signals(message.id))
            .filter(|(_, long_name)| *long_name == name)
            .map(|(signal, _)| signal)
            .collect();
        let is_meant = |signal: &&Signal| signal.name == name || long.contains(&signal.name.as_str());
        let mut found = message.signals.iter().filter(is_meant);
        let Some(signal) = found.next() else {
            let help = allowed(name, self.signal_names(message));
            let what = format!("message `{}` of the DBC file has no signal `{name}`", message.name);
            return Err(Wrong::about(what, help));
        };
        // Types and multiplexers refer to a signal by its short name, which must therefore be unique too.
        let same_name = message.signals.iter().filter(|other| other.name == signal.name).count();
        if found.next().is_some() || same_name > 1 {
            let (owner, own) = (Entry::Message(&message.name), Entry::Signal(&signal.name));
            let block = self.entries().skip_while(|(_, entry)| *entry != owner).skip(1);
            let block = block.take_while(|(_, entry)| matches!(entry, Entry::Signal(_)));
            let at = block.filter(|(_, entry)| *entry == own).nth(1).map(|(line, _)| (line, 1));
            let message = format!("message `{}` of the DBC file has two signals `{name}`", message.name);
            let help = "remove or rename one of the two signals in the DBC file".to_owned();
            return Err(Wrong { at, message, help });
        }
        let is_same = |other: &&Message| {
            other.id == message.id
                && other.name != message.name
                && other.signals.iter().any(|known| known.name == signal.name)
        };
        if let Some(other) = self.dbc.messages.iter().find(is_same) {
            // Each signal that both have gives the same error, which is reported once.
            let is_either = |known: &&Message| known.name == message.name || known.name == other.name;
            let (first, second) = match self.dbc.messages.iter().find(is_either) {
                Some(first) if first.name == other.name => (other, message),
                _ => (message, other),
            };
            let at = self.entries().find(|(_, entry)| *entry == Entry::Message(&second.name));
            let at = at.map(|(line, _)| (line, 1));
            let message = format!(
                "messages `{}` and `{}` of the DBC file have the same identifier {} and signals of the same name",
                first.name,
                second.name,
                shown(first.id)
            );
            let help = "remove one of the two messages from the DBC file".to_owned();
            return Err(Wrong { at, message, help });
        }
        Ok(signal)
    }

    /// Returns the names of all messages. A message with a long name is listed by its long name.
    pub(super) fn message_names(&self) -> Vec<&str> {
        let long: HashMap<MessageId, &str> = self.long_messages().collect();
        let messages = self.dbc.messages.iter();
        messages.map(|message| long.get(&message.id).copied().unwrap_or(message.name.as_str())).collect()
    }

    /// Returns the names of all signals of a message. A signal with a long name is listed by its long name.
    fn signal_names<'f>(&'f self, message: &'f Message) -> Vec<&'f str> {
        let long: HashMap<&str, &str> = self.long_signals(message.id).collect();
        let names = message.signals.iter().map(|signal| signal.name.as_str());
        names.map(|name| long.get(name).copied().unwrap_or(name)).collect()
    }

    /// Iterates over the messages that have a long name. Each item is the identifier and the long name.
    fn long_messages(&self) -> impl Iterator<Item = (MessageId, &str)> {
        let values = self.dbc.attribute_values_message.iter().filter(|known| known.name == LONG_MESSAGE);
        values.filter_map(|known| Some((known.message_id, text(&known.value)?)))
    }

    /// Iterates over the signals of a message that have a long name. Each item is the short name and the long name.
    fn long_signals(&self, message: MessageId) -> impl Iterator<Item = (&str, &str)> {
        let values = self.dbc.attribute_values_signal.iter();
        let own = values.filter(move |known| known.message_id == message && known.name == LONG_SIGNAL);
        own.filter_map(|known| Some((known.signal_name.as_str(), text(&known.value)?)))
    }

    /// Iterates over the lines that begin the description of a message or a signal. Each item is the line number,
    /// counted from 1, and the entry.
    fn entries(&self) -> impl Iterator<Item = (usize, Entry<'_>)> {
        self.text.lines().enumerate().filter_map(|(place, line)| Some((place + 1, entry(line)?)))
    }
}

/// Returns the message or signal whose description begins in this line. `None` if the line begins neither.
fn entry(line: &str) -> Option<Entry<'_>> {
    let line = line.trim_start();
    let name = |text: &str| text.find([':', ' ', '\t']).unwrap_or(text.len());
    if let Some(rest) = line.strip_prefix("BO_ ") {
        let (_, rest) = rest.trim_start().split_once([' ', '\t'])?;
        let rest = rest.trim_start();
        return Some(Entry::Message(&rest[..name(rest)]));
    }
    let rest = line.strip_prefix("SG_ ")?.trim_start();
    Some(Entry::Signal(&rest[..name(rest)]))
}

fn text(value: &AttributeValue) -> Option<&str> {
    if let AttributeValue::String(text) = value { Some(text) } else { None }
}

fn shown(id: MessageId) -> String {
    match id {
        MessageId::Standard(id) => format!("{id:#05x}"),
        MessageId::Extended(id) => format!("{id:#010x}"),
    }
}

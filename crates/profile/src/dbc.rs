//! Reader of DBC files. A DBC file describes CAN frames (its `messages`) and the values in the bits of these frames
//! (its `signals`). The reader finds the frames and bits of a signal by the name of the signal.

use std::collections::BTreeMap;
use std::rc::Rc;

use can_dbc::{
    AttributeDefinition, AttributeValue, AttributeValueType, ByteOrder as DbcOrder, Dbc, Message, MessageId,
    MultiplexIndicator, Signal, SignalExtendedValueType, ValueType,
};

use crate::file_kind::{self, FileKind};
use isotherm_core::border::beyond;
use isotherm_core::codec::{BitField, BitKind, ByteOrder, CanId, CanMatch, Field, Selector};

mod names;
mod unit;

pub(crate) use unit::FileUnit;

/// Names of the frame formats, indexed by the value of the DBC attribute `VFrameFormat`. This table is used if the file
/// stores the value as a plain number, without a list of names.
const FORMATS: [&str; 16] = [
    "StandardCAN",
    "ExtendedCAN",
    "reserved",
    "J1939PG",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "reserved",
    "StandardCAN_FD",
    "ExtendedCAN_FD",
];

/// Largest depth of nested multiplexers. A multiplexer is a CAN signal whose value selects the other signals of a
/// frame.
const DEEPEST: usize = 8;

/// Length of a classic CAN frame (not CAN FD) in bytes.
const CLASSIC: usize = 8;

/// DBC files by file name. `None` if a file cannot be read. In that case the error has already been reported.
pub(crate) type Dbcs = BTreeMap<String, Option<Rc<DbcFile>>>;

/// Parsed DBC file, and its text. Messages quote lines of the text.
#[derive(Clone, Debug)]
pub(crate) struct DbcFile {
    dbc: Dbc,
    text: String,
}

/// Description of one signal in a DBC file: its frames and bits, its scale and offset, and its unit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Described {
    /// Frames that contain the signal, and the bits of the signal in these frames.
    pub(crate) field: Field,
    pub(crate) scale: f64,
    pub(crate) offset: f64,
    /// Unit of the value after `scale` and `offset` have been applied.
    pub(crate) unit: FileUnit,
}

/// Error in a DBC file, or in the name of a signal. Only an error in the file itself has a position.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wrong {
    /// Line and column in the DBC file, counted from 1. `None` if the error does not belong to a single place in the
    /// file.
    pub(crate) at: Option<(usize, usize)>,
    pub(crate) message: String,
    pub(crate) help: String,
}

impl Wrong {
    /// Creates an error without a position in the file, for example about a signal that the file does not contain.
    fn about(message: impl Into<String>, help: impl Into<String>) -> Wrong {
        Wrong { at: None, message: message.into(), help: help.into() }
    }
}

impl DbcFile {
    /// Parses the bytes of a DBC file in UTF-8, or in UTF-16 with a byte order mark. Other bytes are read as Latin-1,
    /// which many DBC editors write.
    ///
    /// # Errors
    /// The file is not a DBC file. The error names the kind of the file if it is known. Otherwise it states
    /// the position of the first invalid line.
    pub(crate) fn read(bytes: Vec<u8>) -> Result<DbcFile, Wrong> {
        let other = FileKind::of(&bytes).and_then(|kind| kind.instead_of(FileKind::Dbc));
        let other = other.map(|other| Wrong::about(other.message, other.help));
        match (DbcFile::parse(bytes), other) {
            (Ok(file), Some(other)) if file.dbc.messages.is_empty() => Err(other),
            (Err(_), Some(other)) => Err(other),
            (read, _) => read,
        }
    }

    fn parse(bytes: Vec<u8>) -> Result<DbcFile, Wrong> {
        let latin = |bytes: &[u8]| bytes.iter().map(|byte| char::from(*byte)).collect();
        let text = match file_kind::wide(&bytes) {
            Some(text) => text,
            None => String::from_utf8(bytes).unwrap_or_else(|other| latin(other.as_bytes())),
        };
        let text = text.trim_start_matches('\u{feff}').to_owned();
        let panicked = |_| {
            let message = "this is not a readable DBC file: the parser failed";
            Wrong::about(message, "open and save the file with an editor for DBC files")
        };
        let unreadable = |why: can_dbc::DbcError| {
            let why = why.to_string();
            let at = place(&why);
            let line = at.and_then(|(line, _)| shown(&text, line));
            let message = match at {
                Some(_) => "this line is not a valid entry of a DBC file",
                None => "the file contains an invalid entry of a DBC file",
            };
            Wrong { at, ..Wrong::about(message, expected(&why, line)) }
        };
        let dbc = beyond(|| Dbc::try_from(text.as_str())).map_err(panicked)?.map_err(unreadable)?;
        Ok(DbcFile { dbc, text })
    }

    /// Returns the text of a line, to quote it in a message. `None` if the line is not a DBC entry: a wrong file may
    /// contain secrets.
    pub(crate) fn line(&self, line: usize) -> Option<&str> {
        shown(&self.text, line)
    }

    /// Finds a signal by its name, "Message.Signal". With a J1939 `source` address, only frames of this sender match.
    /// Without an address, frames of any sender match if the file marks the message as a J1939 parameter group.
    ///
    /// # Errors
    /// The signal does not exist, or CAN does not allow its identifier or its bits.
    pub(crate) fn signal(&self, name: &str, source: Option<u8>) -> Result<Described, Wrong> {
        if self.dbc.messages.is_empty() {
            let help =
                "give the complete DBC file of the device, with lines such as `BO_ 256 Message: 8 Node`";
            return Err(Wrong::about("the DBC file has no messages", help));
        }
        let Some((message_name, signal_name)) = name.split_once('.') else {
            let help = format!("write \"Message.Signal\"; messages: {}", self.message_names().join(", "));
            return Err(Wrong::about(format!("`{name}` does not name a message and its signal"), help));
        };
        let message = self.message(message_name)?;
        let signal = self.signal_in(message, signal_name)?;
        let signal_name = signal.name.as_str();
        let frames = self.frames(message, source)?;
        let size = usize::try_from(message.size).unwrap_or(usize::MAX);
        let is_marked_fd = self.format(message.id).is_some_and(|format| format.ends_with("_FD"));
        if size > CLASSIC && !is_marked_fd && (self.is_group(message, source) || self.is_in_j1939(message)) {
            return Err(too_long(message, size));
        }
        let field = Field {
            frames,
            is_fd: size > CLASSIC || is_marked_fd,
            bits: self.bits(message, signal)?,
            multiplex: self.selectors(message, signal, DEEPEST)?,
        };
        if field.bits.bytes() > size {
            let what = format!("`{signal_name}` ends beyond the {size} bytes of its message");
            return Err(self.at(&format!("SG_ {signal_name} "), Some(&message.name.as_str()), what));
        }
        if !signal.factor.is_finite() || !signal.offset.is_finite() {
            let what = format!("scale or offset of `{signal_name}` is too large");
            return Err(self.at(&format!("SG_ {signal_name} "), Some(&message.name.as_str()), what));
        }
        Ok(Described { field, scale: signal.factor, offset: signal.offset, unit: unit::of(&signal.unit) })
    }

    fn frames(&self, message: &Message, source: Option<u8>) -> Result<CanMatch, Wrong> {
        let is_group = self.is_group(message, source);
        let id = match message.id {
            MessageId::Extended(raw) => CanId::extended(raw),
            // The parser truncates a number without the flag of 29 bits to 16 bits.
            MessageId::Standard(raw) => match self.written_id(&message.name) {
                Some(written) if written != u64::from(raw) => None,
                _ => CanId::standard(u32::from(raw)),
            },
        };
        let Some(id) = id else {
            let what = format!("the identifier of `{}` has more than 11 bits", message.name);
            let mut wrong = self.at(&format!(" {}:", message.name), None, what);
            wrong.help =
                "in a DBC file, an identifier of 29 bits needs bit 31: add 2147483648 to the identifier"
                    .to_owned();
            return Err(wrong);
        };
        match (is_group, id.is_extended()) {
            (false, _) => Ok(CanMatch::exactly(id)),
            (true, true) => CanMatch::parameter_group(id.raw(), source).ok_or_else(|| {
                Wrong::about(
                    format!("{id} is not the identifier of a J1939 parameter group"),
                    "correct the DBC file",
                )
            }),
            (true, false) => {
                let message = format!(
                    "message `{}` has an identifier of 11 bits, but a J1939 parameter group has 29",
                    message.name
                );
                Err(Wrong::about(message, "remove `source_address` of the device, or correct the DBC file"))
            }
        }
    }

    /// Returns whether a message is a J1939 parameter group. This is the case if `source` contains a J1939 source
    /// address, or if the file gives the message the frame format `J1939PG`.
    fn is_group(&self, message: &Message, source: Option<u8>) -> bool {
        source.is_some() || self.format(message.id) == Some("J1939PG")
    }

    /// Returns whether a message has an identifier of 29 bits and the whole file is marked as J1939 (attribute
    /// `ProtocolType`).
    fn is_in_j1939(&self, message: &Message) -> bool {
        let is_j1939 =
            |value: &AttributeValue| matches!(value, AttributeValue::String(word) if word == "J1939");
        let of_file = &self.dbc.attribute_values_database;
        matches!(message.id, MessageId::Extended(_))
            && of_file.iter().any(|known| known.name == "ProtocolType" && is_j1939(&known.value))
    }

    /// Returns the frame format of a message, for example `J1939PG`. Editors store the format in the attribute
    /// `VFrameFormat`: as a word, as the index of a word in a list, or as a plain number. `None` if the file does not
    /// state the format.
    fn format(&self, id: MessageId) -> Option<&str> {
        const NAME: &str = "VFrameFormat";
        let words = self.dbc.attribute_definitions.iter().find_map(|definition| match definition {
            AttributeDefinition::Message(name, AttributeValueType::Enum(words)) if name == NAME => {
                Some(words)
            }
            _ => None,
        });
        let nth = |place: u64| {
            let place = usize::try_from(place).ok()?;
            match words {
                Some(words) => words.get(place).map(String::as_str),
                None => FORMATS.get(place).copied(),
            }
        };
        match self.dbc.resolved_message_attribute(id, NAME)? {
            AttributeValue::String(word) => match word.parse() {
                Ok(place) => nth(place),
                Err(_) => Some(word),
            },
            AttributeValue::Uint(place) => nth(*place),
            AttributeValue::Int(place) => nth(u64::try_from(*place).ok()?),
            AttributeValue::Double(_) => None,
        }
    }

    fn bits(&self, message: &Message, signal: &Signal) -> Result<BitField, Wrong> {
        let kind =
            match (self.dbc.extended_value_type_for_signal(message.id, &signal.name), signal.value_type) {
                (
                    Some(SignalExtendedValueType::IEEEfloat32Bit | SignalExtendedValueType::IEEEdouble64bit),
                    _,
                ) => BitKind::Float,
                (_, ValueType::Signed) => BitKind::Signed,
                (_, ValueType::Unsigned) => BitKind::Unsigned,
            };
        let order = match signal.byte_order {
            DbcOrder::LittleEndian => ByteOrder::Intel,
            DbcOrder::BigEndian => ByteOrder::Motorola,
        };
        let (start, length) = (u16::try_from(signal.start_bit).ok(), u16::try_from(signal.size).ok());
        let bits = start.zip(length).and_then(|(start, length)| BitField::new(start, length, order, kind));
        bits.ok_or_else(|| {
            let what = format!("the bits of `{}` do not fit into a frame", signal.name);
            self.at(&format!("SG_ {} ", signal.name), Some(&message.name.as_str()), what)
        })
    }

    /// Returns the multiplexers that select a signal, each with the multiplexer values at which a frame
    /// contains the signal. Empty if every frame of the message contains the signal. `deep` is the number of
    /// nested multiplexers that may still follow. A signal without a valid multiplexer is an error.
    fn selectors(&self, message: &Message, signal: &Signal, deep: usize) -> Result<Vec<Selector>, Wrong> {
        let extended: Vec<_> = (self.dbc.extended_multiplex.iter())
            .filter(|known| known.message_id == message.id && known.signal_name == signal.name)
            .collect();
        let by = |name: &str| message.signals.iter().find(|signal| signal.name == name);
        let (multiplexer, values) = match (extended.first(), signal.multiplexer_indicator) {
            (Some(first), _) => {
                let values =
                    first.mappings.iter().map(|mapping| (mapping.min_value, mapping.max_value)).collect();
                (by(&first.multiplexor_signal_name), values)
            }
            (
                None,
                MultiplexIndicator::MultiplexedSignal(value)
                | MultiplexIndicator::MultiplexorAndMultiplexedSignal(value),
            ) => {
                let is_root =
                    |signal: &&Signal| signal.multiplexer_indicator == MultiplexIndicator::Multiplexor;
                (message.signals.iter().find(is_root), vec![(value, value)])
            }
            (None, MultiplexIndicator::Multiplexor | MultiplexIndicator::Plain) => return Ok(Vec::new()),
        };
        let (Some(multiplexer), Some(deep)) = (multiplexer, deep.checked_sub(1)) else {
            let what = format!(
                "signal `{}` is multiplexed, but its message has no valid multiplexer for it",
                signal.name
            );
            return Err(self.at(&format!("SG_ {} ", signal.name), Some(&message.name.as_str()), what));
        };
        let mut selectors = self.selectors(message, multiplexer, deep)?;
        selectors.push(Selector { bits: self.bits(message, multiplexer)?, values });
        Ok(selectors)
    }

    /// Returns the identifier of a message from the text of the file, because the parser truncates large identifiers.
    fn written_id(&self, name: &str) -> Option<u64> {
        self.text.lines().find_map(|line| {
            let mut words = line.trim_start().strip_prefix("BO_ ")?.split_whitespace();
            let id = words.next()?.parse().ok()?;
            (words.next()?.trim_end_matches(':') == name).then_some(id)
        })
    }

    /// Builds an error with the error message `what` at the first line that contains `text`. If `message`
    /// names a message of the DBC file, the search begins at the line of this message.
    fn at(&self, text: &str, message: Option<&&str>, what: String) -> Wrong {
        let mut lines = self.text.lines().enumerate();
        if let Some(message) = message {
            let block = format!(" {message}");
            lines.find(|(_, line)| line.starts_with("BO_ ") && line.contains(&block));
        }
        let at = lines.find_map(|(place, line)| Some((place + 1, line.find(text)? + 1)));
        Wrong { at, message: what, help: "correct the DBC file".to_owned() }
    }
}

/// Builds the error for a J1939 parameter group that has more than the 8 bytes of a classic CAN frame.
fn too_long(message: &Message, size: usize) -> Wrong {
    let name = &message.name;
    Wrong::about(
        format!(
            "`{name}` is a J1939 parameter group of {size} bytes, but a classic frame has {CLASSIC}. Devices send it in \
             parts (transport protocol), which isotherm does not join"
        ),
        format!(
            "read the value from a group of at most {CLASSIC} bytes. If the bus is CAN FD, set VFrameFormat of \
             `{name}` to \"ExtendedCAN_FD\" in the DBC file"
        ),
    )
}

/// Returns the text of a line, counted from 1. `None` if the line is not a DBC entry: a wrong file may contain secrets.
pub(crate) fn shown(text: &str, line: usize) -> Option<&str> {
    const ENTRIES: [&str; 11] =
        ["BO_", "SG_", "CM_", "BA_", "VAL_", "VERSION", "NS_", "BS_", "BU_", "EV_", "SIG_"];
    let line = text.lines().nth(line.checked_sub(1)?)?;
    ENTRIES.iter().any(|entry| line.trim_start().starts_with(entry)).then_some(line)
}

/// Extracts line and column from an error message of the DBC parser, for example from ` --> 10:16`. `None` if the
/// message contains no position.
fn place(why: &str) -> Option<(usize, usize)> {
    let (line, column) = why.split_once("--> ")?.1.lines().next()?.split_once(':')?;
    Some((line.trim().parse().ok()?, column.trim().parse().ok()?))
}

/// Builds a hint from an error message of the DBC parser: the expected entries if they are few, otherwise an example.
/// The parser's message itself is not shown, because it quotes the file. `line` is the text of the line with the error,
/// if that line is a DBC entry.
fn expected(why: &str, line: Option<&str>) -> String {
    let wanted = why.split_once("= expected ").map(|(_, wanted)| wanted.trim());
    if line.is_some_and(|line| line.trim_start().starts_with("SG_")) {
        return "write a signal as ` SG_ Signal : 0|16@1- (0.1,0) [0|0] \"degC\" Node`, with decimal points"
            .to_owned();
    }
    match wanted {
        // No entry is recognised at all.
        Some("file") => "give a DBC file; its lines begin with words such as `BU_:` and `BO_`".to_owned(),
        Some(wanted) if wanted.split_whitespace().count() <= 5 => {
            format!("{} is expected here", wanted.replace('_', " "))
        }
        _ => "an entry such as `BO_ 256 Message: 8 Node` or ` SG_ Signal : 0|16@1- (0.1,0) [0|0] \"degC\" \
              Node` is expected"
            .to_owned(),
    }
}

#[cfg(test)]
mod tests;

//! `[set.*]`: outputs that are written together, and how the control recognises a complete set.
//!
//! A control that receives several values must never use an incomplete set. The values of an output set are written
//! with one request if their registers are adjacent. A sequence word that changes last shows that a set is complete. A
//! handshake (strobe signal up, acknowledge signal up, strobe down, acknowledge down) requests the control to accept
//! the set.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use super::handshake::{Handshake, RawHandshake};
use super::output::Output;
use super::register::Notation;
use crate::document::{Json, Section, entries};
use crate::kinds::opcua::nodes::Place;
use crate::wording::duration_text;
use crate::{DeviceId, OutputId, Profile};
use isotherm_core::codec::{Address, DataType, Node, Register, Table};
use words::RawVersion;

pub(super) mod resolve;
mod waits;
mod words;

/// Outputs of one device that a control must receive together.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Set", extend("x-layers" = "arrives"))]
pub(crate) struct RawSet {
    /// Holding register that counts the complete writes of the output set and is written last. The control accepts the
    /// set when this register changes. Not for an OPC UA server.
    sequence: Option<String>,
    /// Holding register that counts up with every write of the output set, 0 to 32767. The register shows the control
    /// that the gateway runs. On an OPC UA server a node: { node = "ns=2;s=…", type = "i16" }.
    heartbeat: Option<Place>,
    /// Holding register with the state of the axes. Bit 0: all axes are armed. Bit 1: an axis is frozen. Bit 2: an axis
    /// executes its fault action. Bit 3: an axis follows a fallback model. On an OPC UA server a node: { node =
    /// "ns=2;s=…", type = "u16" }.
    control: Option<Place>,
    /// Version number, for a check by the control. A holding register, or a node of an OPC UA server.
    version: Option<RawVersion>,
    /// Whether unused registers between the words of the output set are written as 0, so that one request is enough.
    /// Default false.
    zeros: Option<bool>,
    /// Holding register for the check word: sum of all other words of the output set in 16 bits, inverted. Not for an
    /// OPC UA server.
    complement: Option<String>,
    /// Handshake for each write of the output set: the gateway sets a strobe signal, and the control acknowledges it.
    handshake: Option<RawHandshake>,
}

/// Outputs of one device that are written together. An output with its own handshake is also an output set,
/// with only this output.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSet {
    /// Name in the profile. A set without a table of its own has the name of its only output.
    pub name: String,
    /// Whether the profile has a table `[set.*]` for the output set. `false` for an output with its own handshake.
    pub is_named: bool,
    /// Device to which the output set is written.
    pub device: DeviceId,
    /// Outputs in the order of the file. Never empty.
    pub outputs: Vec<OutputId>,
    /// Register that counts up with every complete set and is written last: 1 to 65535, then 1 again.
    pub sequence: Option<Register>,
    /// Register with the sum of all other words of the output set in 16 bits, inverted. The sum includes the sequence.
    pub complement: Option<Register>,
    /// Register or node that counts up with every write, 0 to 32767.
    pub heartbeat: Option<Address>,
    /// Control word: register or node with the state of the axes in bits. See
    /// [`ControlWord`](isotherm_core::output::ControlWord).
    pub control: Option<Address>,
    /// Register or node that receives the version number, and the number.
    pub version: Option<(Address, u16)>,
    /// Whether unused registers between the words are written as 0.
    pub zeros: bool,
    /// Handshake with the control.
    pub handshake: Option<Handshake>,
}

/// Word of an output set that is written into an OPC UA node and is not the value of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OwnWord {
    /// Heartbeat: number of the writes so far.
    Heartbeat,
    /// Control word: state of the axes in bits.
    Control,
    /// Version number of the set's layout, a constant of the profile.
    Version(u16),
}

impl OwnWord {
    /// Returns the key of the word in the profile.
    pub const fn name(self) -> &'static str {
        match self {
            OwnWord::Heartbeat => "heartbeat",
            OwnWord::Control => "control",
            OwnWord::Version(_) => "version",
        }
    }
}

/// Range of adjacent registers that one request writes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stretch {
    /// First holding register of the request.
    pub from: u16,
    /// Number of registers in the request.
    pub count: u16,
}

impl OutputSet {
    /// Returns the name of the set in events and errors: `set plc`, or `output cnc_z` for an output with its own
    /// handshake.
    pub fn label(&self) -> String {
        format!("{} {}", if self.is_named { "set" } else { "output" }, self.name)
    }

    /// Iterates over the words of the set that are not values of outputs. Each item is the word's key in the profile,
    /// and its address.
    pub(super) fn own(&self) -> impl Iterator<Item = (&'static str, Address)> {
        let own = [
            ("sequence", self.sequence.map(Address::from)),
            ("complement", self.complement.map(Address::from)),
            ("heartbeat", self.heartbeat.clone()),
            ("control", self.control.clone()),
            ("version", self.version.as_ref().map(|(at, _)| at.clone())),
        ];
        own.into_iter().filter_map(|(key, at)| Some((key, at?)))
    }

    /// Iterates over the registers of the set that do not contain values of outputs.
    pub fn own_registers(&self) -> impl Iterator<Item = Register> {
        self.own().filter_map(|(_, at)| at.register())
    }

    /// Iterates over the nodes of the set that do not contain values of outputs, in the order in which they are
    /// written.
    pub fn own_nodes(&self) -> impl Iterator<Item = (OwnWord, &Node)> {
        let version = self.version.as_ref().map(|(at, number)| (OwnWord::Version(*number), at));
        let own = [
            self.heartbeat.as_ref().map(|at| (OwnWord::Heartbeat, at)),
            self.control.as_ref().map(|at| (OwnWord::Control, at)),
            version,
        ];
        own.into_iter().flatten().filter_map(|(word, at)| Some((word, at.node()?)))
    }

    /// Returns whether heartbeat and control word may be written without the outputs, because the output set has no
    /// sequence, complement or handshake.
    pub fn has_own_words_apart(&self) -> bool {
        let is_whole = self.sequence.is_some() || self.complement.is_some() || self.handshake.is_some();
        !is_whole && (self.heartbeat.is_some() || self.control.is_some())
    }

    /// Returns the longest time between two writes of heartbeat and control word. After a write without an
    /// answer, the gateway waits until this write can no longer arrive, and then for the next write of the
    /// set. `None` if the set has neither of the two words, or if they can be written without the outputs.
    fn longest_silence(&self, profile: &Profile) -> Option<Duration> {
        let has_own = self.heartbeat.is_some() || self.control.is_some();
        (has_own && !self.has_own_words_apart()).then(|| {
            let refresh = self.members(profile).filter_map(|output| output.refresh).min();
            profile.bus(profile.device(self.device).bus).late
                + refresh.unwrap_or_default()
                + Duration::from_secs(1)
        })
    }

    /// Preview of the output set: its requests, its words that are not values of outputs, and its handshake.
    pub(crate) fn preview(&self, profile: &Profile) -> Section {
        let device = profile.device(self.device);
        let function = |registers| device.functions.write_code(registers);
        let requests = self.stretches(self.members(profile), device.longest_request());
        let requests = requests.into_iter().map(|Stretch { from, count }| {
            let at = |offset| Register { table: Table::Holding, offset };
            let (first, last, code) = (at(from), at(from + (count - 1)), function(count));
            if count == 1 {
                return format!("{first} ({}), 1 register, function {code:02}", first.modicon());
            }
            let modicon = format!("{}..{}", first.modicon(), last.modicon());
            format!("{first}..{} ({modicon}), {count} registers, function {code:02}", last.offset)
        });
        let requests: Vec<String> = requests.chain(self.call(profile)).collect();
        let (what, device) = (self.label(), &device.name);
        let outputs: Vec<&str> = self.members(profile).map(|output| output.name.as_str()).collect();
        let mut section = Section::default();
        if outputs.len() > 1 || self.sequence.is_some() || self.complement.is_some() {
            section.line(format!("  {what}: {} are written together to {device}", outputs.join(", ")));
        } else {
            section.line(format!("  {what}: accepted by {device} with a handshake"));
        }
        match requests.as_slice() {
            [one] => section.line(format!("    one request: {one}")),
            several => {
                section.line(format!("    {} requests, in this order:", several.len()));
                section.lines("      ", several);
            }
        }
        if self.zeros {
            section.line("    unused registers between the words of the set are written as 0");
        }
        let version = self.version.as_ref().map(|(_, number)| format!("always {number}")).unwrap_or_default();
        for (key, meaning) in [
            ("heartbeat", "counts up with every write, 0 to 32767"),
            ("control", "bit 0 armed, 1 hold, 2 fault, 3 fallback model"),
            ("version", &version),
            (
                "sequence",
                "counts up with every complete set, 1 to 65535; the control accepts the set when this \
                 register changes",
            ),
            ("complement", "sum of all other words of the set in 16 bits, inverted"),
        ] {
            let at = self.own().find(|(own, _)| *own == key).map(|(_, at)| notation(&at));
            section.lines("", at.map(|at| format!("    {key} {at}: {meaning}")));
        }
        let silence = self.longest_silence(profile);
        section.lines(
            "",
            silence.map(|silence| {
                let span = duration_text(silence);
                format!(
                    "    after a write without an answer, heartbeat and control word are not written for up \
                     to {span}: the control's watchdog must be longer"
                )
            }),
        );
        let milliseconds = |span: Duration| u64::try_from(span.as_millis()).unwrap_or(u64::MAX);
        entries!(section, longest_silence_ms = silence.map(milliseconds), what, device, outputs, requests);
        section.json("sequence", self.sequence.map(Notation::from));
        section.json("complement", self.complement.map(Notation::from));
        section.json("heartbeat", self.heartbeat.as_ref().map(notation));
        section.json("control", self.control.as_ref().map(notation));
        let version = self.version.as_ref();
        let version = version.map(|(at, number)| vec![notation(at).into(), Json::from(*number)]);
        section.json("version", version);
        section.entry("zeros", self.zeros);
        section.part("handshake", self.handshake.as_ref().map(|handshake| handshake.preview(function(1))));
        section
    }

    /// Returns the requests for writing the registers, in order. One request is enough if all registers are adjacent.
    /// Otherwise the values and the complement come first, and the sequence alone comes last. No request has more than
    /// `most` registers.
    pub fn stretches<'a>(&self, outputs: impl Iterator<Item = &'a Output>, most: u16) -> Vec<Stretch> {
        let values = outputs.filter_map(|output| {
            Some((output.address.register()?.offset, output.encoding.data_type.registers()))
        });
        let words = self.own_registers().filter(|at| Some(*at) != self.sequence).map(|at| (at.offset, 1));
        let mut cells: Vec<(u16, u16)> = values.chain(words).collect();
        let last = self.sequence.map(|at| (at.offset, 1));
        if self.zeros {
            let ends = cells.iter().chain(&last).map(|(from, count)| (*from, from.saturating_add(*count)));
            let (from, to) = ends.fold((u16::MAX, 0), |(from, to), (a, b)| (from.min(a), to.max(b)));
            return joined((from..to).map(|register| (register, 1)).collect(), most);
        }
        let whole = joined(cells.iter().copied().chain(last).collect(), most);
        if whole.len() == 1 || last.is_none() {
            return whole;
        }
        cells = joined(cells, most).into_iter().map(|stretch| (stretch.from, stretch.count)).collect();
        cells.into_iter().chain(last).map(|(from, count)| Stretch { from, count }).collect()
    }

    /// Returns whether the output set is written into nodes of an OPC UA server, all with one call.
    pub fn is_in_nodes(&self, profile: &Profile) -> bool {
        self.members(profile).any(|output| output.address.node().is_some())
    }

    /// Returns the nodes of the output set. Nodes of outputs come first, then heartbeat, control word and version.
    pub fn nodes(&self, profile: &Profile) -> Vec<Node> {
        let values = self.members(profile).filter_map(|output| output.address.node());
        values.chain(self.own_nodes().map(|(_, node)| node)).cloned().collect()
    }

    /// Describes the node at this index of [`OutputSet::nodes`]: `output cnc_z (node ns=2;s=…)`. `None` beyond the last
    /// node.
    pub fn holds_at(&self, profile: &Profile, place: usize) -> Option<String> {
        let values = self.members(profile).map(|output| format!("output {}", output.name));
        let words = self.own_nodes().map(|(word, _)| format!("{} of {}", word.name(), self.label()));
        let mut all = values.chain(words).zip(self.nodes(profile));
        all.nth(place).map(|(what, node)| format!("{what} (node {node})"))
    }

    /// Describes the OPC UA call that writes the nodes. `None` for an output set in registers.
    fn call(&self, profile: &Profile) -> Option<String> {
        let nodes = self.nodes(profile);
        let listed: Vec<String> =
            nodes.iter().map(|node| format!("{node} ({})", node.taken_as().name())).collect();
        let count = listed.len();
        let listed = listed.join(", ");
        (count > 0).then(|| {
            format!("one call that writes {count} nodes, in the order that the server chooses: {listed}")
        })
    }

    /// Iterates over the outputs of the set.
    pub fn members<'a>(&'a self, profile: &'a Profile) -> impl Iterator<Item = &'a Output> {
        self.outputs.iter().map(|id| profile.output(*id))
    }
}

impl Stretch {
    /// Combines ranges of registers into the fewest requests of at most `most` registers. A range is its first register
    /// and its number of registers.
    pub fn joined(cells: Vec<(u16, u16)>, most: u16) -> Vec<Stretch> {
        joined(cells, most)
    }
}

fn notation(at: &Address) -> Notation {
    Notation::of(at, at.node().map_or(DataType::U16, Node::taken_as))
}

fn joined(mut cells: Vec<(u16, u16)>, most: u16) -> Vec<Stretch> {
    cells.sort_unstable();
    let mut stretches: Vec<Stretch> = Vec::new();
    for (from, count) in cells {
        match stretches.last_mut() {
            Some(last)
                if u32::from(last.from) + u32::from(last.count) == u32::from(from)
                    && last.count + count <= most =>
            {
                last.count += count;
            }
            _ => stretches.push(Stretch { from, count }),
        }
    }
    stretches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_side_by_side_become_one_stretch_and_no_stretch_is_too_long() {
        let stretch = |from, count| Stretch { from, count };
        assert_eq!(joined(vec![(6, 2), (4, 2), (8, 1)], 123), [stretch(4, 5)]);
        assert_eq!(joined(vec![(4, 2), (7, 2)], 123), [stretch(4, 2), stretch(7, 2)]);
        assert_eq!(joined(vec![(4, 2), (6, 2), (8, 2)], 4), [stretch(4, 4), stretch(8, 2)]);
    }
}

//! Interface of a kind of bus, for example Modbus or CAN. The tables, the plan and the preview use a kind of bus only
//! through this interface.
//!
//! The module `kinds` contains one [`BusKind`] for each kind of bus, and the list of all kinds.

use std::time::Duration;

use super::bus::transport::{BusType, Transport};
use super::bus::{Bus, LineSettings, LineType, RawBus};
use super::device::verify::{Expected, RawVerify};
use super::device::{Device, DeviceParts, RawDevice};
use super::heartbeat::RawHeartbeat;
use super::output::{RawOutput, Target};
use super::signal::{Located, RawSignal};
use super::{Check, KeyContext};
use crate::document::Section;
use crate::kinds::modbus::functions::Functions;
use crate::plan::ReadRequest;
use crate::{BusId, Profile, Signal};
use isotherm_core::codec::Address;
use isotherm_core::reading::SignalId;

/// Keys that are not allowed, the name of the tables that may have them, and a hint. Messages contain the name and the
/// hint.
pub(crate) type ForeignKeys = (&'static [&'static str], &'static str, &'static str);

/// Transport of a line, and its address. The address is `None` if it is invalid.
pub(crate) type TransportAddress = (Transport, Option<String>);

/// Signals of one device, with their indices.
pub(crate) type SignalsOf<'a> = [(SignalId, &'a Signal)];

/// Keys of a signal that only one kind of bus has.
pub(crate) struct SignalKeys {
    pub(crate) keys: &'static [&'static str],
    /// Name, for messages, of the tables that may have the keys, for example "an OPC UA server".
    pub(crate) owner: &'static str,
    /// Hint if the key is used on a line of another kind. `None` if that kind has its own hint.
    pub(crate) help: Option<&'static str>,
}

/// Kind of bus: its types of lines, and the functions that check, plan and preview them.
pub(crate) struct BusKind {
    pub(crate) types: &'static [LineType],
    /// Default timeout. `None` if the timeout is calculated from the periods on the line.
    pub(crate) timeout: Option<Duration>,
    /// Message if the gateway cannot write to a line of this kind. `None` if the gateway can write.
    pub(crate) only_read: Option<&'static str>,
    /// Whether the values of devices on this kind of bus are in registers.
    pub(crate) has_registers: bool,
    /// Whether exchanges take up the time of a line, so that the preview shows its load.
    pub(crate) has_load: bool,
    /// Returns whether a line with an invalid `type` is of this kind, judging by its other keys.
    pub(crate) recognises: fn(&RawBus) -> bool,
    /// Checks the other keys of a line with an invalid `type`. The flag is true if these keys show the kind.
    pub(crate) line_without_type: fn(&RawBus, &KeyContext<'_>, bool),
    /// Resolves transport and address of a line. `None` if the transport has an error.
    pub(crate) line: fn(&RawBus, &KeyContext<'_>, BusType) -> Option<TransportAddress>,
    /// Resolves settings that only some types of lines have. The last argument is the address of the line.
    pub(crate) settings: fn(&RawBus, &KeyContext<'_>, BusType, Option<&str>) -> Option<LineSettings>,
    /// Resolves the parts of a device that depend on the kind of its line. The last argument is the line, or `None` if
    /// it has an error.
    pub(crate) device: fn(&Check<'_>, &RawDevice, &KeyContext<'_>, Option<&Bus>) -> DeviceParts,
    /// Keys that a device on this kind of bus cannot have.
    pub(crate) foreign_device_keys: &'static [ForeignKeys],
    /// Reports the keys of this kind at a device whose line is of another kind.
    pub(crate) device_keys_elsewhere: fn(&RawDevice, &KeyContext<'_>),
    /// Resolves one check (`verify`) of a device.
    pub(crate) verify: fn(&RawVerify, &KeyContext<'_>, Functions) -> Option<Expected>,
    /// Keys that only signals on this kind of bus have.
    pub(crate) signal_keys: SignalKeys,
    /// Returns the hint for a signal with keys of another kind of bus. The hint says which key a signal of the named
    /// device needs.
    pub(crate) signal_help: fn(&str) -> String,
    /// Reports wrong combinations of keys of a signal on the named device. Returns the reported keys that belong to
    /// other kinds of buses.
    pub(crate) check_signal: fn(&RawSignal, &KeyContext<'_>, &str) -> &'static [&'static str],
    /// Returns whether a signal has the key that states its address on a line of this kind, for example
    /// `register`. Also returns `true` if the function `signal` reports the missing key.
    pub(crate) has_place: fn(&RawSignal) -> bool,
    /// Returns whether the value of a signal arrives without a request, so that no poll period limits its age.
    pub(crate) comes_by_itself: fn(&RawSignal) -> bool,
    /// Resolves the address and the encoding of a signal.
    pub(crate) signal: fn(&Check<'_>, &RawSignal, &KeyContext<'_>, Option<&Device>) -> Option<Located>,
    /// Reports the keys of an output that are not allowed on this kind of bus. The text is the name of its device.
    pub(crate) foreign_output_keys: fn(&RawOutput, &KeyContext<'_>, &str),
    /// Resolves address and encoding of an output. The last two arguments are the name of the output, and the index of
    /// its device.
    pub(crate) output: fn(&Check<'_>, &RawOutput, &KeyContext<'_>, &str, Option<usize>) -> Option<Target>,
    /// Resolves the register or node of the heartbeat.
    pub(crate) heartbeat: fn(&RawHeartbeat, &KeyContext<'_>) -> Option<Address>,
    /// Adds to the devices the data that results from their outputs, such as CAN frames.
    pub(crate) complete: fn(&mut Check<'_>),
    /// Checks all tables for conflicts on lines of this kind of bus.
    pub(crate) check: fn(&Check<'_>),
    /// Plans the requests that read these signals of one device. Signals on other kinds of buses are skipped.
    pub(crate) requests: fn(&Device, &SignalsOf<'_>) -> Vec<ReadRequest>,
    /// Describes a device in the preview. The two texts are the poll period of the device, and the summary of its
    /// requests.
    pub(crate) device_preview: fn(&Device, &str, &str) -> String,
    /// Sentence about reads and writes in the preview. `None` for the usual sentence, which says how long a write
    /// without an answer may still arrive.
    pub(crate) line_preview: Option<&'static str>,
    /// Returns the sections about a line in the preview, each with its key in the JSON.
    pub(crate) preview: fn(&Profile, BusId) -> Vec<(&'static str, Section)>,
    /// Returns whether a check (`verify`) could detect that this device has been replaced by another one.
    pub(crate) can_be_identified: fn(&Device) -> bool,
    /// Returns the addresses of a written value as texts, for example one text for each register. The
    /// arguments are Modbus unit identifier, address, and number of registers. Empty for an address of
    /// another kind.
    pub(crate) written: fn(u8, &Address, u16) -> Vec<String>,
}

impl BusKind {
    /// Defaults for a kind of bus whose devices are polled. Each kind replaces the fields that differ, at least the
    /// fields from `types` to `requests`.
    pub(crate) const POLLED: BusKind = BusKind {
        types: &[],
        line: |_, _, _| None,
        device: |_, _, _, _| DeviceParts::default(),
        signal_keys: SignalKeys { keys: &[], owner: "", help: None },
        signal_help: |_| String::new(),
        has_place: |_| true,
        signal: |_, _, _, _| None,
        requests: |_, _| Vec::new(),
        timeout: None,
        only_read: None,
        has_registers: false,
        has_load: true,
        recognises: |_| false,
        line_without_type: |_, _, _| {},
        settings: |_, _, _, _| Some(LineSettings::default()),
        foreign_device_keys: &[],
        device_keys_elsewhere: |_, _| {},
        verify: |_, _, _| None,
        check_signal: |_, _, _| &[],
        comes_by_itself: |_| false,
        foreign_output_keys: |_, _, _| {},
        output: |_, _, _, _, _| None,
        heartbeat: |_, _| None,
        complete: |_| {},
        check: |_| {},
        device_preview: |_, every, summary| format!("every {every}: {summary}"),
        line_preview: None,
        preview: |_, _| Vec::new(),
        can_be_identified: |_| true,
        written: |_, _, _| Vec::new(),
    };

    /// Returns the type of line for this value of the key `type`. `None` if the type belongs to another kind of bus.
    pub(crate) fn line_type(&self, of: BusType) -> Option<&'static LineType> {
        self.types.iter().find(|known| known.word == of)
    }
}

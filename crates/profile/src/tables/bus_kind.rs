//! Kind of bus: what the tables, the plan and the preview need of the types of lines of one kind.
//!
//! The tables know this type only. `kinds` contains one value for each kind, and the list of all.

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

/// Keys, their owner in messages, and the hint for them.
pub(crate) type ForeignKeys = (&'static [&'static str], &'static str, &'static str);

/// Transport of a line, and its address. The address is `None` if it has an error.
pub(crate) type TransportAddress = (Transport, Option<String>);

/// Signals of one device, with their indices.
pub(crate) type SignalsOf<'a> = [(SignalId, &'a Signal)];

/// Keys of a signal that only one kind of bus has.
pub(crate) struct SignalKeys {
    pub(crate) keys: &'static [&'static str],
    /// Owner of the keys in messages.
    pub(crate) owner: &'static str,
    /// Hint for a key on a line of another kind. `None` for the hint of that kind.
    pub(crate) help: Option<&'static str>,
}

/// Kind of bus.
pub(crate) struct BusKind {
    pub(crate) types: &'static [LineType],
    /// Default timeout. `None` if it results from the periods on the line.
    pub(crate) timeout: Option<Duration>,
    /// Reason why nothing is written to a line of this kind. `None` if it is written to.
    pub(crate) only_read: Option<&'static str>,
    /// Whether values are in registers.
    pub(crate) has_registers: bool,
    /// Whether the exchanges of a line follow each other, so that it has a load.
    pub(crate) has_load: bool,
    /// Returns whether a line whose type has an error is of this kind.
    pub(crate) recognises: fn(&RawBus) -> bool,
    /// Checks the keys of a line whose type has an error. The flag is set if the line was recognised.
    pub(crate) line_without_type: fn(&RawBus, &KeyContext<'_>, bool),
    /// Resolves transport and address of a line. `None` if the transport has an error.
    pub(crate) line: fn(&RawBus, &KeyContext<'_>, BusType) -> Option<TransportAddress>,
    /// Resolves the settings that only some types of lines have. The text is the address.
    pub(crate) settings: fn(&RawBus, &KeyContext<'_>, BusType, Option<&str>) -> Option<LineSettings>,
    /// Resolves the parts of a device that depend on the kind of its line. The line is `None` if it has an error.
    pub(crate) device: fn(&Check<'_>, &RawDevice, &KeyContext<'_>, Option<&Bus>) -> DeviceParts,
    /// Keys that a device of this kind does not have.
    pub(crate) foreign_device_keys: &'static [ForeignKeys],
    /// Reports the keys that only devices of this kind have, at a device on a line of another kind.
    pub(crate) device_keys_elsewhere: fn(&RawDevice, &KeyContext<'_>),
    /// Resolves a check of a device.
    pub(crate) verify: fn(&RawVerify, &KeyContext<'_>, Functions) -> Option<Expected>,
    /// Keys that only signals of this kind have.
    pub(crate) signal_keys: SignalKeys,
    /// Hint for a signal that has keys of another kind: the place to write on this device.
    pub(crate) signal_help: fn(&str) -> String,
    /// Reports wrong combinations of keys of a signal on this device. Returns the keys of other kinds among them.
    pub(crate) check_signal: fn(&RawSignal, &KeyContext<'_>, &str) -> &'static [&'static str],
    /// Returns whether a signal has a place on a line of this kind, or the missing place is reported in any case.
    pub(crate) has_place: fn(&RawSignal) -> bool,
    /// Returns whether the value of a signal arrives without a request, so that no poll period limits its age.
    pub(crate) comes_by_itself: fn(&RawSignal) -> bool,
    /// Resolves the place of a signal.
    pub(crate) signal: fn(&Check<'_>, &RawSignal, &KeyContext<'_>, Option<&Device>) -> Option<Located>,
    /// Reports the keys of an output on this device that outputs of this kind do not have.
    pub(crate) foreign_output_keys: fn(&RawOutput, &KeyContext<'_>, &str),
    /// Resolves the target of an output with this name, on the device with this index.
    pub(crate) output: fn(&Check<'_>, &RawOutput, &KeyContext<'_>, &str, Option<usize>) -> Option<Target>,
    /// Resolves the register or node of the heartbeat.
    pub(crate) heartbeat: fn(&RawHeartbeat, &KeyContext<'_>) -> Option<Address>,
    /// Completes the devices with what their outputs need.
    pub(crate) complete: fn(&mut Check<'_>),
    /// Checks all tables for conflicts on lines of this kind.
    pub(crate) check: fn(&Check<'_>),
    /// Plans the requests that read these signals of one device. Skips the signals of other kinds.
    pub(crate) requests: fn(&Device, &SignalsOf<'_>) -> Vec<ReadRequest>,
    /// Description of a device in the preview, from its period and the summary of its requests.
    pub(crate) device_preview: fn(&Device, &str, &str) -> String,
    /// Description of reads and writes in the preview, if writes without an answer cannot arrive later.
    pub(crate) line_preview: Option<&'static str>,
    /// Sections about a line in the preview, each with its key.
    pub(crate) preview: fn(&Profile, BusId) -> Vec<(&'static str, Section)>,
    /// Returns whether a check could detect that another device has replaced this one.
    pub(crate) can_be_identified: fn(&Device) -> bool,
    /// Returns the places of a written value of this many registers, at the unit with this number, as texts. Empty for an
    /// address of another kind.
    pub(crate) written: fn(u8, &Address, u16) -> Vec<String>,
}

impl BusKind {
    /// Kind of polled devices. Each kind replaces what differs, at least the first fields.
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

    /// Returns this type of line. `None` if it is of another kind.
    pub(crate) fn line_type(&self, of: BusType) -> Option<&'static LineType> {
        self.types.iter().find(|known| known.word == of)
    }
}

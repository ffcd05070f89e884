//! Kind of bus: what the tables, the plan and the preview need of the types of lines of one kind.
//!
//! The tables know this trait only. `kinds` contains one implementation for each kind, and the list of all.

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
use crate::{BusId, Profile};
use isotherm_core::codec::Address;
use isotherm_core::reading::SignalId;

/// Assumed time until a current device begins its answer, including its network.
pub(crate) const ANSWER: Duration = Duration::from_millis(10);

/// Keys of a signal that only one kind of bus has.
pub(crate) struct SignalKeys {
    pub(crate) keys: &'static [&'static str],
    /// Owner of the keys in messages.
    pub(crate) owner: &'static str,
    /// Hint for a key on a line of another kind. Default: the hint of that kind.
    pub(crate) help: Option<&'static str>,
}

/// Kind of bus. The functions without a default are those that every kind needs. A kind whose devices are only read
/// needs no others.
pub(crate) trait BusKind: Sync {
    /// Types of lines of this kind.
    fn types(&self) -> &'static [LineType];

    /// Resolves transport and address of a line. `None` if the transport has an error.
    fn line(&self, raw: &RawBus, at: &KeyContext<'_>, of: BusType) -> Option<(Transport, Option<String>)>;

    /// Resolves the parts of a device that depend on the kind of its line. `line` is `None` if the line has an error.
    fn device(
        &self,
        check: &Check<'_>,
        raw: &RawDevice,
        at: &KeyContext<'_>,
        line: Option<&Bus>,
    ) -> DeviceParts;

    /// Reports the keys of a device that devices of this kind do not have.
    fn foreign_device_keys(&self, at: &KeyContext<'_>);

    /// Keys that only signals of this kind have.
    fn signal_keys(&self) -> SignalKeys;

    /// Hint for a signal on a device of this kind that has keys of another kind: the place to write instead.
    fn signal_help(&self, device: &str) -> String;

    /// Resolves the place of a signal.
    fn signal(
        &self,
        check: &Check<'_>,
        raw: &RawSignal,
        at: &KeyContext<'_>,
        device: Option<&Device>,
    ) -> Option<Located>;

    /// Returns whether a signal has a place on a line of this kind, or the missing place is reported in any case.
    fn has_place(&self, raw: &RawSignal) -> bool;

    /// Plans the requests that read these signals of one device. Skips the signals of other kinds.
    fn requests(&self, device: &Device, signals: &[(SignalId, &crate::Signal)]) -> Vec<ReadRequest>;

    /// Name of the line in the preview.
    fn title(&self, bus: &Bus) -> &'static str;

    /// Reason why nothing is written to a line of this kind. `None` if it is written to.
    fn only_read(&self) -> Option<&'static str> {
        None
    }

    /// Returns whether a line whose type has an error is of this kind.
    fn recognises(&self, _raw: &RawBus) -> bool {
        false
    }

    /// Checks the keys of a line whose type has an error. `is_known`: the line is recognised as one of another kind.
    fn line_without_type(&self, _raw: &RawBus, _at: &KeyContext<'_>, _is_known: bool) {}

    /// Resolves the settings that only some types of lines have. `None` if they have errors.
    fn settings(
        &self,
        _raw: &RawBus,
        _at: &KeyContext<'_>,
        (_of, _address): (BusType, Option<&str>),
    ) -> Option<LineSettings> {
        Some(LineSettings::default())
    }

    /// Default timeout. `None` if it results from the periods on the line.
    fn timeout(&self) -> Option<Duration> {
        None
    }

    /// Reports the keys of a device that only devices of this kind have. The device is on a line of another kind.
    fn device_keys_elsewhere(&self, _raw: &RawDevice, _at: &KeyContext<'_>) {}

    /// Resolves a check of a device.
    fn verify(&self, _raw: &RawVerify, _at: &KeyContext<'_>, _functions: Functions) -> Option<Expected> {
        None
    }

    /// Reports wrong combinations of keys of a signal. Returns the keys of other kinds that it has reported.
    fn check_signal(&self, _raw: &RawSignal, _at: &KeyContext<'_>, _device: &str) -> &'static [&'static str] {
        &[]
    }

    /// Returns whether the value of a signal arrives without a request, so that no poll period limits its age.
    fn comes_by_itself(&self, _raw: &RawSignal) -> bool {
        false
    }

    /// Returns whether values are in registers.
    fn has_registers(&self) -> bool {
        false
    }

    /// Reports the keys of an output that outputs of this kind do not have.
    fn foreign_output_keys(&self, _raw: &RawOutput, _at: &KeyContext<'_>, _device: &str) {}

    /// Resolves the target of an output with this name, on the device with this index.
    fn output(
        &self,
        _check: &Check<'_>,
        _raw: &RawOutput,
        _at: &KeyContext<'_>,
        (_name, _device): (&str, Option<usize>),
    ) -> Option<Target> {
        None
    }

    /// Resolves the register or node of the heartbeat.
    fn heartbeat(&self, _raw: &RawHeartbeat, _at: &KeyContext<'_>) -> Option<Address> {
        None
    }

    /// Completes the devices with what their outputs need.
    fn complete(&self, _check: &mut Check<'_>) {}

    /// Checks all tables for conflicts on lines of this kind.
    fn check(&self, _check: &Check<'_>) {}

    /// Description of a device in the preview.
    fn device_preview(&self, _device: &Device, every: &str, summary: &str) -> String {
        format!("every {every}: {summary}")
    }

    /// Description of late writes in the preview.
    fn late_writes(&self, late: &str) -> String {
        format!("a write that is not answered may still arrive for {late}")
    }

    /// Sections about a line in the preview, each with its key.
    fn preview(&self, _profile: &Profile, _bus: BusId) -> Vec<(&'static str, Section)> {
        Vec::new()
    }

    /// Assumed answer time of a device.
    fn answer_time(&self, _transport: Transport) -> Duration {
        ANSWER
    }

    /// Returns whether the exchanges of a line follow each other, so that it has a load.
    fn has_load(&self) -> bool {
        true
    }

    /// Returns whether a check could detect that another device has replaced this one.
    fn can_be_identified(&self, _device: &Device) -> bool {
        true
    }

    /// Returns the places of a written value of `count` registers, as texts.
    fn written(&self, _unit: u8, _address: &Address, _count: u16) -> Vec<String> {
        Vec::new()
    }

    /// Returns this type of line. `None` if it is of another kind.
    fn line_type(&self, of: BusType) -> Option<&'static LineType> {
        self.types().iter().find(|known| known.word == of)
    }

    /// Returns whether this is the same kind.
    fn is_same(&self, other: &dyn BusKind) -> bool {
        other.types().iter().any(|known| self.line_type(known.word).is_some())
    }
}

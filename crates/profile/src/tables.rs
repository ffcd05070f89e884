//! Tables of a profile, one file each: the keys as written, the resolved form, the checks, and the preview of `isotherm
//! check`.
//!
//! A table that cannot be resolved leaves a gap in its list. The indices of the other tables, and the checks on them,
//! then stay correct. With a single error there is no profile.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::Profile;
use crate::dbc::Dbcs;
use crate::error::Findings;
use crate::files::Files;
use crate::key_context::{Names, Report};
use crate::kinds::can::frame_writes::Written;
use crate::protected_keys::guarded_keys;
use crate::source_map::SourceMap;
use crate::template::Templates;
use axis::{Axis, RawAxis};
use bus::periods::Periods;
use bus::{Bus, RawBus};
use bus_kind::BusKind;
use device::{Device, RawDevice};
use heartbeat::RawHeartbeat;
use history::RawHistory;
use isotherm_core::compensation::settings::MachineSettings;
use machine::RawMachine;
use mqtt::RawMqtt;
use notify::RawNotify;
use output::{Output, RawOutput};
use set::{OutputSet, RawSet};
use signal::{RawSignal, Signal};
use web::RawWeb;

pub(crate) use crate::key_context::{KeyContext, optional};

pub(crate) mod axis;
pub(crate) mod bus;
pub(crate) mod bus_kind;
mod claims;
pub(crate) mod device;
mod expression;
pub(crate) mod handshake;
pub(crate) mod heartbeat;
pub(crate) mod history;
mod incomplete_parts;
pub(crate) mod label;
pub(crate) mod machine;
pub(crate) mod mqtt;
pub(crate) mod notify;
pub(crate) mod output;
pub(crate) mod register;
mod restart;
pub(crate) mod schema;
pub(crate) mod set;
pub(crate) mod signal;
pub(crate) mod web;

/// One machine: its buses, devices, signals, axes and outputs.
///
/// The JSON schema is generated from the `Raw…` types, and each layer is checked against it. Editors and error messages
/// show the doc comments of the fields. Every key is an `Option`, even if it is required. The walk reports missing and
/// wrong keys and leaves them out, so that the rest can still be checked.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(
    title = "isotherm machine profile",
    description = "One machine: its buses, devices, signals, axes and outputs."
)]
pub(crate) struct RawProfile {
    /// Settings of the whole machine.
    #[schemars(required)]
    machine: Option<RawMachine>,
    /// Lines (buses) to which devices are connected, by name.
    #[serde(default)]
    bus: BTreeMap<String, RawBus>,
    /// Devices on the lines, by name.
    #[serde(default)]
    pub(crate) device: BTreeMap<String, RawDevice>,
    /// Values that are read from devices, by name.
    #[serde(default)]
    signal: BTreeMap<String, RawSignal>,
    /// Compensated axes, by name.
    #[serde(default)]
    axis: BTreeMap<String, RawAxis>,
    /// Values that are written to devices, by name.
    #[serde(default)]
    output: BTreeMap<String, RawOutput>,
    /// Sets of outputs that a control must receive together, by name.
    #[serde(default)]
    set: BTreeMap<String, RawSet>,
    /// Register or node with a counter that shows the CNC that the gateway runs.
    heartbeat: Option<RawHeartbeat>,
    /// Web page, API and metrics.
    web: Option<RawWeb>,
    /// Publication of values and events to an MQTT broker.
    mqtt: Option<RawMqtt>,
    /// Servers that receive messages about events.
    #[serde(default)]
    notify: Vec<RawNotify>,
    /// Storage of state and logs.
    history: Option<RawHistory>,
}

/// Result of the check.
pub(crate) struct Checked {
    pub(crate) profile: Option<Profile>,
    pub(crate) errors: Findings,
    pub(crate) warnings: Findings,
}

/// Tables of one kind: their names, and the resolved ones so far.
pub(crate) struct Tables<T> {
    pub(crate) names: Names,
    /// Resolved tables in the order of the names. `None` if a table has errors.
    pub(crate) resolved: Vec<Option<T>>,
}

/// State of a check in progress.
pub(crate) struct Check<'a> {
    pub(crate) raw: &'a RawProfile,
    pub(crate) report: Report<'a>,
    templates: &'a Templates,
    /// All kinds of buses. A line whose type has an error counts as one of the first kind.
    kinds: &'static [&'static BusKind],
    pub(crate) buses: Tables<Bus>,
    pub(crate) devices: Tables<Device>,
    pub(crate) signals: Tables<Signal>,
    axes: Tables<Axis>,
    pub(crate) outputs: Tables<Output>,
    sets: Tables<OutputSet>,
    /// Frames that outputs write on CAN lines.
    pub(crate) written_frames: RefCell<Vec<Written>>,
    pub(crate) dbcs: RefCell<Dbcs>,
    /// Periods of reads and writes on each line.
    periods: Periods,
}

impl RawProfile {
    /// Checks and resolves the profile.
    pub(crate) fn check(
        &self,
        spans: &SourceMap,
        path: PathBuf,
        files: &Files<'_>,
        templates: &Templates,
        kinds: &'static [&'static BusKind],
    ) -> Checked {
        let mut check = Check {
            raw: self,
            report: Report::new(spans, files, Names::of("signal", &self.signal, spans)),
            templates,
            kinds,
            buses: Tables::of("bus", &self.bus, spans),
            devices: Tables::of("device", &self.device, spans),
            signals: Tables::of("signal", &self.signal, spans),
            axes: Tables::of("axis", &self.axis, spans),
            outputs: Tables::of("output", &self.output, spans),
            sets: Tables::of("set", &self.set, spans),
            written_frames: RefCell::default(),
            dbcs: RefCell::default(),
            periods: Periods::new(self),
        };
        let profile = check.profile(path);
        let (errors, warnings) = check.report.into_findings();
        Checked { profile: profile.filter(|_| errors.is_empty()), errors, warnings }
    }
}

impl<T> Tables<T> {
    fn of<R>(kind: &'static str, raw: &BTreeMap<String, R>, spans: &SourceMap) -> Tables<T> {
        Tables { names: Names::of(kind, raw, spans), resolved: Vec::new() }
    }

    /// Returns the resolved table at this index. `None` if it has errors.
    pub(crate) fn get(&self, place: usize) -> Option<&T> {
        self.resolved.get(place)?.as_ref()
    }

    /// Iterates over the tables without errors.
    pub(crate) fn valid(&self) -> impl Iterator<Item = &T> {
        self.resolved.iter().flatten()
    }

    /// Takes all resolved tables. `None` if one of them has errors.
    fn whole(&mut self) -> Option<Vec<T>> {
        std::mem::take(&mut self.resolved).into_iter().collect()
    }
}

impl Check<'_> {
    /// Resolves all tables. The order matters, because each step uses the results of those before it.
    fn profile(&mut self, path: PathBuf) -> Option<Profile> {
        let raw = self.raw;
        self.check_names();
        let machine = machine::resolve(&self.at("machine"), raw.machine.as_ref(), || self.guarded_keys());
        self.buses.resolved = self.each(&self.buses, &raw.bus, RawBus::resolve);
        bus::one_owner_each(self);
        bus::none_waits_for_a_period(self);
        self.devices.resolved = self.each(&self.devices, &raw.device, RawDevice::resolve);
        self.signals.resolved = self.each(&self.signals, &raw.signal, RawSignal::resolve);
        self.report
            .set_units(self.signals.resolved.iter().map(|signal| Some(signal.as_ref()?.unit)).collect());
        self.axes.resolved = self.each(&self.axes, &raw.axis, RawAxis::resolve);
        signal::limits::set_defaults(self);
        self.outputs.resolved = self.each(&self.outputs, &raw.output, RawOutput::resolve);
        axis::intercept_slope::resolve(self);
        output::note_counts(self);
        restart::boot_counters(self);
        set::resolve(self);
        let heartbeat = raw.heartbeat.as_ref().and_then(|raw| raw.resolve(self, &self.at("heartbeat")));
        let web = raw.web.as_ref().map(|raw| raw.resolve(&self.at("web")));
        let mqtt = raw.mqtt.as_ref().and_then(|raw| raw.resolve(&self.at("mqtt")));
        let notify = notify::resolve(&self.at("notify"), &raw.notify);
        let history = raw.history.as_ref().map(|raw| raw.resolve(&self.at("history"))).unwrap_or_default();
        let kinds = self.kinds;
        kinds.iter().for_each(|kind| (kind.complete)(self));
        kinds.iter().for_each(|kind| (kind.check)(self));
        claims::one_writer_each(self, heartbeat.as_ref());
        claims::check(self, heartbeat.as_ref());
        incomplete_parts::warn(self);
        let only_recorded = incomplete_parts::only_recorded(self);
        let profile = Profile {
            name: machine.name,
            label: machine.label,
            description: machine.description,
            path,
            machine: MachineSettings { signals: self.signals.resolved.len(), ..machine.settings },
            arm: machine.arm,
            arm_timeout: machine.arm_timeout,
            on_stop: machine.on_stop,
            buses: self.buses.whole()?,
            devices: self.devices.whole()?,
            signals: self.signals.whole()?,
            only_recorded,
            axes: self.axes.whole()?,
            outputs: self.outputs.whole()?,
            sets: self.sets.whole()?,
            heartbeat,
            web,
            mqtt,
            notify,
            history,
            overridden: Vec::new(),
        };
        axis::doubts::warn(self, &profile);
        Some(profile)
    }

    /// Resolves the tables of one kind, in the order of the file.
    fn each<R, T>(
        &self,
        tables: &Tables<T>,
        raw: &BTreeMap<String, R>,
        resolve: impl Fn(&R, &Check<'_>, &KeyContext<'_>, &str) -> Option<T>,
    ) -> Vec<Option<T>> {
        let all = self.at(tables.names.kind);
        tables.names.iter().map(|name| resolve(raw.get(name)?, self, &all.key(name), name)).collect()
    }

    /// Lists the keys that a layer may only set with permission.
    fn guarded_keys(&self) -> Vec<String> {
        guarded_keys(&[
            ("axis", &self.axes.names),
            ("output", &self.outputs.names),
            ("set", &self.sets.names),
            ("heartbeat", &[]),
            ("bus", &self.buses.names),
            ("device", &self.devices.names),
            ("signal", &self.signals.names),
        ])
    }

    fn check_names(&self) {
        let kinds = [
            &self.buses.names,
            &self.devices.names,
            &self.signals.names,
            &self.axes.names,
            &self.outputs.names,
            &self.sets.names,
        ];
        for (kind, name) in
            kinds.into_iter().flat_map(|names| names.iter().map(move |name| (names.kind, name)))
        {
            let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-');
            if name.is_empty() || !name.bytes().all(is_plain) {
                let help =
                    "allowed: letters a to z, digits, `_` and `-`; the name is used in logs and metrics";
                self.at(kind).key(name).wrong_key(format!("`{name}` cannot be a name"), help);
            }
        }
        if self.signals.names.place("time").is_some() {
            let message = "`time` is the first column of every log";
            self.at("signal").key("time").wrong_key(message, "give the signal another name");
        }
    }

    /// Returns a key at the top of the profile.
    pub(crate) fn at(&self, key: &str) -> KeyContext<'_> {
        self.report.at(key)
    }

    /// Returns the kind of a device's line. `None` if the device or its line is unknown.
    fn line_kind(&self, device: Option<&String>) -> Option<&'static BusKind> {
        self.line_kind_of(self.raw.device.get(device?)?)
    }

    /// Returns the kind of a device's line. `None` if the line is unknown.
    fn line_kind_of(&self, device: &RawDevice) -> Option<&'static BusKind> {
        self.kind_of_line(self.raw.bus.get(device.bus.as_ref()?)?)
    }

    /// Returns the kind of a line. If its type has an error, other keys may show it.
    fn kind_of_line(&self, line: &RawBus) -> Option<&'static BusKind> {
        self.kinds.iter().copied().find(|kind| match line.kind {
            Some(of) => kind.line_type(of).is_some(),
            None => (kind.recognises)(line),
        })
    }

    /// Iterates over the other kinds than this one.
    fn kinds_beside(&self, own: &'static BusKind) -> impl Iterator<Item = &'static BusKind> {
        self.kinds.iter().copied().filter(move |kind| !std::ptr::eq(*kind, own))
    }

    /// Returns the bus of a device.
    pub(crate) fn bus_of(&self, device: &Device) -> Option<&Bus> {
        self.buses.get(device.bus.0)
    }
}

//! Tables of a profile, one file each: the keys as written, the resolved form, the checks, and the preview of `isotherm
//! check`.
//!
//! A table that cannot be resolved leaves a gap in its list. The indices of the other tables, and the checks on them,
//! then stay correct. If any table has an error, the result is no profile.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::Profile;
use crate::duration::{Timespan, shown};
use crate::error::{Findings, ProfileError, allowed};
use crate::files::Files;
use crate::source_map::{SourceMap, child, element};
use crate::template::Templates;
use axis::{Axis, RawAxis};
use bus::periods::Periods;
use bus::{Bus, LineKind, RawBus};
use device::{Device, RawDevice};
use heartbeat::RawHeartbeat;
use history::RawHistory;
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::reading::SignalId;
use machine::RawMachine;
use mqtt::RawMqtt;
use notify::RawNotify;
use output::{Output, RawOutput};
use set::{OutputSet, RawSet};
use signal::{RawSignal, Signal};
use web::RawWeb;

pub(crate) mod axis;
pub(crate) mod bus;
pub(crate) mod can;
mod claims;
pub(crate) mod dbc;
pub(crate) mod device;
mod expression;
pub(crate) mod handshake;
pub(crate) mod heartbeat;
pub(crate) mod history;
mod incomplete_parts;
pub(crate) mod label;
mod line_time;
pub(crate) mod machine;
pub(crate) mod mqtt;
pub(crate) mod notify;
pub(crate) mod opcua;
pub(crate) mod output;
pub(crate) mod quirks;
pub(crate) mod register;
mod restart;
pub(crate) mod schema;
pub(crate) mod set;
pub(crate) mod signal;
mod sysfs;
pub(crate) mod web;

/// One machine: its buses, devices, signals, axes and outputs.
///
/// The JSON schema is generated from the `Raw…` types, and each layer is checked against it. Editors and error messages
/// show the doc comments of the fields. Every key is an `Option`, even if it is required. The schema check reports
/// missing and wrong keys and leaves them out, so that the other keys can still be checked.
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
    device: BTreeMap<String, RawDevice>,
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

/// Shortest allowed period of reads, writes and decisions. A period of a microsecond would send 66,000 requests per
/// second, and occupy the whole computer.
const SHORTEST_PERIOD: Duration = Duration::from_millis(1);

/// Result of checking a profile. `profile` is `None` if there are errors.
pub(crate) struct Checked {
    pub(crate) profile: Option<Profile>,
    pub(crate) errors: Findings,
    pub(crate) warnings: Findings,
}

/// Tables of one kind: their names in the order of the file, and the resolved ones so far.
struct Tables<T> {
    kind: &'static str,
    names: Vec<String>,
    places: HashMap<String, usize>,
    /// Resolved tables in the same order. `None` if a table has errors.
    resolved: Vec<Option<T>>,
}

/// State of a check in progress.
pub(crate) struct Check<'a> {
    raw: &'a RawProfile,
    spans: &'a SourceMap,
    files: &'a Files<'a>,
    templates: &'a Templates,
    buses: Tables<Bus>,
    devices: Tables<Device>,
    signals: Tables<Signal>,
    axes: Tables<Axis>,
    outputs: Tables<Output>,
    sets: Tables<OutputSet>,
    errors: RefCell<Findings>,
    warnings: RefCell<Findings>,
    /// For each signal, by its index: whether a model, condition, output or machine state uses it.
    used: RefCell<Vec<bool>>,
    /// Frames that outputs write on CAN lines.
    written_frames: RefCell<Vec<can::Written>>,
    dbcs: RefCell<dbc::Dbcs>,
    /// Periods of reads and writes on each line.
    periods: Periods,
}

/// Key of the profile that is being checked, with functions for its errors and warnings.
#[derive(Clone)]
struct KeyContext<'c> {
    check: &'c Check<'c>,
    path: String,
}

impl RawProfile {
    /// Checks and resolves the profile.
    pub(crate) fn check(
        &self,
        spans: &SourceMap,
        path: PathBuf,
        files: &Files<'_>,
        templates: &Templates,
    ) -> Checked {
        let mut check = Check {
            raw: self,
            spans,
            files,
            templates,
            buses: Tables::of("bus", &self.bus, spans),
            devices: Tables::of("device", &self.device, spans),
            signals: Tables::of("signal", &self.signal, spans),
            axes: Tables::of("axis", &self.axis, spans),
            outputs: Tables::of("output", &self.output, spans),
            sets: Tables::of("set", &self.set, spans),
            errors: RefCell::default(),
            warnings: RefCell::default(),
            used: RefCell::new(vec![false; self.signal.len()]),
            written_frames: RefCell::default(),
            dbcs: RefCell::default(),
            periods: Periods::new(self),
        };
        let profile = check.profile(path);
        let (errors, warnings) = (check.errors.into_inner(), check.warnings.into_inner());
        Checked { profile: profile.filter(|_| errors.is_empty()), errors, warnings }
    }
}

/// Resolves an optional part of the profile. Returns `Some(None)` if the part is absent, and `None` if it has errors.
fn optional<R, T>(raw: Option<R>, resolve: impl FnOnce(R) -> Option<T>) -> Option<Option<T>> {
    raw.map_or(Some(None), |raw| resolve(raw).map(Some))
}

impl<T> Tables<T> {
    fn of<R>(kind: &'static str, raw: &BTreeMap<String, R>, spans: &SourceMap) -> Tables<T> {
        let mut names: Vec<String> = raw.keys().cloned().collect();
        names.sort_by_key(|name| spans.rank(&child(kind, name)));
        let places = names.iter().cloned().enumerate().map(|(place, name)| (name, place)).collect();
        Tables { kind, names, places, resolved: Vec::new() }
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.places.get(name).copied()
    }

    /// Returns the resolved table at this index. `None` if it has errors.
    fn get(&self, place: usize) -> Option<&T> {
        self.resolved.get(place)?.as_ref()
    }

    /// Iterates over the tables without errors.
    fn valid(&self) -> impl Iterator<Item = &T> {
        self.resolved.iter().flatten()
    }

    /// Moves all resolved tables out of the list. `None` if one of them has errors.
    fn whole(&mut self) -> Option<Vec<T>> {
        std::mem::take(&mut self.resolved).into_iter().collect()
    }
}

impl Check<'_> {
    /// Resolves all tables. The order matters, because each step uses the results of those before it.
    fn profile(&mut self, path: PathBuf) -> Option<Profile> {
        let raw = self.raw;
        self.check_names();
        let machine = machine::resolve(&self.at("machine"), raw.machine.as_ref());
        self.buses.resolved = self.each(&self.buses, &raw.bus, RawBus::resolve);
        bus::one_owner_each(self);
        bus::none_waits_for_a_period(self);
        self.devices.resolved = self.each(&self.devices, &raw.device, RawDevice::resolve);
        self.signals.resolved = self.each(&self.signals, &raw.signal, RawSignal::resolve);
        self.axes.resolved = self.each(&self.axes, &raw.axis, RawAxis::resolve);
        self.outputs.resolved = self.each(&self.outputs, &raw.output, RawOutput::resolve);
        axis::intercept_slope::resolve(self);
        output::note_counts(self);
        restart::boot_counters(self);
        set::resolve(self);
        let heartbeat = raw.heartbeat.as_ref().and_then(|raw| raw.resolve(&self.at("heartbeat")));
        let web = raw.web.as_ref().map(|raw| raw.resolve(&self.at("web")));
        let mqtt = raw.mqtt.as_ref().and_then(|raw| raw.resolve(&self.at("mqtt")));
        let notify = notify::resolve(&self.at("notify"), &raw.notify);
        let history = raw.history.as_ref().map(|raw| raw.resolve(&self.at("history"))).unwrap_or_default();
        can::written_frames(self);
        can::conflicts(self);
        claims::one_writer_each(self, heartbeat.as_ref());
        claims::check(self, heartbeat.as_ref());
        line_time::check(self);
        sysfs::too_quick(self);
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
    fn each<'c, R, T>(
        &'c self,
        tables: &Tables<T>,
        raw: &BTreeMap<String, R>,
        resolve: impl Fn(&R, &KeyContext<'c>, &str) -> Option<T>,
    ) -> Vec<Option<T>> {
        let all = self.at(tables.kind);
        tables.names.iter().map(|name| resolve(raw.get(name)?, &all.key(name), name)).collect()
    }

    fn check_names(&self) {
        let kinds = [
            (self.buses.kind, &self.buses.names),
            (self.devices.kind, &self.devices.names),
            (self.signals.kind, &self.signals.names),
            (self.axes.kind, &self.axes.names),
            (self.outputs.kind, &self.outputs.names),
            (self.sets.kind, &self.sets.names),
        ];
        for (kind, name) in
            kinds.into_iter().flat_map(|(kind, names)| names.iter().map(move |name| (kind, name)))
        {
            let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-');
            if name.is_empty() || !name.bytes().all(is_plain) {
                let help =
                    "allowed: letters a to z, digits, `_` and `-`; the name is used in logs and metrics";
                self.at(kind).key(name).wrong_key(format!("`{name}` cannot be a name"), help);
            }
        }
        if self.signals.place("time").is_some() {
            let message = "`time` is the first column of every log";
            self.at("signal").key("time").wrong_key(message, "give the signal another name");
        }
    }

    /// Returns the context of a key at the top of the profile.
    fn at(&self, key: &str) -> KeyContext<'_> {
        KeyContext { check: self, path: String::new() }.key(key)
    }

    /// Returns the kind of a device's line. `None` if the device or its line is unknown.
    fn line_kind(&self, device: Option<&String>) -> Option<LineKind> {
        self.raw.device.get(device?)?.line_kind(self)
    }

    /// Returns the bus of a device.
    fn bus_of(&self, device: &Device) -> Option<&Bus> {
        self.buses.get(device.bus.0)
    }
}

impl<'c> KeyContext<'c> {
    /// Returns the context of a key in this table.
    fn key(&self, key: &str) -> KeyContext<'c> {
        KeyContext { check: self.check, path: child(&self.path, key) }
    }

    /// Returns the context of an entry in this list.
    fn item(&self, index: usize) -> KeyContext<'c> {
        KeyContext { check: self.check, path: element(&self.path, index) }
    }

    /// Returns whether this table has the key with a value of the correct type.
    fn has(&self, key: &str) -> bool {
        self.check.spans.is_right(&child(&self.path, key))
    }

    /// Returns whether this key has been written, with a correct or a wrong value.
    fn is_written(&self) -> bool {
        self.check.spans.contains(&self.path)
    }

    /// Returns file and line of this key for messages, for example `profiles/x.toml:41`.
    fn line(&self) -> String {
        self.check.spans.line_of(&self.path)
    }

    /// Reports an error at the value of this key.
    fn invalid(&self, message: impl Into<String>, help: impl Into<String>) {
        if self.is_enough() {
            return;
        }
        self.error(self.check.spans.at_value(&self.path, message, Some(help.into())));
    }

    /// Reports an error at the value of this key. Returns `None`.
    fn reject<T>(&self, message: impl Into<String>, help: impl Into<String>) -> Option<T> {
        self.invalid(message, help);
        None
    }

    /// Returns whether the limit of described errors is reached. If so, counts one more error, and the caller describes
    /// none.
    fn is_enough(&self) -> bool {
        let mut errors = self.check.errors.borrow_mut();
        let is_full = errors.is_full();
        if is_full {
            errors.count();
        }
        is_full
    }

    /// Reports an error at the name of this key, for example because the key should not be present.
    fn wrong_key(&self, message: impl Into<String>, help: impl Into<String>) {
        if self.is_enough() {
            return;
        }
        self.error(self.check.spans.at_key(&self.path, message, Some(help.into())));
    }

    /// Reports this key as missing, because other keys require it. A key with a wrong value has been reported already.
    fn missing(&self, message: impl Into<String>, help: impl Into<String>) {
        if !self.is_written() && !self.check.spans.is_right(&self.path) {
            self.wrong_key(message, help);
        }
    }

    /// Reports those of `keys` that this table has, although they are only for `owner`.
    fn not_applicable(&self, keys: &[&str], owner: &str, help: &str) {
        for key in keys.iter().filter(|key| self.has(key)) {
            self.key(key).wrong_key(format!("`{key}` is only for {owner}"), help);
        }
    }

    fn error(&self, error: ProfileError) {
        self.check.errors.borrow_mut().push(error);
    }

    /// Reports a warning at the value of this key.
    fn warn(&self, message: impl Into<String>, help: impl Into<String>) {
        let warning = self.check.spans.at_value(&self.path, message, Some(help.into()));
        self.check.warnings.borrow_mut().push(warning);
    }

    /// Warns if the private key or password in this file can be read by any user.
    fn secret(&self, name: Option<&String>) {
        if let Some(name) = name.filter(|name| self.check.files.is_open_to_all(name)) {
            let file = self.check.files.path(name);
            let message =
                format!("every user of this computer can read {file}, and use it to act as the gateway");
            self.warn(message, format!("remove the permission of other users: `chmod o= {file}`"));
        }
    }

    /// Reports a warning at the name of this key.
    fn warn_key(&self, message: impl Into<String>, help: Option<&str>) {
        let warning = self.check.spans.at_key(&self.path, message, help.map(str::to_owned));
        self.check.warnings.borrow_mut().push(warning);
    }

    /// Returns the index of the table with this name. Reports an unknown name.
    fn named<T>(&self, tables: &Tables<T>, name: Option<&String>) -> Option<usize> {
        let name = name?;
        let found = tables.place(name);
        // If the table exists but has errors, these have been reported.
        if found.is_none() && !self.check.spans.contains(&child(tables.kind, name)) {
            if self.is_enough() {
                return None;
            }
            let help = allowed(name, tables.names.iter().map(String::as_str));
            self.invalid(format!("there is no {} named `{name}`", tables.kind), help);
        }
        found
    }

    /// Returns the signal with this name, and marks it as used.
    fn signal(&self, name: Option<&String>) -> Option<SignalId> {
        let found = self.named(&self.check.signals, name)?;
        self.check.used.borrow_mut()[found] = true;
        Some(SignalId(found))
    }

    /// Returns the signal with this name, which must be a position in mm.
    fn position(&self, name: Option<&String>) -> Option<SignalId> {
        let position = self.signal(name)?;
        let (name, signal) = (name?, self.check.signals.get(position.0));
        // A wrong unit has been reported.
        if let Some(unit) = signal.map(|signal| signal.unit.0).filter(|unit| *unit != "mm") {
            let help = format!("write unit = \"mm\" and the scale in mm per count at signal `{name}`");
            self.invalid(format!("`{name}` is in \"{unit}\"; a position is in mm"), help);
        }
        Some(position)
    }

    /// Returns whether this signal is a temperature.
    fn is_temperature(&self, signal: Option<SignalId>) -> bool {
        let signal = signal.and_then(|id| self.check.signals.get(id.0));
        signal.is_some_and(|signal| matches!(signal.unit.0, "degC" | "K"))
    }

    /// Returns a duration. Reports a duration of zero, and returns `None`.
    fn duration(&self, raw: Option<Timespan>) -> Option<Duration> {
        let Timespan(span) = raw?;
        if span.is_zero() {
            return self.reject("a duration of zero is not allowed here", "write a longer one, as \"1s\"");
        }
        Some(span)
    }

    /// Returns the period of a read or write. Reports a period so short that it would occupy the line and the computer.
    fn period(&self, raw: Option<Timespan>) -> Option<Duration> {
        let span = self.duration(raw)?;
        if span < SHORTEST_PERIOD {
            let (short, shortest) = (shown(span), shown(SHORTEST_PERIOD));
            let message = format!("every {short} is too often: {shortest} is the shortest period");
            return self.reject(message, "no device answers this fast; write \"10ms\" or longer");
        }
        Some(span)
    }

    /// Returns a positive number. Reports any other number, and returns `None`.
    fn positive(&self, number: Option<f64>) -> Option<f64> {
        let number = number?;
        if number <= 0.0 {
            return self.reject(format!("{number} is not above zero"), "write a number above zero");
        }
        Some(number)
    }

    /// Returns the content of the file with this name.
    fn file(&self, name: &str, help: &str) -> Option<Vec<u8>> {
        self.check.files.read(name).map_err(|why| self.invalid(why, help)).ok()
    }
}

//! Tables of a profile, one file each: the keys as written (`Raw…` types), the resolved form, the checks, and
//! the preview that `isotherm check` prints.
//!
//! To resolve a table or a key means to check its values, and to convert them to the types that the gateway
//! uses. Functions that resolve something report the errors that they find, and usually return `None` if
//! there is an error.
//!
//! A table with an error is `None` in the list of its kind, so that the indices of the other tables stay
//! correct. If any table has an error, the check returns no profile.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::Value;

use crate::Profile;
use crate::error::Findings;
use crate::files::Files;
use crate::key_context::{Names, Report};
use crate::log_columns::{Clash, clashes};
use crate::members::ProfileMembers;
use crate::protected_keys::guarded_keys;
use crate::source_map::SourceMap;
use crate::template::Templates;
use bus::RawBus;
use bus::periods::Periods;
use bus_kind::BusKind;
use check::Tables;
use device::RawDevice;
use isotherm_core::compensation::settings::MachineSettings;
use output::RawOutput;
use signal::RawSignal;

pub(crate) use crate::key_context::{KeyContext, optional};
pub(crate) use check::Check;
pub(crate) use raw_profile::RawProfile;

pub(crate) mod axis;
pub(crate) mod bus;
pub(crate) mod bus_kind;
mod check;
mod claims;
mod default_limits;
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
pub(crate) mod opcua_server;
pub(crate) mod output;
mod raw_profile;
pub(crate) mod register;
mod restart;
pub(crate) mod schema;
pub(crate) mod set;
pub(crate) mod signal;
pub(crate) mod web;

/// Result of checking a profile: the errors, the warnings, and the resolved profile. The profile is `None` if there is
/// an error.
pub(crate) struct Checked {
    pub(crate) profile: Option<Profile>,
    pub(crate) errors: Findings,
    pub(crate) warnings: Findings,
}

impl RawProfile {
    /// Checks all tables of the profile, and resolves them.
    pub(crate) fn check(
        &self,
        spans: &SourceMap,
        path: PathBuf,
        (files, schema): (&Files<'_>, &Value),
        templates: &Templates,
        kinds: &'static [&'static BusKind],
    ) -> Checked {
        let mut check = Check {
            raw: self,
            schema,
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

impl Check<'_> {
    /// Resolves all tables, in a fixed order because each step uses the results of earlier steps.
    fn profile(&mut self, path: PathBuf) -> Option<Profile> {
        let raw = self.raw;
        self.check_names();
        let machine = machine::resolve(&self.at("machine"), raw.machine.as_ref(), || self.guarded_keys());
        self.buses.resolved = self.each(&self.buses, &raw.bus, RawBus::resolve);
        bus::resolve::one_owner_each(self);
        bus::resolve::none_waits_for_a_period(self);
        self.devices.resolved = self.each(&self.devices, &raw.device, RawDevice::resolve);
        self.signals.resolved = self.each(&self.signals, &raw.signal, RawSignal::resolve);
        self.report
            .set_units(self.signals.resolved.iter().map(|signal| Some(signal.as_ref()?.unit)).collect());
        let settle = raw.machine.as_ref().and_then(|machine| machine.settle);
        self.axes.resolved =
            self.each(&self.axes, &raw.axis, |raw, _, at, name| raw.resolve(settle, at, name));
        axis::learned_model::add_slots(self);
        default_limits::set_default_limits(self);
        self.outputs.resolved = self.each(&self.outputs, &raw.output, RawOutput::resolve);
        axis::intercept_slope::resolve(self);
        output::range::note_counts(self);
        restart::boot_counters(self);
        set::resolve::resolve(self);
        let heartbeat = raw.heartbeat.as_ref().and_then(|raw| raw.resolve(self, &self.at("heartbeat")));
        let web = raw.web.as_ref().map(|raw| raw.resolve(&self.at("web")));
        let mqtt = raw.mqtt.as_ref().and_then(|raw| raw.resolve(&self.at("mqtt")));
        let opcua_server = opcua_server::resolve(&self.at("opcua_server"), raw.opcua_server.as_ref());
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
            opcua_server,
            notify,
            history,
            overridden: Vec::new(),
            members: ProfileMembers::default(),
        };
        axis::doubts::warn(self, &profile);
        Some(profile)
    }

    /// Resolves the tables of one kind, in the order of the file. A table with an error is `None` in the result.
    fn each<R, T>(
        &self,
        tables: &Tables<T>,
        raw: &BTreeMap<String, R>,
        resolve: impl Fn(&R, &Check<'_>, &KeyContext<'_>, &str) -> Option<T>,
    ) -> Vec<Option<T>> {
        let all = self.at(tables.names.kind);
        tables.names.iter().map(|name| resolve(raw.get(name)?, self, &all.key(name), name)).collect()
    }

    /// Returns the keys that a layer above the profile file (local file, environment, `--set`) may set only if
    /// `allow_override` lists them.
    fn guarded_keys(&self) -> Vec<String> {
        let names: [(&str, &[String]); 7] = [
            ("axis", &self.axes.names),
            ("output", &self.outputs.names),
            ("set", &self.sets.names),
            ("heartbeat", &[]),
            ("bus", &self.buses.names),
            ("device", &self.devices.names),
            ("signal", &self.signals.names),
        ];
        guarded_keys(self.schema, &names)
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
                let help = "allowed: letters a to z, digits, `_` and `-`, for logs and metrics; write the name \
                            for people as `label`";
                self.at(kind).key(name).wrong_key(format!("`{name}` cannot be a name"), help);
            }
        }
        for clash in clashes(&self.signals.names, &self.axes.names) {
            let mut why = "a log with two columns of the same name cannot be read";
            let (kind, name, message) = match clash {
                Clash::OfMachine { signal } => {
                    let message = format!("`{signal}` is a column of every log");
                    ("signal", signal, message)
                }
                Clash::OfAxis { signal, axis } => {
                    let message = format!("`{signal}` is a column of axis `{axis}` in the log");
                    ("signal", signal, message)
                }
                Clash::OfDates { signal } => {
                    why = "its values would be read as dates, and the signal would be lost";
                    let message = format!("`{signal}` is the name of a column with dates in a log");
                    ("signal", signal, message)
                }
                Clash::Axes { axis, other, column } => {
                    let message =
                        format!("axes `{other}` and `{axis}` would both have the column `{column}`");
                    ("axis", axis, message)
                }
            };
            let help = format!("give the {kind} another name: {why}");
            self.at(kind).key(&name).wrong_key(message, help);
        }
    }
}

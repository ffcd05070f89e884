//! From the profile as written to the resolved [`Profile`]: every contradiction, with its place.
//!
//! A thing that cannot be resolved leaves a gap in its list, so that the places of the others, and the checks on
//! them, stay right; with a single error there is no profile.

use std::collections::HashMap;
use std::path::PathBuf;
use std::time::Duration;

use crate::error::{ProfileError, allowed};
use crate::files::Files;
use crate::place::{Places, child};
use crate::raw::{ArmWord, RawProfile, Span};
use crate::template::Templates;
use crate::{Arm, Bus, Device, History, Profile, Signal, Web};
use isotherm_core::compensation::settings::MachineSettings;
use isotherm_core::reading::SignalId;

mod applied;
mod axis;
mod can;
mod counter;
mod data;
mod display;
mod expression;
mod fieldbus;
mod line;
mod loose_ends;
mod model;
mod output;
mod probe;
mod registers;
mod restart;
mod serial;
mod set;
mod share;
mod signal;
mod tls;
mod verify;

/// What the check found.
pub(crate) struct Checked {
    pub(crate) profile: Option<Profile>,
    pub(crate) errors: Vec<ProfileError>,
    pub(crate) warnings: Vec<ProfileError>,
}

/// Names of one kind of thing, in the order of the file: a name's place is its index.
pub(crate) struct Names {
    table: &'static str,
    names: Vec<String>,
    places: HashMap<String, usize>,
}

pub(crate) struct Check<'a> {
    raw: &'a RawProfile,
    places: &'a Places,
    files: &'a Files<'a>,
    templates: &'a Templates,
    errors: Vec<ProfileError>,
    warnings: Vec<ProfileError>,
    buses: Names,
    devices: Names,
    signals: Names,
    axes: Names,
    outputs: Names,
    sets: Names,
    used: Vec<bool>,
    /// What outputs write in CAN frames.
    written: Vec<can::Written>,
    dbcs: can::Dbcs,
}

/// Whether a duration of nothing makes sense.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Zero {
    Allowed,
    Refused,
}

/// Resolves a profile.
pub(crate) fn check(
    raw: &RawProfile,
    places: &Places,
    path: PathBuf,
    files: &Files<'_>,
    templates: &Templates,
) -> Checked {
    let names = |table, keys: Vec<&String>| Names::ordered(table, keys, places);
    let mut check = Check {
        raw,
        places,
        files,
        templates,
        errors: Vec::new(),
        warnings: Vec::new(),
        buses: names("bus", raw.bus.keys().collect()),
        devices: names("device", raw.device.keys().collect()),
        signals: names("signal", raw.signal.keys().collect()),
        axes: names("axis", raw.axis.keys().collect()),
        outputs: names("output", raw.output.keys().collect()),
        sets: names("set", raw.set.keys().collect()),
        used: vec![false; raw.signal.len()],
        written: Vec::new(),
        dbcs: can::Dbcs::new(),
    };
    let profile = check.profile(path);
    let profile = profile.filter(|_| check.errors.is_empty());
    Checked { profile, errors: check.errors, warnings: check.warnings }
}

impl Names {
    fn ordered(table: &'static str, keys: Vec<&String>, places: &Places) -> Names {
        let mut names: Vec<String> = keys.into_iter().cloned().collect();
        names.sort_by_key(|name| places.rank(&child(table, name)));
        let places = names.iter().cloned().enumerate().map(|(place, name)| (name, place)).collect();
        Names { table, names, places }
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.places.get(name).copied()
    }

    /// Each with its index, its name and its path.
    fn each(&self) -> Vec<(usize, String, String)> {
        let path = |name: &String| child(self.table, name);
        self.names.iter().enumerate().map(|(index, name)| (index, name.clone(), path(name))).collect()
    }
}

impl Check<'_> {
    fn profile(&mut self, path: PathBuf) -> Option<Profile> {
        self.names();
        let (name, description, mut machine, arm) = self.machine();
        let buses = self.buses();
        self.one_owner_each(&buses);
        let mut devices = self.devices(&buses);
        let mut signals = self.signals(&devices, &buses);
        let axes = self.axes(&signals);
        let (mut outputs, axes) = self.outputs(axes, &devices, &signals, &buses);
        self.boot_counters(&mut outputs, &mut signals, &devices, &buses);
        machine.signals = signals.len();
        let sets = self.sets(&mut outputs, &axes, &devices, &buses);
        let heartbeat = self.heartbeat(&devices, &buses);
        let web = self.web();
        let history = self.history();
        if self.raw.mqtt.is_some() {
            self.not_built("mqtt", "publishing over MQTT", None);
        }
        self.written_frames(&mut devices);
        self.can_conflicts(&buses, &devices, &signals, &outputs);
        self.registers(&buses, &devices, &signals, &outputs, &sets, heartbeat.as_ref());
        self.time_on_lines(&buses, &devices, &signals);
        self.loose_ends(&devices, &outputs);
        Some(Profile {
            name,
            description,
            path,
            machine,
            arm,
            buses: complete(buses)?,
            devices: complete(devices)?,
            signals: complete(signals)?,
            axes: complete(axes)?,
            outputs: complete(outputs)?,
            sets: complete(sets)?,
            heartbeat,
            web,
            history,
        })
    }

    fn names(&mut self) {
        let lists = [&self.buses, &self.devices, &self.signals, &self.axes, &self.outputs, &self.sets];
        let all: Vec<_> = lists.into_iter().flat_map(Names::each).collect();
        for (_, name, path) in all {
            let plain = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-'));
            if name.is_empty() || !plain {
                let help =
                    "a name is made of letters a to z, digits, `_` and `-`; it goes into logs and metrics";
                self.wrong_key(&path, format!("`{name}` cannot be a name"), help);
            }
        }
        if self.signals.position("time").is_some() {
            self.wrong_key(
                "signal.time",
                "`time` is the first column of every log",
                "give the signal another name",
            );
        }
    }

    fn machine(&mut self) -> (String, String, MachineSettings, Arm) {
        let raw = self.raw;
        let signals = self.signals.names.len();
        let Some(machine) = &raw.machine else {
            let settings = MachineSettings { signals, ..MachineSettings::default() };
            return (String::new(), String::new(), settings, Arm::Auto);
        };
        let name = machine.name.clone().unwrap_or_default();
        let plain = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
        if machine.name.is_some() && (name.is_empty() || !name.bytes().all(plain)) {
            let help =
                "allowed: small letters a to z, digits and `-`; it goes into topics, metrics and file names";
            self.wrong("machine.name", format!("`{name}` cannot be a machine's name"), help);
        }
        let on = machine.on.as_ref().and_then(|on| self.signal("machine.on", on));
        let zero = machine.zero.as_ref().and_then(|zero| self.signal("machine.zero", zero));
        let settle = self.span("machine.settle", machine.settle.as_ref(), Zero::Allowed).unwrap_or_default();
        let arm = if machine.arm == Some(ArmWord::Manual) { Arm::Manual } else { Arm::Auto };
        let settings = MachineSettings { on, zero, settle, signals };
        (name, machine.description.clone().unwrap_or_default(), settings, arm)
    }

    fn web(&mut self) -> Option<Web> {
        let raw = self.raw;
        let web = raw.web.as_ref()?;
        let listen = web.listen.clone().unwrap_or_else(|| "127.0.0.1:8080".to_owned());
        match host_of(&listen) {
            None => {
                let help = "write host and port, as \"127.0.0.1:8080\"; port 0 takes any free one";
                self.wrong("web.listen", format!("`{listen}` is no host and port"), help);
            }
            Some(host)
                if !is_loopback(host)
                    && web.token_file.is_none()
                    && !self.places.contains("web.token_file") =>
            {
                let help =
                    "listen on 127.0.0.1, or give `token_file`, a file with the token that clients must send";
                self.wrong("web.listen", format!("`{listen}` is open to the network without a token"), help);
            }
            Some(_) => {}
        }
        Some(Web { listen, token_file: web.token_file.clone().map(PathBuf::from) })
    }

    fn history(&mut self) -> History {
        let raw = self.raw;
        let history = raw.history.clone().unwrap_or_default();
        let keep = self.span("history.keep", history.keep.as_ref(), Zero::Refused);
        History {
            directory: history.directory.map(PathBuf::from),
            keep: keep.unwrap_or(Duration::from_secs(90 * 24 * 3600)),
        }
    }

    fn wrong(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        self.errors.push(self.places.at_value(path, message, Some(help.into())));
    }

    fn wrong_key(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        self.errors.push(self.places.at_key(path, message, Some(help.into())));
    }

    /// A key that this combination needs. One that is there but wrong has been reported already.
    fn missing(&mut self, table: &str, key: &str, message: impl Into<String>, help: impl Into<String>) {
        let path = child(table, key);
        if !self.places.contains(&path) {
            self.errors.push(self.places.at_key(&path, message, Some(help.into())));
        }
    }

    fn not_built(&mut self, path: &str, what: &str, help: Option<&str>) {
        self.errors.push(self.places.at_key(path, format!("not built yet: {what}"), help.map(str::to_owned)));
    }

    /// The place of what a key names.
    fn index(&mut self, path: &str, names: fn(&Self) -> &Names, name: &str) -> Option<usize> {
        let known = names(self);
        let (kind, found) = (known.table, known.position(name));
        // A thing that is there but wrong has been reported itself.
        if found.is_none() && !self.places.contains(&child(kind, name)) {
            let help = allowed(name, known.names.iter().map(String::as_str));
            self.wrong(path, format!("there is no {kind} named `{name}`"), help);
        }
        found
    }

    fn bus_index(&mut self, path: &str, name: &str) -> Option<usize> {
        self.index(path, |check| &check.buses, name)
    }

    fn device_index(&mut self, path: &str, name: &str) -> Option<usize> {
        self.index(path, |check| &check.devices, name)
    }

    fn axis_index(&mut self, path: &str, name: &str) -> Option<usize> {
        self.index(path, |check| &check.axes, name)
    }

    /// A signal that something uses.
    fn signal(&mut self, path: &str, name: &str) -> Option<SignalId> {
        let found = self.index(path, |check| &check.signals, name)?;
        self.used[found] = true;
        Some(SignalId(found))
    }

    fn set_index(&mut self, path: &str, name: &str) -> Option<usize> {
        self.index(path, |check| &check.sets, name)
    }

    fn span(&mut self, path: &str, raw: Option<&Span>, zero: Zero) -> Option<Duration> {
        let span = humantime::parse_duration(&raw?.0).ok()?;
        if span.is_zero() && zero == Zero::Refused {
            self.wrong(path, "a duration of zero makes no sense here", "write a longer one, as \"1s\"");
            return None;
        }
        Some(span)
    }

    fn positive(&mut self, path: &str, number: Option<f64>) -> Option<f64> {
        let number = number?;
        if number <= 0.0 {
            self.wrong(path, format!("{number} is not above zero"), "write a number above zero");
            return None;
        }
        Some(number)
    }
}

fn complete<T>(list: Vec<Option<T>>) -> Option<Vec<T>> {
    list.into_iter().collect()
}

/// The host of "host:port".
fn host_of(address: &str) -> Option<&str> {
    let (host, port) = address.rsplit_once(':')?;
    port.parse::<u16>().ok()?;
    (!host.is_empty()).then_some(host)
}

fn is_loopback(host: &str) -> bool {
    let bare = host.trim_start_matches('[').trim_end_matches(']');
    bare == "localhost" || bare.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// A duration as the profile would write it.
fn shown(span: Duration) -> String {
    humantime::format_duration(span).to_string()
}

fn get<T>(list: &[Option<T>], index: usize) -> Option<&T> {
    list.get(index).and_then(Option::as_ref)
}

/// The line of a device.
fn bus_of<'a>(device: &Device, buses: &'a [Option<Bus>]) -> Option<&'a Bus> {
    get(buses, device.bus.0)
}

type Signals = [Option<Signal>];

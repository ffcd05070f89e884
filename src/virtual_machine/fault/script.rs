//! Fault script in TOML, and its check against a profile.

use std::time::Duration;

use serde::{Deserialize, Deserializer, de::Error as _};

use super::{
    AcknowledgeFault, BusError, CanFault, Fault, FaultDuration, FaultScript, Kind, NodeFault, Reads,
    ReplyFault,
};
use isotherm_core::codec::{CanId, DataType, Register};
use isotherm_core::reading::{SignalId, Status};
use isotherm_profile::{Device, DeviceId, Profile, Signal, Transport};

/// Error of a fault script, as text. Errors of the TOML parser include line and column.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FaultError(String);

/// Kinds of lines on which a kind of fault is possible.
#[derive(Clone, Copy, PartialEq)]
enum Lines {
    Any,
    /// Lines with Modbus devices, or with devices that send text.
    Modbus,
    /// All lines except CAN lines: Modbus, devices that send text, and OPC UA servers.
    Connected,
    Can,
    /// OPC UA servers.
    Nodes,
}
use Lines::{Any, Can, Connected, Modbus, Nodes};

impl Lines {
    /// Returns the kind of the line of a device.
    fn of(profile: &Profile, device: &Device) -> Lines {
        match device.can {
            Some(_) => Can,
            None if profile.bus(device.bus).opcua.is_some() => Nodes,
            None => Modbus,
        }
    }

    /// Returns whether these kinds of lines include the kind `line`.
    fn include(self, line: Lines) -> bool {
        match self {
            Any => true,
            Connected => line != Can,
            own => own == line,
        }
    }
}

/// Function that creates a fault of one kind, from the keys of this kind in the script.
type Make = fn(&mut FaultFile, &Profile) -> Result<Kind, String>;

/// All kinds of faults: name in a script, possible lines, and function that makes the fault.
const KINDS: [(&str, Lines, Make); 37] = [
    ("silent", Any, |_, _| reply(ReplyFault::Silent)),
    ("late", Any, |file, _| reply(ReplyFault::Late(file.delay()?))),
    ("exception", Modbus, |file, _| file.exception()),
    ("close", Connected, |_, _| reply(ReplyFault::Close)),
    ("half-open", Connected, |_, _| reply(ReplyFault::HalfOpen)),
    ("refuse", Connected, |_, _| Ok(Kind::Refuse)),
    ("garbage", Any, |_, _| reply(ReplyFault::Garbage)),
    ("wrong-unit", Modbus, |_, _| reply(ReplyFault::WrongUnit)),
    ("wrong-transaction", Modbus, |_, _| reply(ReplyFault::WrongTransaction)),
    ("wrong-checksum", Modbus, |_, _| reply(ReplyFault::WrongChecksum)),
    ("one-byte-at-a-time", Modbus, |_, _| reply(ReplyFault::OneByteAtATime)),
    ("wrong-function", Modbus, |_, _| reply(ReplyFault::WrongFunction)),
    ("short-read", Modbus, |_, _| reply(ReplyFault::ShortRead)),
    ("long-read", Modbus, |_, _| reply(ReplyFault::LongRead)),
    ("wrong-echo", Modbus, |_, _| reply(ReplyFault::WrongEcho)),
    ("ignored-write", Any, |_, _| reply(ReplyFault::IgnoredWrite)),
    ("one-behind", Modbus, |_, _| reply(ReplyFault::OneBehind { stale_transaction: false })),
    ("one-behind-stale", Modbus, |_, _| reply(ReplyFault::OneBehind { stale_transaction: true })),
    ("shift", Modbus, |file, _| {
        file.given_up().map(|(delay, code)| Kind::Reply(ReplyFault::Shift { delay, code }))
    }),
    ("keep", Modbus, |file, _| {
        file.given_up().map(|(delay, code)| Kind::Reply(ReplyFault::Keep { delay, code }))
    }),
    ("sentinel", Any, FaultFile::broken_signal),
    ("nan", Any, FaultFile::broken_signal),
    ("value", Any, FaultFile::broken_signal),
    ("register", Modbus, |file, _| file.register()),
    ("restart", Any, |_, _| Ok(Kind::Restart)),
    ("no-acknowledge", Connected, |_, _| Ok(Kind::Acknowledge(AcknowledgeFault::Never))),
    ("stuck-acknowledge", Connected, |_, _| Ok(Kind::Acknowledge(AcknowledgeFault::Stuck))),
    ("next-number", Modbus, |_, _| Ok(Kind::Acknowledge(AcknowledgeFault::NextNumber))),
    ("late-acknowledge", Connected, |file, _| Ok(Kind::Acknowledge(AcknowledgeFault::Late(file.delay()?)))),
    ("short-frame", Can, |_, _| Ok(Kind::Can(CanFault::ShortFrame))),
    ("babbling", Can, |file, _| file.babbling()),
    ("emergency", Can, |file, _| file.emergency()),
    ("error-frame", Can, |file, _| file.error_frame()),
    ("sdo-abort", Can, |file, _| Ok(Kind::Can(CanFault::Refusal(file.code.take().unwrap_or(0x0800_0000))))),
    ("wrong-index", Can, |_, _| Ok(Kind::Can(CanFault::WrongIndex))),
    ("status", Nodes, FaultFile::status),
    ("text", Nodes, |file, profile| {
        Ok(Kind::Node { signal: file.own_signal(profile)?, fault: NodeFault::Text })
    }),
];

fn reply(fault: ReplyFault) -> Result<Kind, String> {
    Ok(Kind::Reply(fault))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ScriptFile {
    #[serde(default)]
    fault: Vec<FaultFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FaultFile {
    device: String,
    kind: String,
    #[serde(default, deserialize_with = "duration")]
    at: Option<Duration>,
    after: Option<u64>,
    #[serde(rename = "for")]
    replies: Option<u64>,
    #[serde(default, deserialize_with = "duration")]
    for_time: Option<Duration>,
    #[serde(default, deserialize_with = "duration")]
    delay: Option<Duration>,
    code: Option<u32>,
    id: Option<u32>,
    #[serde(default, deserialize_with = "duration")]
    every: Option<Duration>,
    error: Option<String>,
    signal: Option<String>,
    raw: Option<i64>,
    value: Option<f64>,
    register: Option<String>,
    words: Option<Vec<u16>>,
}

impl FaultScript {
    /// Parses a fault script, and checks it against the profile of the virtual machine.
    ///
    /// # Errors
    /// A message of the TOML parser with line and column; or all faults that contradict the profile, one on each line.
    pub fn parse(text: &str, profile: &Profile) -> Result<FaultScript, FaultError> {
        let file: ScriptFile = toml::from_str(text).map_err(|error| FaultError(error.to_string()))?;
        let (mut faults, mut errors) = (Vec::new(), Vec::new());
        for (place, fault) in file.fault.into_iter().enumerate() {
            let kind = fault.kind.clone();
            match fault.resolve(profile) {
                Ok(fault) => faults.push(fault),
                Err(error) => errors.push(format!("fault {} ({kind}): {error}", place + 1)),
            }
        }
        if errors.is_empty() { Ok(FaultScript { faults }) } else { Err(FaultError(errors.join("\n"))) }
    }
}

impl FaultFile {
    fn resolve(mut self, profile: &Profile) -> Result<Fault, String> {
        let device =
            profile.devices.iter().position(|device| device.name == self.device).ok_or_else(|| {
                let names = profile.devices.iter().map(|device| device.name.as_str());
                format!("there is no device `{}`; allowed: {}", self.device, list(names))
            })?;
        let Some((_, on, make)) = KINDS.iter().find(|(name, ..)| *name == self.kind) else {
            let all = list(KINDS.iter().map(|(name, ..)| *name));
            return Err(format!("there is no such kind; allowed: {all}"));
        };
        let line = Lines::of(profile, &profile.devices[device]);
        if !on.include(line) {
            let possible = KINDS.iter().filter(|(_, on, _)| on.include(line));
            let possible = list(possible.map(|(name, ..)| *name));
            return Err(match (line, on) {
                (Can, _) => format!("not possible on a CAN line; allowed: {possible}"),
                (Nodes, _) => format!(
                    "not possible on an OPC UA server, which has no registers, exceptions and frames; allowed: \
                     {possible}"
                ),
                (_, Nodes) => format!("`{}` is not an OPC UA server", self.device),
                _ => format!("`{}` is not a device on a CAN line", self.device),
            });
        }
        let kind = make(&mut self, profile)?;
        self.no_key_is_left()?;
        let is_tcp = profile.bus(profile.devices[device].bus).transport == Transport::Tcp;
        match kind {
            Kind::Reply(ReplyFault::WrongTransaction | ReplyFault::OneBehind { stale_transaction: true })
                if !is_tcp =>
            {
                return Err("an RTU line has no transactions: choose another kind of fault".to_owned());
            }
            Kind::Reply(ReplyFault::Shift { .. } | ReplyFault::Keep { .. }) if !is_tcp => {
                return Err(
                    "an RTU line has no gateway that numbers transactions: choose another kind of fault"
                        .to_owned(),
                );
            }
            Kind::Reply(ReplyFault::WrongChecksum) if is_tcp => {
                return Err("Modbus TCP has no checksum of its own: choose another kind of fault".to_owned());
            }
            _ => {}
        }
        let lasts = match (self.replies, self.for_time) {
            (Some(_), Some(_)) => return Err("give `for` (replies) or `for_time`, not both".to_owned()),
            (Some(0), None) => return Err("`for` must be 1 or more".to_owned()),
            (Some(count), None) => FaultDuration::Replies(count),
            (None, Some(span)) => FaultDuration::Time(span),
            (None, None) => FaultDuration::Ever,
        };
        match kind {
            Kind::Refuse if self.replies.is_some() => {
                return Err(
                    "a closed listener gives no replies, so `for` cannot count them: write `for_time`"
                        .to_owned(),
                );
            }
            Kind::Can(CanFault::Emergency(_)) if self.replies.is_some() => {
                return Err(
                    "an emergency is sent once, so `for` cannot count replies: write `for_time`".to_owned()
                );
            }
            Kind::Can(CanFault::Babbling { every, .. } | CanFault::Errors { every: Some(every), .. })
                if every < Duration::from_micros(100) =>
            {
                return Err("`every` must be at least 100 µs: no bus is faster".to_owned());
            }
            Kind::Can(CanFault::Errors { every: None, .. }) if lasts != FaultDuration::Ever => {
                return Err(
                    "this fault happens once: write `every`, or remove `for` and `for_time`".to_owned()
                );
            }
            Kind::Acknowledge(_) if self.replies.is_some() => {
                return Err(
                    "an acknowledge signal is not a reply, so `for` cannot count it: write `for_time`"
                        .to_owned(),
                );
            }
            Kind::Acknowledge(_) if !answers_strobes(profile, DeviceId(device)) => {
                return Err(format!("no output or set of `{}` has a handshake", self.device));
            }
            Kind::Register { .. } | Kind::Restart if lasts != FaultDuration::Ever => {
                return Err("this fault happens once: remove `for` and `for_time`".to_owned());
            }
            _ => {}
        }
        let (at, after) = (self.at.unwrap_or_default(), self.after.unwrap_or_default());
        Ok(Fault { device: DeviceId(device), at, after, lasts, kind })
    }

    fn exception(&mut self) -> Result<Kind, String> {
        let code = self.code.take().ok_or("`code` is missing, for example 4")?;
        reply(ReplyFault::Exception(u8::try_from(code).map_err(|_| "`code` must be at most 255")?))
    }

    /// Returns the delay of the unit's answer, and the exception code that the Modbus gateway sends earlier, at its
    /// timeout. `None`: the Modbus gateway does not answer.
    fn given_up(&mut self) -> Result<(Duration, Option<u8>), String> {
        let code =
            self.code.take().map(u8::try_from).transpose().map_err(|_| "`code` must be at most 255")?;
        Ok((self.delay()?, code))
    }

    fn babbling(&mut self) -> Result<Kind, String> {
        let raw = self.id.take().unwrap_or(CanId::LARGEST_STANDARD);
        let id = CanId::standard(raw).or_else(|| CanId::extended(raw));
        let id = id.ok_or("`id` must be at most 0x1FFFFFFF")?;
        let every = self.every.take().unwrap_or(Duration::from_millis(1));
        Ok(Kind::Can(CanFault::Babbling { id, every }))
    }

    fn emergency(&mut self) -> Result<Kind, String> {
        let code = self.code.take().ok_or("`code` is missing, for example 0x5030")?;
        let code = u16::try_from(code).ok().filter(|code| *code > 0);
        Ok(Kind::Can(CanFault::Emergency(code.ok_or("`code` must be from 1 to 0xFFFF")?)))
    }

    fn error_frame(&mut self) -> Result<Kind, String> {
        let known = || list(BusError::ALL.iter().map(|(name, _)| *name));
        let error = self.error.take().ok_or_else(|| format!("`error` is missing, one of {}", known()))?;
        let error = BusError::named(&error).ok_or_else(|| format!("`error` is one of {}", known()))?;
        Ok(Kind::Can(CanFault::Errors { error, every: self.every.take() }))
    }

    fn delay(&mut self) -> Result<Duration, String> {
        self.delay.take().ok_or_else(|| "`delay` is missing, for example \"400ms\"".to_owned())
    }

    fn register(&mut self) -> Result<Kind, String> {
        let register = self.register.take().ok_or("`register` is missing, for example \"holding:104\"")?;
        let words = self.words.take().ok_or("`words` is missing, for example [0, 5]")?;
        let address: Register = register.parse()?;
        if words.is_empty() || usize::from(address.offset) + words.len() > 65536 {
            return Err(format!(
                "{} words from {address} on exceed the last address: write fewer words",
                words.len()
            ));
        }
        if address.table.is_bits() && words.iter().any(|word| *word > 1) {
            return Err("`words`: a bit is 0 or 1".to_owned());
        }
        Ok(Kind::Register { address, words })
    }

    /// Makes the fault in which an OPC UA node has a bad status. The key `signal` names the signal of this node.
    /// Without this key, every node of a call has the bad status.
    fn status(&mut self, profile: &Profile) -> Result<Kind, String> {
        let status = self.code.take().map_or(Status::SENSOR_FAILURE, Status);
        if status.is_good() {
            return Err("`code` must be a status that is not good, for example 0x808C0000".to_owned());
        }
        if self.signal.is_none() {
            return reply(ReplyFault::Status(status));
        }
        Ok(Kind::Node { signal: self.own_signal(profile)?, fault: NodeFault::Status(status) })
    }

    /// Reads the key `signal`, which must name a signal of the device.
    fn own_signal(&mut self, profile: &Profile) -> Result<SignalId, String> {
        let name = self.signal.take().ok_or("`signal` is missing")?;
        let is_its = |signal: &Signal| profile.device(signal.device).name == self.device;
        let mut of_device = profile.signals.iter().enumerate().filter(|(_, signal)| is_its(signal));
        let found = of_device.clone().find(|(_, signal)| signal.name == name);
        let (place, _) = found.ok_or_else(|| {
            let names = list(of_device.by_ref().map(|(_, signal)| signal.name.as_str()));
            format!("device `{}` has no signal `{name}`; allowed: {names}", self.device)
        })?;
        Ok(SignalId(place))
    }

    fn broken_signal(&mut self, profile: &Profile) -> Result<Kind, String> {
        let id = self.own_signal(profile)?;
        let signal = profile.signal(id);
        let name = &signal.name;
        let reads = match self.kind.as_str() {
            "nan" if !matches!(signal.encoding.data_type, DataType::F32 | DataType::F64) => {
                return Err(format!(
                    "`{name}` is {}: only f32 and f64 have NaN",
                    signal.encoding.data_type.name()
                ));
            }
            "nan" => Reads::Nan,
            "value" => {
                let value = self.value.take().filter(|value| value.is_finite());
                Reads::Value(value.ok_or("`value` is missing or not a finite number")?)
            }
            _ => {
                let raw = self.raw.take().or_else(|| signal.encoding.bad.first().map(|bad| bad.raw));
                Reads::Raw(raw.ok_or_else(|| format!("`raw` is missing, and `{name}` has no `bad` value"))?)
            }
        };
        Ok(Kind::Signal { signal: id, reads })
    }

    /// Rejects keys that are set but have no effect for this kind of fault.
    fn no_key_is_left(&self) -> Result<(), String> {
        let left = [
            ("delay", self.delay.is_some()),
            ("code", self.code.is_some()),
            ("signal", self.signal.is_some()),
            ("raw", self.raw.is_some()),
            ("value", self.value.is_some()),
            ("register", self.register.is_some()),
            ("words", self.words.is_some()),
            ("id", self.id.is_some()),
            ("every", self.every.is_some()),
            ("error", self.error.is_some()),
        ];
        match left.into_iter().find(|(_, is_left)| *is_left) {
            Some((key, _)) => Err(format!("`{key}` has no effect for this kind of fault")),
            None => Ok(()),
        }
    }
}

fn answers_strobes(profile: &Profile, device: DeviceId) -> bool {
    profile.sets.iter().any(|set| set.device == device && set.handshake.is_some())
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

fn duration<'de, D: Deserializer<'de>>(input: D) -> Result<Option<Duration>, D::Error> {
    let text = String::deserialize(input)?;
    humantime::parse_duration(&text).map(Some).map_err(D::Error::custom)
}

//! What a line is made of, and how much of its time the polls take.

use std::fmt;
use std::time::Duration;

use serde::Serialize;

use super::{BusExplained, TlsExplained, load};
use crate::plan::plan;
use crate::{BusId, Profile, Serial, Transport};
use isotherm_core::reading::SignalId;

/// A serial port's settings, and what its polls need of its time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SerialExplained {
    /// `9600 baud 8N1`.
    pub settings: String,
    /// Milliseconds that one character takes.
    pub character_ms: f64,
    /// Milliseconds of silence before each request.
    pub silence_ms: f64,
    /// Milliseconds that each unit's polls take on the line, without the time its device needs to answer.
    pub polls: Vec<PollTime>,
    /// The part of the line's time that the polls take, in percent.
    pub load_percent: f64,
}

/// What one device's poll takes of the line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PollTime {
    /// Whose.
    pub device: String,
    /// Bytes of requests and answers.
    pub bytes: usize,
    /// Milliseconds they take, with the silences.
    pub takes_ms: f64,
    /// Its period, milliseconds.
    pub every_ms: f64,
}

pub(super) fn bus(profile: &Profile, id: BusId) -> BusExplained {
    let bus = profile.bus(id);
    let (kind, serial) = match bus.transport {
        Transport::Tcp if bus.tls.is_some() => ("Modbus TCP inside TLS (Modbus/TCP Security)", None),
        Transport::Tcp => ("Modbus TCP", None),
        Transport::RtuOverTcp => ("RTU over TCP", None),
        Transport::Can => ("CAN", None),
        Transport::Serial(serial) => ("Modbus RTU", Some(explained(profile, id, serial))),
    };
    BusExplained {
        name: bus.name.clone(),
        kind,
        address: bus.address.clone(),
        tls: bus.tls.as_ref().map(|tls| TlsExplained {
            name: tls.name.clone(),
            trusts: tls.ca.name.clone(),
            shows: tls.cert.name.clone(),
        }),
        timeout: humantime::format_duration(bus.timeout).to_string(),
        late: humantime::format_duration(bus.late).to_string(),
        serial,
        load: load::of(profile, id),
        can: (bus.transport == Transport::Can).then(|| super::can::line(profile, id)),
    }
}

fn explained(profile: &Profile, id: BusId, serial: Serial) -> SerialExplained {
    let here = profile.devices.iter().enumerate().filter(|(_, device)| device.bus == id);
    let polls: Vec<PollTime> = here
        .filter_map(|(place, device)| {
            let signals = profile.signals.iter().enumerate();
            let signals = signals.filter(|(_, signal)| signal.device.0 == place);
            let requests = plan(device, signals.map(|(index, signal)| (SignalId(index), signal)));
            let frames = requests.iter().map(load::read_frames).collect::<Vec<_>>();
            let spans = frames.iter().map(|(question, answer)| {
                serial.exchange(*question, *answer) + device.quirks.pause_between_requests
            });
            (!frames.is_empty()).then(|| PollTime {
                device: device.name.clone(),
                bytes: frames.iter().map(|(question, answer)| question + answer).sum(),
                takes_ms: ms(spans.sum()),
                every_ms: ms(device.every),
            })
        })
        .collect();
    SerialExplained {
        settings: serial.to_string(),
        character_ms: ms(serial.character()),
        silence_ms: ms(serial.silence()),
        load_percent: 100.0 * polls.iter().map(|poll| poll.takes_ms / poll.every_ms).sum::<f64>(),
        polls,
    }
}

fn ms(span: Duration) -> f64 {
    1000.0 * span.as_secs_f64()
}

impl fmt::Display for SerialExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "  {}: {:.2} ms a character, {:.2} ms silence before a request",
            self.settings, self.character_ms, self.silence_ms
        )?;
        for poll in &self.polls {
            writeln!(
                f,
                "  {}: {} bytes take {:.0} ms of every {:.0} ms",
                poll.device, poll.bytes, poll.takes_ms, poll.every_ms
            )?;
        }
        writeln!(
            f,
            "  polls take {:.0} % of the line; writes and the devices' own time to answer come on top",
            self.load_percent
        )
    }
}

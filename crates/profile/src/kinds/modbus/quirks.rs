//! `quirks` of a bus or a device: how the gateway must treat devices that need special care.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::duration::Timespan;
use crate::tables::bus::transport::Transport;

/// Description, for messages, of the lines on which the quirk `gateway` is allowed.
pub(crate) const OF_TCP: &str = "a modbus-tcp line";
/// Hint if the quirk `gateway` is set on a line with RTU frames.
pub(crate) const WAITS: &str =
    "remove this key: on a line with RTU frames the gateway always waits for late answers";

/// Special requirements of a device.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Quirks")]
pub(crate) struct RawQuirks {
    /// Pause after connecting. Default "0s".
    pause_after_connect: Option<Timespan>,
    /// Pause between two requests. Default "0s".
    pause_between_requests: Option<Timespan>,
    /// Whether each value is read with its own request. Default false.
    one_request_per_field: Option<bool>,
    /// Largest number of registers in one read. Default 125.
    #[schemars(range(min = 1, max = 125))]
    max_registers_per_request: Option<u16>,
    /// Largest number of unused registers between two signals that are read with one request. 0 for a device that
    /// rejects requests with unused registers. Default 8.
    #[schemars(range(max = 124))]
    max_gap: Option<u16>,
    /// Whether the connection is closed after each answer, for a device that accepts only one client at a time. Default
    /// false.
    close_after_each: Option<bool>,
    /// Whether the device loses the first request of each connection. The gateway then sends a read after connecting,
    /// and ignores whether it is answered. Default false.
    loses_first_request: Option<bool>,
    /// Whether the device is behind a Modbus gateway from TCP to a serial line. If an answer is missing, the next
    /// request then waits until a late answer can no longer arrive. Default: true if two or more units share the
    /// modbus-tcp bus.
    gateway: Option<bool>,
}

/// Special requirements of a device. The fields have the same names as in Telegraf.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quirks {
    /// Pause after connecting, before the first request.
    pub pause_after_connect: Duration,
    /// Pause between an answer and the next request.
    pub pause_between_requests: Duration,
    /// Whether each value is read with its own request.
    pub one_request_per_field: bool,
    /// Largest number of registers in one read, 1 to 125.
    pub max_registers_per_request: u16,
    /// Largest number of unused registers between two signals that are read with one request.
    pub max_gap: u16,
    /// Whether the connection is closed after each answer.
    pub close_after_each: bool,
    /// Whether the device loses the first request of each connection.
    pub loses_first_request: bool,
    /// Whether a Modbus gateway to a serial line is in front of the device.
    pub gateway: Gateway,
}

/// Whether a device on a Modbus TCP line is behind a Modbus gateway to a serial line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gateway {
    /// The profile does not state whether there is a Modbus gateway. It is assumed if two or more units share the line.
    #[default]
    ByUnits,
    /// The device is behind a Modbus gateway.
    Present,
    /// The device is not behind a Modbus gateway.
    Absent,
}

impl Gateway {
    /// Returns whether a device is behind a Modbus gateway. `units` are the unit numbers of all devices on its line.
    pub fn is_present(self, transport: Transport, mut units: impl Iterator<Item = u8>) -> bool {
        if transport != Transport::Tcp {
            return false;
        }
        match self {
            Gateway::ByUnits => units.next().is_some_and(|first| units.any(|unit| unit != first)),
            Gateway::Present => true,
            Gateway::Absent => false,
        }
    }
}

impl Default for Quirks {
    fn default() -> Quirks {
        Quirks {
            pause_after_connect: Duration::ZERO,
            pause_between_requests: Duration::ZERO,
            one_request_per_field: false,
            max_registers_per_request: 125,
            max_gap: 8,
            close_after_each: false,
            loses_first_request: false,
            gateway: Gateway::ByUnits,
        }
    }
}

impl Quirks {
    /// Returns whether two requests may wait for their answers at the same time. This is not possible with a pause
    /// between requests, or with a new connection for each request.
    pub const fn support_two(self) -> bool {
        self.pause_between_requests.is_zero() && !self.close_after_each
    }
}

impl RawQuirks {
    /// Returns the quirks of this table. A quirk that the table does not set has the value from `below`.
    pub(crate) fn over(&self, below: Quirks) -> Quirks {
        let span = |raw: Option<Timespan>, below| raw.map_or(below, |Timespan(span)| span);
        let most = self.max_registers_per_request;
        let gateway = self.gateway.map(|is_there| if is_there { Gateway::Present } else { Gateway::Absent });
        Quirks {
            pause_after_connect: span(self.pause_after_connect, below.pause_after_connect),
            pause_between_requests: span(self.pause_between_requests, below.pause_between_requests),
            one_request_per_field: self.one_request_per_field.unwrap_or(below.one_request_per_field),
            max_registers_per_request: most.unwrap_or(below.max_registers_per_request),
            max_gap: self.max_gap.unwrap_or(below.max_gap),
            close_after_each: self.close_after_each.unwrap_or(below.close_after_each),
            loses_first_request: self.loses_first_request.unwrap_or(below.loses_first_request),
            gateway: gateway.unwrap_or(below.gateway),
        }
    }
}

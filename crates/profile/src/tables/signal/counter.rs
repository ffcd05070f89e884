//! `counter` of a signal whose value is the count of a linear scale or an encoder. After the highest count,
//! such a counter continues with the lowest count (rollover). The keys state the largest speed of the axis,
//! and the command that captures the count.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

use crate::duration::shown;
use crate::tables::KeyContext;
use crate::tables::device::Device;
use crate::tables::register::register;
use isotherm_core::codec::{Counter, Encoding, Register, Table};

/// Counter of a scale or an encoder.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Counter")]
pub(super) struct RawCounter {
    /// Largest speed of the axis, units per second. A faster change does not count as motion: the counter
    /// then has a new reference (zero position).
    #[schemars(required)]
    max_speed: Option<f64>,
    /// Command that is written before each read, for a counter that copies its count into registers only on command.
    capture: Option<RawCapture>,
}

/// Command that captures a count.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Capture")]
struct RawCapture {
    /// Coil or holding register of the same device, for example "holding:132".
    #[schemars(required)]
    register: Option<String>,
    /// Value that is written. Default 1.
    value: Option<u16>,
}

/// Command after which a counter copies its count into its registers. The gateway writes the command before each read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capture {
    /// Coil or holding register of the same device.
    pub address: Register,
    /// Value that is written. For a coil, 0 means off, and any other value on.
    pub value: u16,
}

impl RawCounter {
    /// Resolves the counter of a signal, and the command that captures its count. `every` is the poll period.
    /// Each result is `None` if it is missing or invalid. Errors are reported.
    pub(super) fn resolve(
        &self,
        at: &KeyContext<'_>,
        encoding: &Encoding,
        device: Option<&Device>,
        every: Duration,
        has_max_rate: bool,
    ) -> (Option<Counter>, Option<Capture>) {
        let capture = self.capture.as_ref().and_then(|raw| raw.resolve(&at.key("capture"), device));
        if Counter::modulus(encoding.data_type).is_none() {
            let help = "remove `counter`, or use a type that rolls over: u16, i16, u24, i24, u32, i32, or 8 \
                        to 32 bits of a frame or registers";
            at.wrong_key(format!("type {} cannot be a counter", encoding.data_type.name()), help);
        }
        if has_max_rate {
            let help = "remove `max_rate` and keep `max_speed`: a step faster than `max_speed` sets a new \
                        reference, and does not cause a lasting fault";
            at.wrong_key("`max_rate` and `counter.max_speed` both limit the rate of change", help);
        }
        let Some(max_speed) = at.key("max_speed").positive(self.max_speed) else { return (None, capture) };
        let counter = Counter { max_speed, slack: every };
        if let Some(half) = counter.half_way(encoding).filter(|half| *half <= every * 2) {
            let message = format!(
                "at {max_speed} per second the counter passes half of its range in {}, but the counter is \
                 read only every {}",
                shown(half),
                shown(every)
            );
            let help = "read the counter at least twice in that time, or use its 32-bit registers";
            at.key("max_speed").invalid(message, help);
        }
        (Some(counter), capture)
    }
}

impl RawCapture {
    fn resolve(&self, at: &KeyContext<'_>, device: Option<&Device>) -> Option<Capture> {
        let at = at.key("register");
        let address = register(&at, self.register.as_ref())?;
        if let Some(device) = device {
            match address.table {
                Table::Coil if !device.functions.write_coil => {
                    device.lacks(&at, "this command needs the function write-coil", "\"write-coil\"");
                }
                Table::Holding if device.functions.writes(1).is_none() => {
                    device.lacks(&at, "this command needs the function write-single", "\"write-single\"");
                }
                Table::Coil | Table::Holding => {}
                Table::Input | Table::Discrete => {
                    at.invalid(format!("{address} is read-only"), "write \"holding:132\" or \"coil:3\"");
                }
            }
        }
        Some(Capture { address, value: self.value.unwrap_or(1) })
    }
}

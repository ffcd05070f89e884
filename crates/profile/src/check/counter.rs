//! Signals that count.

use std::time::Duration;

use super::{Check, shown};
use crate::place::child;
use crate::raw::{RawCapture, RawSignal};
use crate::{Capture, Device};
use isotherm_core::codec::{Counter, Encoding, Table};

impl Check<'_> {
    pub(super) fn counter(
        &mut self,
        path: &str,
        raw: &RawSignal,
        encoding: &Encoding,
        device: Option<&Device>,
        every: Duration,
    ) -> (Option<Counter>, Option<Capture>) {
        let Some(given) = &raw.counter else { return (None, None) };
        let path = &child(path, "counter");
        let capture =
            given.capture.as_ref().and_then(|raw| self.capture(&child(path, "capture"), raw, device));
        if Counter::modulus(encoding.data_type).is_none() {
            let message = format!("{} is no counter", encoding.data_type.name());
            self.wrong_key(
                path,
                message,
                "allowed: u16, i16, u32, i32, and 8 to 32 bits of a frame, which roll over; remove `counter`",
            );
        }
        if raw.max_rate.is_some() {
            let help = "keep `max_speed`: beyond it a step is a new reference, and no fault for ever";
            self.wrong_key(path, "`max_rate` and `counter.max_speed` both say how fast it may change", help);
        }
        let Some(max_speed) = self.positive(&child(path, "max_speed"), given.max_speed) else {
            return (None, capture);
        };
        let counter = Counter { max_speed, slack: every };
        if let Some(half) = counter.half_way(encoding).filter(|half| *half <= every * 2) {
            let message = format!(
                "at {max_speed} per second the counter is half way round after {}, and it is read every {}",
                shown(half),
                shown(every)
            );
            let help = "read it at least twice in that time, or take the counter's 32-bit registers";
            self.wrong(&child(path, "max_speed"), message, help);
        }
        (Some(counter), capture)
    }

    fn capture(&mut self, path: &str, raw: &RawCapture, device: Option<&Device>) -> Option<Capture> {
        let register = raw.register.as_ref()?;
        let path = child(path, "register");
        let address = self.address(&path, register)?;
        let writable = |device: &Device| match address.table {
            Table::Coil => Some(device.functions.write_coil),
            Table::Holding => Some(device.functions.writes(1).is_some()),
            Table::Input | Table::Discrete => None,
        };
        match device.map_or(Some(true), writable) {
            None => {
                self.wrong(&path, format!("{address} is read-only"), "write \"holding:132\" or \"coil:3\"")
            }
            Some(false) => {
                let name = device.map_or("", |device| &device.name);
                let function = if address.table.is_bits() { "write-coil" } else { "write-single" };
                let message = format!("this command needs {function}, which `{name}` may not be sent");
                let help =
                    format!("add \"{function}\" to `functions` of the device, if the device can do it");
                self.wrong(&path, message, help);
            }
            Some(true) => {}
        }
        Some(Capture { address, value: raw.value.unwrap_or(1) })
    }
}

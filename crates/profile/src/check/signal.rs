//! Signals, and the registers and encodings that they share with outputs.

use std::time::Duration;

use super::can::Located;
use super::{Check, Zero, bus_of, get, shown};
use crate::place::{child, element};
use crate::raw::{BadValue, RawSentinel, RawSignal, TypeWord, WordOrderWord};
use crate::{Bus, Device, DeviceId, Flag, Signal, Unit};
use isotherm_core::codec::{DataType, Encoding, Register, Scale, Sentinel, Table, WordOrder};
use isotherm_core::reading::Reason;

impl Check<'_> {
    pub(super) fn signals(
        &mut self,
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) -> Vec<Option<Signal>> {
        let raw = self.raw;
        let each = self.signals.each();
        let one = |(_, name, path): (usize, String, String)| {
            self.one_signal(&path, &name, raw.signal.get(&name)?, devices, buses)
        };
        each.into_iter().map(one).collect()
    }

    fn one_signal(
        &mut self,
        path: &str,
        name: &str,
        raw: &RawSignal,
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) -> Option<Signal> {
        let index = raw.device.as_ref().and_then(|device| self.device_index(&child(path, "device"), device));
        let device = index.and_then(|index| get(devices, index));
        self.one_place(path, raw);
        self.signal_keys(path, raw);
        let max_age = self.max_age(path, raw, device, buses);
        let range = self.range(&child(path, "range"), raw.range);
        let max_rate = self.positive(&child(path, "max_rate"), raw.max_rate);
        let fault_when = raw
            .fault_when
            .as_ref()
            .and_then(|text| self.condition(&child(path, "fault_when"), text, Some(name)));
        // A channel that brought no place has been told.
        let on_can = raw.device.as_ref().and_then(|device| self.is_on_can(device)) == Some(true);
        let is_nowhere = raw.register.is_none() && !(on_can && has_place(raw));
        if is_nowhere && self.places.contains(&child(path, "channel")) {
            return None;
        }
        let unit_of = |located: Option<Unit>| match raw.unit.as_deref() {
            Some(unit) => Unit::named(unit),
            None => Some(located.unwrap_or(Unit("1"))),
        };
        if on_can {
            let Located { address, data_type, scale, offset, unit } = self.located(path, raw)?;
            let bad = self.bad(&child(path, "bad"), raw);
            let scale = self.scale(&child(path, "scale"), scale)?;
            let encoding =
                Encoding { scale: Scale::of(scale), offset, bad, ..super::verify::plain(data_type) };
            self.sentinels(&child(path, "bad"), &encoding);
            let (counter, _) = self.counter(path, raw, &encoding, device, paces(raw, device, max_age));
            return Some(Signal {
                name: name.to_owned(),
                device: DeviceId(index?),
                address,
                encoding,
                unit: unit_of(unit)?,
                range,
                max_rate,
                max_age: max_age?,
                fault_when,
                merge: true,
                counter,
                capture: None,
            });
        }
        if raw.register.is_none() && has_place(raw) {
            return None;
        }
        let (address, bit) = match &raw.register {
            Some(register) => self.cell(&child(path, "register"), register),
            None => {
                let help =
                    "write a zero-based protocol address (\"input:0\") or a Modicon number (\"30001\")";
                self.missing(path, "register", "`register` is missing: where is the signal read?", help);
                (None, None)
            }
        };
        let data_type = self.signal_type(path, raw.kind, address, bit);
        let word_order = self.word_order(path, data_type, raw.word_order);
        let scale = self.scale(&child(path, "scale"), raw.scale.unwrap_or(1.0));
        let (address, data_type) = (address?, data_type?);
        self.fits(&child(path, "register"), address, data_type);
        if let Some(device) = device {
            self.readable(&child(path, "register"), address.table, device);
            self.in_one_request(&child(path, "type"), data_type, device);
        }
        let bits = matches!(data_type, DataType::Bool | DataType::Bit(_));
        let unit = unit_of(bits.then_some(Unit("bool")));
        let encoding = Encoding {
            data_type,
            word_order: word_order?,
            byte_swap: raw.byte_swap.unwrap_or(false),
            scale: Scale::of(scale?),
            offset: raw.offset.unwrap_or(0.0),
            bias: 0,
            bad: self.bad(&child(path, "bad"), raw),
        };
        self.sentinels(&child(path, "bad"), &encoding);
        let every = device.map_or(Duration::ZERO, |device| device.every);
        let (counter, capture) = self.counter(path, raw, &encoding, device, every);
        Some(Signal {
            name: name.to_owned(),
            device: DeviceId(index?),
            address: address.into(),
            encoding,
            unit: unit?,
            range,
            max_rate,
            max_age: max_age?,
            fault_when,
            merge: raw.merge.unwrap_or(true),
            counter,
            capture,
        })
    }

    fn one_place(&mut self, path: &str, raw: &RawSignal) {
        let places = [&raw.register, &raw.dbc, &raw.sdo].map(Option::is_some);
        let there = places.into_iter().chain([raw.pdo.is_some(), raw.frame.is_some()]);
        if there.filter(|there| *there).count() > 1 {
            let help = "keep one of register, channel, dbc, pdo, sdo, frame";
            self.wrong_key(path, "the signal is read from more than one place", help);
        }
    }

    /// The raw values that mean "no measurement", with what the device says by them.
    fn bad(&mut self, path: &str, raw: &RawSignal) -> Vec<Sentinel> {
        let mut sentinels = Vec::new();
        for (place, bad) in raw.bad.iter().flatten().enumerate() {
            match bad {
                BadValue::Number(raw) => sentinels.push(Sentinel::from(*raw)),
                BadValue::Named(RawSentinel { raw: Some(raw), means: Some(words) }) => {
                    let known = Reason::MEANINGS.iter().find(|(known, _)| known == words);
                    sentinels.extend(known.map(|(_, means)| Sentinel { raw: *raw, means: *means }));
                }
                BadValue::Named(RawSentinel { raw, .. }) => {
                    let key = if raw.is_none() { "raw" } else { "means" };
                    let help = "write the raw value, or both, as { raw = -512, means = \"open circuit\" }";
                    self.missing(&element(path, place), key, format!("`{key}` is missing"), help);
                }
            }
        }
        sentinels
    }

    fn max_age(
        &mut self,
        path: &str,
        raw: &RawSignal,
        device: Option<&Device>,
        buses: &[Option<Bus>],
    ) -> Option<Duration> {
        let path = child(path, "max_age");
        let given = self.span(&path, raw.max_age.as_ref(), Zero::Refused);
        let device = device?;
        let every = device.every;
        let Some(age) = given else {
            let timeout = bus_of(device, buses).map_or(Duration::ZERO, |bus| bus.timeout);
            return Some((5 * every).max(3 * timeout));
        };
        if Check::comes_by_itself(raw) {
            return Some(age);
        }
        let figures =
            format!("`max_age` is {}, `{}` is read every {}", shown(age), device.name, shown(every));
        let help = format!("allow at least two polls, \"{}\"", shown(2 * every));
        if age <= every {
            self.wrong(&path, format!("{figures}: the signal would always go stale"), help);
        } else if age < 2 * every {
            let message = format!("{figures}: one late answer makes the signal stale");
            self.warnings.push(self.places.at_value(&path, message, Some(help)));
        }
        Some(age)
    }

    fn range(&mut self, path: &str, range: Option<[f64; 2]>) -> Option<(f64, f64)> {
        let [low, high] = range?;
        if low >= high {
            let message = format!("the range {low} to {high} is empty");
            self.wrong(path, message, "write the smaller value first, as [-10.0, 80.0]");
        }
        Some((low, high))
    }

    fn signal_type(
        &mut self,
        path: &str,
        word: Option<TypeWord>,
        address: Option<Register>,
        bit: Option<u8>,
    ) -> Option<DataType> {
        let bits = address?.table.is_bits();
        if let Some(bit) = bit {
            if let Some(wrong) = word.map(DataType::from).filter(|word| *word != DataType::Bool) {
                let help = "one bit is \"bool\": leave `type` out";
                self.wrong(&child(path, "type"), format!("{} does not fit one bit", wrong.name()), help);
            }
            return Some(DataType::Bit(bit));
        }
        match (word.map(DataType::from), bits) {
            (None | Some(DataType::Bool), true) => Some(DataType::Bool),
            (Some(wrong), true) => {
                let message = format!("{} does not fit one bit", wrong.name());
                self.wrong(
                    &child(path, "type"),
                    message,
                    "a coil and a discrete input are \"bool\": leave `type` out",
                );
                None
            }
            (Some(word), false) => Some(word),
            (None, false) => {
                let help =
                    "allowed: bool, u16, i16, u32, i32, u64, i64, f32, f64; the device's manual says which";
                self.missing(
                    path,
                    "type",
                    "`type` is missing: how does the value lie in its registers?",
                    help,
                );
                None
            }
        }
    }

    /// A register, or one bit of it.
    pub(super) fn cell(&mut self, path: &str, text: &str) -> (Option<Register>, Option<u8>) {
        let is_plain = !text.contains('.');
        match text.parse::<Flag>() {
            Ok(flag) => (Some(flag.address), flag.bit),
            Err(_) if is_plain => (self.address(path, text), None),
            Err(message) => {
                self.wrong(
                    path,
                    message,
                    "write a register as \"input:50\", or one bit of it as \"input:50.3\"",
                );
                (None, None)
            }
        }
    }

    pub(super) fn address(&mut self, path: &str, text: &str) -> Option<Register> {
        match text.parse() {
            Ok(address) => Some(address),
            Err(why) => {
                let (table, _) = text.split_once(':').unwrap_or_default();
                let near = crate::error::nearest(table, &["coil", "discrete", "input", "holding"]);
                let near = near.filter(|near| *near != table && !table.is_empty());
                let (message, help) = match why.split_once("; ") {
                    Some((message, help)) => (message.to_owned(), help.to_owned()),
                    None => (why.clone(), "write \"input:0\" or \"30001\"".to_owned()),
                };
                let help = near.map(|near| format!("did you mean `{near}`? {help}")).unwrap_or(help);
                self.wrong(path, message, help);
                None
            }
        }
    }

    pub(super) fn word_order(
        &mut self,
        path: &str,
        data_type: Option<DataType>,
        word: Option<WordOrderWord>,
    ) -> Option<WordOrder> {
        let data_type = data_type?;
        if word.is_none() && data_type.registers() > 1 {
            let message = format!(
                "`word_order` is missing: {} takes {} registers",
                data_type.name(),
                data_type.registers()
            );
            let help = "write \"msw-first\" (most significant register first) or \"lsw-first\"; devices differ, the manual says which";
            self.missing(path, "word_order", message, help);
            return None;
        }
        Some(word.map_or(WordOrder::MswFirst, WordOrder::from))
    }

    pub(super) fn scale(&mut self, path: &str, scale: f64) -> Option<f64> {
        if scale.abs() < f64::MIN_POSITIVE {
            self.wrong(path, "a scale of zero makes every value the same", "write the value of one count");
            return None;
        }
        Some(scale)
    }

    /// The last register is one that exists.
    pub(super) fn fits(&mut self, path: &str, address: Register, data_type: DataType) {
        let last = u32::from(address.offset) + u32::from(data_type.registers()) - 1;
        if last > u32::from(u16::MAX) {
            let message =
                format!("{} at {address} ends at {last}, beyond the last register", data_type.name());
            self.wrong(path, message, "allowed: addresses up to 65535");
        }
    }

    pub(super) fn readable(&mut self, path: &str, table: Table, device: &Device) {
        if !device.functions.reads(table) {
            let word = match table {
                Table::Coil => "read-coils",
                Table::Discrete => "read-discrete",
                Table::Holding => "read-holding",
                Table::Input => "read-input",
            };
            let message = format!("reading this needs {word}, which `{}` may not be sent", device.name);
            self.wrong(
                path,
                message,
                format!("add \"{word}\" to `functions` of the device, if the device can do it"),
            );
        }
    }

    /// A value that comes in two answers may be two halves of different values.
    fn in_one_request(&mut self, path: &str, data_type: DataType, device: &Device) {
        let most = device.quirks.max_registers_per_request;
        if data_type.registers() > most {
            let message = format!(
                "{} takes {} registers, one request reads {most}",
                data_type.name(),
                data_type.registers()
            );
            self.wrong(
                path,
                message,
                "raise `max_registers_per_request` in the quirks, or take a smaller type",
            );
        }
    }

    /// A sentinel that the type cannot hold is never seen: a broken sensor would be believed.
    fn sentinels(&mut self, path: &str, encoding: &Encoding) {
        let Some((low, high)) = encoding.data_type.integer_range() else { return };
        for bad in encoding.bad.iter().map(|bad| bad.raw) {
            if !(low..=high).contains(&i128::from(bad)) {
                let message = format!("{} never holds {bad}", encoding.data_type.name());
                self.wrong(
                    path,
                    message,
                    format!("allowed: {low} to {high}, as the raw count reads in this type"),
                );
            }
        }
    }
}

fn has_place(raw: &RawSignal) -> bool {
    raw.dbc.is_some() || raw.pdo.is_some() || raw.sdo.is_some() || raw.frame.is_some()
}

/// How far apart two values of a CAN device may be. Of what comes by itself two must come before it is stale.
fn paces(raw: &RawSignal, device: Option<&Device>, max_age: Option<Duration>) -> Duration {
    let every = device.map_or(Duration::ZERO, |device| device.every);
    match max_age.filter(|_| Check::comes_by_itself(raw)) {
        Some(age) => every.min(age / 2),
        None => every,
    }
}

//! Outputs and the heartbeat: what is written, and whether it can be.

use super::can::Target;
use super::{Check, Signals, Zero, bus_of, get, shown};
use crate::place::child;
use crate::raw::{RawOutput, VerifyWord, WritesWord};
use crate::{Axis, AxisId, Bus, Device, DeviceId, Display, Heartbeat, Output, Share, Signal, Verify, Writes};
use isotherm_core::codec::{DataType, Encoding, Register, Scale, Table};
use isotherm_core::quantity::Micron;

/// 1 mm in µm.
const MICRONS: f64 = 1000.0;

impl Check<'_> {
    /// The outputs, and the axes with the coarsest count that is written of them.
    pub(super) fn outputs(
        &mut self,
        mut axes: Vec<Option<Axis>>,
        devices: &[Option<Device>],
        signals: &Signals,
        buses: &[Option<Bus>],
    ) -> (Vec<Option<Output>>, Vec<Option<Axis>>) {
        let raw = self.raw;
        let mut outputs = Vec::new();
        for (_, name, path) in self.outputs.each() {
            let output =
                raw.output.get(&name).and_then(|raw| self.output(&path, &name, raw, devices, signals));
            outputs.push(output);
        }
        self.lines(&mut axes, &outputs);
        for ((_, _, path), output) in self.outputs.each().into_iter().zip(&outputs) {
            if let Some(output) = &output {
                self.moves(&path, output, get(&axes, output.axis.0), signals);
                self.output_times(&path, output, get(&axes, output.axis.0), devices, buses);
                if let Some(Some(axis)) = axes.get_mut(output.axis.0) {
                    note_count(axis, output);
                }
            }
        }
        (outputs, axes)
    }

    fn output(
        &mut self,
        path: &str,
        name: &str,
        raw: &RawOutput,
        devices: &[Option<Device>],
        signals: &Signals,
    ) -> Option<Output> {
        let axis = raw.axis.as_ref().and_then(|axis| self.axis_index(&child(path, "axis"), axis));
        self.pace(path, raw);
        let index = raw.device.as_ref().and_then(|device| self.device_index(&child(path, "device"), device));
        let writes = self.writes(path, raw, signals);
        let refresh = self.span(&child(path, "refresh"), raw.refresh.as_ref(), Zero::Refused);
        let when = raw.when.as_ref().and_then(|text| self.condition(&child(path, "when"), text, None));
        self.output_keys(path, raw);
        let on_can = raw.device.as_ref().and_then(|device| self.is_on_can(device)) == Some(true);
        if on_can {
            let target = self.can_target(path, name, raw, index);
            let scale = self.output_scale(path, raw, target.as_ref().map(|target| target.data_type));
            let Target { address, data_type, verify } = target?;
            self.not_one_bit(path, data_type);
            let bias = self.bias(path, raw, data_type);
            return Some(Output {
                name: name.to_owned(),
                axis: AxisId(axis?),
                device: DeviceId(index?),
                address,
                encoding: Encoding { scale: Scale::of(scale?), bias, ..super::verify::plain(data_type) },
                writes: writes?,
                verify,
                refresh,
                when,
                set: None,
                boot_counter: None,
                share: Share::Whole,
                applied: None,
                display: Display::default(),
            });
        }
        let verify = if raw.verify == Some(VerifyWord::Echo) { Verify::Echo } else { Verify::ReadBack };
        self.register_keys(path, raw);
        let address = raw.register.as_ref().and_then(|text| self.holding(&child(path, "register"), text));
        let data_type = raw.kind.map(DataType::from).and_then(|kind| self.digits(path, raw, kind));
        if let Some(data_type) = data_type {
            self.not_one_bit(path, data_type);
        }
        let word_order = self.word_order(path, data_type, raw.word_order);
        let scale = self.output_scale(path, raw, data_type);
        let (address, data_type) = (address?, data_type?);
        self.fits(&child(path, "register"), address, data_type);
        if let Some(device) = index.and_then(|index| get(devices, index)) {
            self.writable(&child(path, "register"), data_type.registers(), device);
            if verify == Verify::ReadBack {
                self.readable(&child(path, "register"), Table::Holding, device);
            }
        }
        let share = self.share(path, raw, data_type, index.and_then(|index| get(devices, index)));
        let refresh = self.refresh_of(path, share, refresh);
        let encoding = Encoding {
            data_type,
            word_order: word_order?,
            byte_swap: raw.byte_swap.unwrap_or(false),
            scale: Scale::of(scale?),
            offset: 0.0,
            bias: self.bias(path, raw, data_type),
            bad: Vec::new(),
        };
        let applied =
            self.applied(path, raw, share, (address, &encoding), index.and_then(|index| get(devices, index)));
        let display = self.display(path, raw, index.and_then(|index| get(devices, index)));
        Some(Output {
            name: name.to_owned(),
            axis: AxisId(axis?),
            device: DeviceId(index?),
            address: address.into(),
            encoding,
            writes: writes?,
            verify,
            refresh,
            when,
            set: None,
            boot_counter: None,
            share,
            applied,
            display,
        })
    }

    fn register_keys(&mut self, path: &str, raw: &RawOutput) {
        if raw.pdo.is_some() || raw.sdo.is_some() || raw.frame.is_some() {
            return;
        }
        if raw.register.is_none() {
            let help = "write a holding register, as \"holding:104\" or \"40105\"";
            self.missing(path, "register", "`register` is missing: where is it written?", help);
        }
        if raw.kind.is_none() {
            let help = "allowed: u16, i16, u32, i32, u64, i64, f32, f64; the device's manual says which";
            self.missing(path, "type", "`type` is missing: how does the value lie in its registers?", help);
        }
    }

    fn not_one_bit(&mut self, path: &str, data_type: DataType) {
        if data_type == DataType::Bool {
            let help = "write an integer or floating-point type: i16, i32, f32, …";
            self.wrong(&child(path, "type"), "one bit cannot hold a compensation value", help);
        }
    }

    fn bias(&mut self, path: &str, raw: &RawOutput, data_type: DataType) -> i64 {
        let bias = raw.bias.unwrap_or(0);
        if data_type.integer_range().is_none() && bias != 0 {
            let help = "a floating-point register holds negative values as they are: remove `bias`";
            self.wrong(&child(path, "bias"), "a bias belongs to whole counts", help);
        }
        bias
    }

    fn writes(&mut self, path: &str, raw: &RawOutput, signals: &Signals) -> Option<Writes> {
        let at = child(path, "position");
        match raw.writes? {
            word @ (WritesWord::Offset
            | WritesWord::Intercept
            | WritesWord::Slope
            | WritesWord::Reference) => {
                if raw.position.is_some() {
                    self.wrong_key(
                        &at,
                        "only a corrected position has a position",
                        "remove it, or write writes = \"corrected\"",
                    );
                }
                Some(match word {
                    WritesWord::Intercept => Writes::Intercept,
                    WritesWord::Slope => Writes::Slope,
                    WritesWord::Reference => Writes::Reference,
                    _ => Writes::Offset,
                })
            }
            WritesWord::Corrected => {
                let Some(name) = &raw.position else {
                    let help = "name the scale's signal, in mm: position + Cz is written";
                    self.missing(path, "position", "`position` is missing: which scale is corrected?", help);
                    return None;
                };
                let position = self.signal(&at, name)?;
                self.in_millimetres(&at, name, get(signals, position.0));
                Some(Writes::Corrected { position })
            }
        }
    }

    /// A position is in mm. Where the unit was a wrong word, that has been said.
    pub(super) fn in_millimetres(&mut self, path: &str, name: &str, signal: Option<&Signal>) {
        if let Some(unit) = signal.map(|signal| signal.unit.0).filter(|unit| *unit != "mm") {
            let message = format!("`{name}` is in \"{unit}\"; a position is in mm");
            let help = format!("write unit = \"mm\" and the scale in mm per count at signal `{name}`");
            self.wrong(path, message, help);
        }
    }

    fn output_scale(&mut self, path: &str, raw: &RawOutput, data_type: Option<DataType>) -> Option<f64> {
        let whole = data_type?.integer_range().is_some();
        if raw.scale.is_none() && whole {
            let help = "write the value of one count: µm of an offset or intercept, µm/mm of a slope, mm of a position";
            self.missing(path, "scale", "`scale` is missing: what is one count worth?", help);
            return None;
        }
        if raw.scale.is_none() && self.places.contains(&child(path, "scale")) {
            return None;
        }
        self.scale(&child(path, "scale"), raw.scale.unwrap_or(1.0))
    }

    pub(super) fn holding(&mut self, path: &str, text: &str) -> Option<Register> {
        let address = self.address(path, text)?;
        if address.table == Table::Holding {
            return Some(address);
        }
        let table = address.table.name();
        let message = if address.table.is_writable() {
            format!("{address} is one bit; this does not fit into it")
        } else {
            format!("{address} cannot be written: {table} registers are read-only")
        };
        self.wrong(path, message, "write to a holding register, as \"holding:100\" or \"40101\"");
        None
    }

    pub(super) fn writable(&mut self, path: &str, registers: u16, device: &Device) {
        if device.functions.writes(registers).is_none() {
            let words =
                if registers == 1 { "\"write-single\" or \"write-multiple\"" } else { "\"write-multiple\"" };
            let message = format!(
                "writing {registers} register(s) needs {words}, which `{}` may not be sent",
                device.name
            );
            self.wrong(
                path,
                message,
                format!("add {words} to `functions` of the device, if the device can do it"),
            );
        }
    }

    /// The register can hold every value that the axis may reach, and one step is enough to change it.
    fn moves(&mut self, path: &str, output: &Output, axis: Option<&Axis>, signals: &Signals) {
        let Some(axis) = axis else { return };
        let encoding = &output.encoding;
        let guard = &axis.settings.guard;
        let Some((low, high)) = encoding.data_type.integer_range() else { return };
        let factor = if axis.diameter { 2.0 } else { 1.0 };
        let limit = guard.limit.get() * factor;
        let reach = match output.writes {
            Writes::Offset | Writes::Intercept => Some((-limit, limit)),
            Writes::Slope => axis
                .settings
                .intercept_slope
                .map(|line| (-limit / line.reach.get(), limit / line.reach.get())),
            Writes::Reference => {
                axis.settings.intercept_slope.map(|line| (line.reference.get(), line.reference.get()))
            }
            Writes::Corrected { position } => get(signals, position.0)
                .and_then(|signal| signal.range)
                .map(|(from, to)| (from - limit / MICRONS, to + limit / MICRONS)),
        };
        if let Some((from, to)) = reach
            && (encoding.encode(from).saturated || encoding.encode(to).saturated)
        {
            let unit = output.writes.unit();
            let name = encoding.data_type.name();
            let message = format!(
                "{from} to {to} {unit} do not fit {name} at {} {unit} per count with bias {}: it holds {low} to {high} counts",
                encoding.scale.get(),
                encoding.bias
            );
            self.wrong(
                &child(path, "type"),
                message,
                "take a wider type, a coarser `scale`, a `bias`, or a smaller `limit`",
            );
        }
        let count = encoding.scale.get().abs();
        let step = guard.step.get() * factor;
        let needed = output.share.counts_of_a_step();
        let count = match (output.writes, axis.settings.intercept_slope) {
            (Writes::Offset | Writes::Intercept, _) => count,
            (Writes::Slope, Some(line)) => count * line.reach.get(),
            _ => return,
        };
        if step < f64::from(needed) * count * (1.0 - 1e-9) {
            let axis = &axis.settings.name;
            let (follows, at_least) = match output.share {
                Share::Whole => ("it could never move", "one count"),
                Share::Ledger => (
                    "beside an operator's part it takes two counts, because their sum is never made zero",
                    "two counts",
                ),
            };
            let message =
                format!("one count is {count} µm, one step of axis `{axis}` is {step} µm: {follows}");
            self.wrong(
                &child(path, "scale"),
                message,
                format!("make `step` of axis `{axis}` at least {at_least}"),
            );
        }
    }

    fn output_times(
        &mut self,
        path: &str,
        output: &Output,
        axis: Option<&Axis>,
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) {
        let Some(bus) = get(devices, output.device.0).and_then(|device| bus_of(device, buses)) else {
            return;
        };
        let timeout = shown(bus.timeout);
        if let Some(axis) = axis.filter(|axis| axis.settings.every <= bus.timeout) {
            let (name, every) = (&axis.settings.name, shown(axis.settings.every));
            let message = format!(
                "the bus `{}` waits {timeout} for an answer, as long as axis `{name}`'s period {every}",
                bus.name
            );
            self.wrong(
                &child(path, "device"),
                message,
                "make `timeout` of the bus shorter than `every` of the axis",
            );
        }
        if let Some(refresh) = output.refresh.filter(|refresh| *refresh <= bus.timeout) {
            let message = format!(
                "the bus `{}` waits {timeout} for an answer, as long as `refresh` {}",
                bus.name,
                shown(refresh)
            );
            self.wrong(&child(path, "refresh"), message, "make `refresh` longer than `timeout` of the bus");
        }
    }

    pub(super) fn heartbeat(
        &mut self,
        devices: &[Option<Device>],
        buses: &[Option<Bus>],
    ) -> Option<Heartbeat> {
        let raw = self.raw.heartbeat.as_ref()?;
        let every = self.span("heartbeat.every", raw.every.as_ref(), Zero::Refused);
        let index = raw.device.as_ref().and_then(|device| self.device_index("heartbeat.device", device));
        let address = raw.register.as_ref().and_then(|text| self.holding("heartbeat.register", text));
        if raw.device.as_ref().and_then(|device| self.is_on_can(device)) == Some(true) {
            let help =
                "name a Modbus device; a CANopen node is told by its own heartbeat consumer, object 1016";
            self.wrong("heartbeat.device", "the heartbeat is a register, and this device has none", help);
            return None;
        }
        if let Some(device) = index.and_then(|index| get(devices, index)) {
            self.writable("heartbeat.register", 1, device);
            if let (Some(bus), Some(every)) = (bus_of(device, buses), every)
                && every < bus.timeout
            {
                let (name, timeout, every) = (&bus.name, shown(bus.timeout), shown(every));
                let message = format!(
                    "the bus `{name}` waits {timeout} for an answer, longer than the heartbeat's {every}"
                );
                self.wrong(
                    "heartbeat.every",
                    message,
                    "make `timeout` of the bus shorter, or the heartbeat slower",
                );
            }
        }
        Some(Heartbeat { device: DeviceId(index?), address: address?, every: every? })
    }
}

/// The guard decides whole counts of the coarsest register. Cz is doubled on its way to a diameter, so a count there
/// is worth half.
fn note_count(axis: &mut Axis, output: &Output) {
    if output.encoding.data_type.integer_range().is_none() {
        return;
    }
    let count = output.encoding.scale.get().abs();
    let coarser = |known: Option<Micron>, count| match known {
        Some(known) if known.get() >= count => Some(known),
        _ => Micron::new(count),
    };
    if output.writes.is_cz() {
        let count = count * if axis.diameter { 0.5 } else { 1.0 };
        axis.settings.guard.count = coarser(axis.settings.guard.count, count);
    } else if let (Writes::Slope, Some(line)) = (output.writes, &mut axis.settings.intercept_slope) {
        line.count = coarser(line.count, count * line.reach.get());
    }
}

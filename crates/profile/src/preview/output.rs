//! What is written, where, how, and how it is believed.

use std::fmt;

use serde::Serialize;

use super::Register;
use crate::{Beside, Heartbeat, Output, Profile, Share, Verify, Writes};
use isotherm_core::codec::{self, Address, Table};

/// 1 mm in µm.
const MICRONS: f64 = 1000.0;

/// One output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WriteExplained {
    /// Its name.
    pub output: String,
    /// Whose Cz.
    pub axis: String,
    /// Where it goes.
    pub device: String,
    /// Its first register.
    pub register: Register,
    /// How many registers.
    pub registers: u16,
    /// `i32`.
    pub data_type: &'static str,
    /// Which register comes first; `None` for one register.
    pub word_order: Option<String>,
    /// The worth of one count, in `unit`.
    pub scale: f64,
    /// µm for an offset, mm for a corrected position.
    pub unit: &'static str,
    /// Added to the raw count.
    pub bias: i64,
    /// Smallest and largest count that is ever written, bias included; `None` where the profile does not bound it.
    pub counts: Option<(i64, i64)>,
    /// Function code of the write; 0 on a CAN line.
    pub function: u8,
    /// What the register means, and which way it moves.
    pub meaning: String,
    /// How a write is believed.
    pub verify: String,
    /// Written again though unchanged.
    pub refresh: Option<String>,
    /// Interlock.
    pub when: Option<String>,
    /// How a restart of the control is seen, besides the register going to zero.
    pub restart: Option<String>,
    /// Whose register it is, where it is not ours alone.
    pub share: Option<&'static str>,
    /// The channel of a template that it is, and what the profile says otherwise.
    pub channel: Option<String>,
    /// What a display is given besides the value.
    pub display: Vec<String>,
}

/// The register that counts while the gateway lives.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HeartbeatExplained {
    /// Where.
    pub device: String,
    /// The register.
    pub register: Register,
    /// How often it counts.
    pub every: String,
    /// Function code of the write.
    pub function: u8,
}

pub(super) fn explained(profile: &Profile, output: &Output) -> WriteExplained {
    let axis = profile.axis(output.axis);
    let device = profile.device(output.device);
    let encoding = &output.encoding;
    let registers = encoding.data_type.registers();
    let factor = if axis.diameter { 2.0 } else { 1.0 };
    let limit = axis.settings.guard.limit.get() * factor;
    let (unit, reach, meaning) = match output.writes {
        Writes::Offset => {
            let counts = figure(factor / encoding.scale.get());
            let what = if axis.diameter { "twice Cz" } else { "Cz" };
            ("µm", Some((-limit, limit)), format!("{what}: +1 µm of Cz is {counts} counts"))
        }
        Writes::Intercept => {
            let counts = figure(1.0 / encoding.scale.get());
            (
                "µm",
                Some((-limit, limit)),
                format!("K0, Cz at the reference position: +1 µm is {counts} counts"),
            )
        }
        Writes::Slope => {
            let reach = axis.settings.intercept_slope.map_or(f64::INFINITY, |line| line.reach.get());
            let most = limit / reach;
            let meaning = format!(
                "tanβ, which the control multiplies by the distance from the reference position: +0.001 µm/mm is {} \
                 counts; at most ±{} µm/mm, which is ±{limit} µm at {reach} mm",
                figure(0.001 / encoding.scale.get()),
                figure(most).trim_start_matches('+'),
            );
            ("µm/mm", Some((-most, most)), meaning)
        }
        Writes::Reference => {
            let reference = axis.settings.intercept_slope.map_or(0.0, |line| line.reference.get());
            ("mm", Some((reference, reference)), format!("P0, the reference position: always {reference} mm"))
        }
        Writes::Corrected { position } => {
            let signal = profile.signal(position);
            let reach = signal.range.map(|(low, high)| (low - limit / MICRONS, high + limit / MICRONS));
            let what = if axis.diameter { "2·Cz" } else { "Cz" };
            ("mm", reach, format!("{} + {what}, each time the scale is read", signal.name))
        }
    };
    let is_object = matches!(output.address, Address::Object(_));
    WriteExplained {
        output: output.name.clone(),
        axis: axis.settings.name.clone(),
        device: device.name.clone(),
        register: Register::at(&output.address, encoding.data_type),
        registers,
        data_type: encoding.data_type.name(),
        word_order: (registers > 1 && output.address.register().is_some()).then(|| encoding.word_order.to_string()),
        scale: encoding.scale.get(),
        unit,
        bias: encoding.bias,
        counts: reach.filter(|_| encoding.data_type.integer_range().is_some()).map(|(low, high)| {
            let (a, b) =
                (count(low, encoding.scale.get(), encoding.bias), count(high, encoding.scale.get(), encoding.bias));
            (a.min(b), a.max(b))
        }),
        function: match output.address {
            Address::Modbus(_) => device.functions.writes(registers).map_or(0, crate::WriteFunction::code),
            Address::Object(_) | Address::Frame(_) => 0,
        },
        meaning,
        verify: match output.verify {
            _ if let Some(applied) = &output.applied => format!("once {} says that it is applied, within {} µm after {} at most; the register itself is compared as well", Register::of(applied.address), applied.tolerance, humantime::format_duration(applied.settle)),
            Verify::Echo if output.is_single_offset() && device.functions.reads_at(&output.reads_at()) => {
                "once it is read back: what can be read is read before and after, whatever the answer says".to_owned()
            }
            Verify::ReadBack if is_object => "once the object reads back what was written".to_owned(),
            Verify::Echo if is_object => {
                "once the node has taken it; the object is not read back".to_owned()
            }
            Verify::ReadBack => "once the register reads back what was written".to_owned(),
            Verify::Echo => {
                "once the answer repeats what was written; the register is not read back".to_owned()
            }
            Verify::ReadBackAt(object) => format!("once object {object} reads back what was written"),
            Verify::Shown => "as soon as it is sent: shown, not verified, nothing reads it back".to_owned(),
        },
        refresh: output.refresh.map(|refresh| humantime::format_duration(refresh).to_string()),
        when: output.when.as_ref().map(|condition| condition.text.clone()),
        restart: restart(profile, output),
        channel: super::device::channel(device, &output.name),
        display: display(output),
        share: (output.share == Share::Ledger).then_some(
            "what an operator writes there stays; our share is added to it, and a ledger on disk says how much that is",
        ),
    }
}

fn display(output: &Output) -> Vec<String> {
    let at = |offset| Register::of(codec::Register { table: Table::Holding, offset });
    let beside = output.display.beside.iter().map(|word| {
        let register = at(word.register);
        if word.good == word.fault {
            return format!("with it {register}: always {:#06x}", word.good);
        }
        let Beside { good, degraded, fault, .. } = word;
        format!("with it {register}: {good:#06x}; {degraded:#06x} by a lesser model, {fault:#06x} by none")
    });
    let stale = output.display.stale.iter().map(|stale| {
        let register = at(stale.register);
        format!(
            "without a position, and while the axis is off: \"{}\" in {register} and after it",
            stale.text
        )
    });
    beside.chain(stale).collect()
}

fn restart(profile: &Profile, output: &Output) -> Option<String> {
    let counter = output.boot_counter.map(|id| &profile.signal(id).address);
    let counter = counter.map(|address| format!("{address} changes"));
    let on = profile.machine.on.filter(|_| output.writes.is_scheduled());
    let on = on.map(|id| format!("{} rises", profile.signal(id).name));
    let seen: Vec<String> = counter.into_iter().chain(on).collect();
    (!seen.is_empty()).then(|| seen.join(", or "))
}

pub(super) fn heartbeat(profile: &Profile, heartbeat: &Heartbeat) -> HeartbeatExplained {
    let device = profile.device(heartbeat.device);
    HeartbeatExplained {
        device: device.name.clone(),
        register: Register::of(heartbeat.address),
        every: humantime::format_duration(heartbeat.every).to_string(),
        function: device.functions.writes(1).map_or(0, crate::WriteFunction::code),
    }
}

#[allow(clippy::cast_possible_truncation, reason = "the check has seen that it fits the register's type")]
fn count(value: f64, scale: f64, bias: i64) -> i64 {
    ((value / scale).round() as i64).saturating_add(bias)
}

fn figure(number: f64) -> String {
    let text = format!("{:.6}", number.abs());
    let sign = if number < 0.0 { "−" } else { "+" };
    format!("{sign}{}", text.trim_end_matches('0').trim_end_matches('.'))
}

impl fmt::Display for WriteExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let plural = if self.registers == 1 { "" } else { "s" };
        let WriteExplained { output, register, device, data_type, .. } = self;
        match register.is_in_frames() {
            true => write!(f, "  {output}: {register}, to {device}")?,
            false => write!(f, "  {output}: {register} of {device}, {data_type}")?,
        }
        if let Some(order) = &self.word_order {
            write!(f, " {order}")?;
        }
        write!(f, ", {} {} per count", self.scale, self.unit)?;
        if self.bias != 0 {
            write!(f, ", bias {}", self.bias)?;
        }
        match self.function {
            0 => writeln!(f)?,
            function => writeln!(f, "; function {function:02}, {} register{plural}", self.registers)?,
        }
        writeln!(f, "    writes {}", self.meaning)?;
        self.display.iter().try_for_each(|line| writeln!(f, "    {line}"))?;
        if let Some(channel) = &self.channel {
            writeln!(f, "    {channel}")?;
        }
        match self.counts {
            Some((low, high)) if self.share.is_some() => {
                writeln!(f, "    counts {low} to {high}, and the operator's part")?;
            }
            Some((low, high)) => writeln!(f, "    counts {low} to {high}")?,
            None => writeln!(f, "    counts are bounded by the register's type alone")?,
        }
        if let Some(share) = self.share {
            writeln!(f, "    {share}")?;
        }
        writeln!(f, "    believed {}", self.verify)?;
        if let Some(refresh) = &self.refresh {
            let again = if self.share.is_some() { "looked at" } else { "written" };
            writeln!(f, "    {again} again every {refresh}")?;
        }
        if let Some(restart) = &self.restart {
            writeln!(f, "    read anew, and Cz goes on from there, when {restart}")?;
        }
        match &self.when {
            Some(when) => writeln!(f, "    only when {when}, otherwise held"),
            None => writeln!(f, "    no interlock"),
        }
    }
}

impl fmt::Display for HeartbeatExplained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let HeartbeatExplained { device, register, every, function } = self;
        write!(
            f,
            "heartbeat: {register} of {device}, u16, counts every {every}; function {function:02}, 1 register"
        )
    }
}

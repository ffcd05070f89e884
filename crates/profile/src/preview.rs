//! What a good profile will do, in words and figures: what is read, what is written, which way it moves.
//!
//! A person reads it before the gateway touches a machine; a program reads the same as one JSON document.

use std::fmt;

use serde::Serialize;

use crate::plan::{plan, summary};
use crate::{BusId, Device, DeviceId, Flag, Profile, ProfileError, Signal, Template, Unit};
use isotherm_core::codec::{self, Address, DataType, Sentinel};
use isotherm_core::reading::{Reason, SignalId};

mod axis;
mod can;
mod device;
mod load;
mod output;
mod serial;
mod set;

pub use axis::{AxisExplained, ModelExplained};
pub use can::{CanExplained, CanLineExplained};
pub use device::CheckExplained;
pub use load::{LoadExplained, Verdict};
pub use output::{HeartbeatExplained, WriteExplained};
pub use serial::SerialExplained;
pub use set::{HandshakeExplained, SetExplained};

/// The whole machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Preview {
    /// `machine.name`.
    pub machine: String,
    /// One line for people.
    pub description: String,
    /// The lines.
    pub buses: Vec<BusExplained>,
    /// What is read from each device.
    pub devices: Vec<DeviceExplained>,
    /// Where each signal lies.
    pub signals: Vec<SignalExplained>,
    /// What is computed, and which way it moves.
    pub axes: Vec<AxisExplained>,
    /// Everything that is ever written.
    pub writes: Vec<WriteExplained>,
    /// What of that lands together, and how the control is told.
    pub sets: Vec<SetExplained>,
    /// The register that counts.
    pub heartbeat: Option<HeartbeatExplained>,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BusExplained {
    /// Its name.
    pub name: String,
    /// `Modbus TCP`, `RTU over TCP`, `Modbus RTU`, `CAN`.
    pub kind: &'static str,
    /// Host and port, the port's path, or the interface.
    pub address: String,
    /// Modbus/TCP Security; `None`: in the clear.
    pub tls: Option<TlsExplained>,
    /// Longest wait for an answer.
    pub timeout: String,
    /// How long a write that was not answered may still arrive.
    pub late: String,
    /// A serial port's settings and its time.
    pub serial: Option<SerialExplained>,
    /// What passes on a CAN line.
    pub can: Option<CanLineExplained>,
    /// How full it is; `None` where nobody is asked.
    pub load: Option<LoadExplained>,
}

/// Whom a secured line trusts.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TlsExplained {
    /// The name that the device's certificate must have.
    pub name: String,
    /// The file with the certificates that are trusted.
    pub trusts: String,
    /// The file with the certificate that is shown.
    pub shows: String,
}

/// One device and its read plan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DeviceExplained {
    /// Its name.
    pub name: String,
    /// Its line.
    pub bus: String,
    /// Modbus unit identifier, or CANopen node number; 0 where there is none.
    pub unit: u8,
    /// Poll period.
    pub every: String,
    /// `3 requests touching 17 registers for 9 signals`.
    pub summary: String,
    /// The requests of one poll.
    pub requests: Vec<RequestExplained>,
    /// What is read before anything that depends on it is armed.
    pub checks: Vec<CheckExplained>,
    /// What it has from its template.
    pub template: Option<Template>,
    /// What it does on a CAN line.
    pub can: Option<CanExplained>,
}

/// One read request.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RequestExplained {
    /// `read input:0..7 (30001..30008), 8 registers`.
    pub read: String,
    /// Function code.
    pub function: u8,
    /// The signals in its answer.
    pub signals: Vec<String>,
}

/// A register in both notations, or where a value is on a CAN line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Register {
    /// Zero-based: `holding:104`; `object 6150:01`; `0x185, 16 bits from 0 up (Intel), signed`.
    pub protocol: String,
    /// One-based: `40105`; empty on a CAN line.
    pub modicon: String,
}

/// One signal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SignalExplained {
    /// Its name.
    pub name: String,
    /// Where it is read.
    pub device: String,
    /// Its first register.
    pub register: Register,
    /// `i32`.
    pub data_type: &'static str,
    /// Which register comes first; `None` for one register.
    pub word_order: Option<String>,
    /// `value = raw · scale + offset`.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// As the profile names it.
    pub unit: &'static str,
    /// When it is not believed.
    pub doubts: Vec<String>,
    /// What is written before each read: `holding:132 (40133) = 1`.
    pub capture: Option<String>,
    /// The channel of a template that it is, and what the profile says otherwise.
    pub channel: Option<String>,
}

impl Register {
    fn of(address: codec::Register) -> Register {
        Register { protocol: address.to_string(), modicon: address.modicon() }
    }

    /// It is no register and no object, but bits that say themselves of which kind they are.
    fn is_in_frames(&self) -> bool {
        self.modicon.is_empty() && !self.protocol.starts_with("object")
    }

    /// Where a value of a device is.
    fn at(address: &Address, data_type: DataType) -> Register {
        let (register, bit) = match (address, data_type) {
            (Address::Modbus(register), DataType::Bit(bit)) => (*register, Some(bit)),
            (Address::Modbus(register), _) => (*register, None),
            (other, _) => return Register { protocol: other.to_string(), modicon: String::new() },
        };
        let flag = Flag { address: register, bit };
        Register { protocol: flag.to_string(), modicon: flag.modicon() }
    }
}

impl fmt::Display for Register {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.modicon.as_str() {
            "" => f.write_str(&self.protocol),
            modicon => write!(f, "{} ({modicon})", self.protocol),
        }
    }
}

impl Preview {
    /// Explains a profile.
    pub fn of(profile: &Profile) -> Preview {
        let buses = (0..profile.buses.len()).map(|place| serial::bus(profile, BusId(place)));
        let devices = profile.devices.iter().enumerate();
        Preview {
            machine: profile.name.clone(),
            description: profile.description.clone(),
            buses: buses.collect(),
            devices: devices
                .map(|(index, device)| device_explained(profile, DeviceId(index), device))
                .collect(),
            signals: (0..profile.signals.len())
                .map(|index| signal_explained(profile, SignalId(index)))
                .collect(),
            axes: profile.axes.iter().map(|axis| axis::explained(profile, axis)).collect(),
            writes: profile.outputs.iter().map(|output| output::explained(profile, output)).collect(),
            sets: profile.sets.iter().map(|set| set::explained(profile, set)).collect(),
            heartbeat: profile.heartbeat.as_ref().map(|heartbeat| output::heartbeat(profile, heartbeat)),
        }
    }

    /// What of it, explained from this profile, cannot be kept: lines that are too full.
    pub fn warnings(&self, profile: &Profile) -> Vec<ProfileError> {
        load::warnings(self, profile)
    }
}

fn device_explained(profile: &Profile, id: DeviceId, device: &Device) -> DeviceExplained {
    let is_asked = |signal: &Signal| signal.device == id && signal.address.register().is_some();
    let signals = profile.signals.iter().enumerate().filter(|(_, signal)| is_asked(signal));
    let requests = plan(device, signals.map(|(index, signal)| (SignalId(index), signal)));
    let explained = requests.iter().map(|request| RequestExplained {
        read: request.to_string(),
        function: request.span().map_or(0, |(from, _)| from.table.read_function()),
        signals: request.fields.iter().map(|field| profile.signal(field.signal).name.clone()).collect(),
    });
    DeviceExplained {
        name: device.name.clone(),
        bus: profile.bus(device.bus).name.clone(),
        unit: device.unit,
        every: humantime::format_duration(device.every).to_string(),
        summary: summary(&requests),
        requests: explained.collect(),
        checks: device.verify.iter().map(CheckExplained::of).collect(),
        template: device.template.clone(),
        can: device.can.as_ref().map(|known| can::device(profile, id, known)),
    }
}

fn signal_explained(profile: &Profile, id: SignalId) -> SignalExplained {
    let signal = profile.signal(id);
    let encoding = &signal.encoding;
    let mut doubts = Vec::new();
    if !encoding.bad.is_empty() {
        let raw: Vec<String> = encoding.bad.iter().map(sentinel).collect();
        doubts.push(format!("at raw {}", raw.join(" or ")));
    }
    if let Some((low, high)) = signal.range {
        doubts.push(format!("outside {low} to {high} {}", signal.unit));
    }
    if let Some(rate) = signal.max_rate {
        doubts.push(format!("faster than {rate} {} per second", signal.unit));
    }
    if let Some(counter) = &signal.counter {
        let (speed, unit) = (counter.max_speed, signal.unit);
        doubts.push(format!(
            "after a step faster than {speed} {unit} per second until the next reading confirms it"
        ));
    }
    doubts.push(format!("older than {}", humantime::format_duration(signal.max_age)));
    if let Some(condition) = &signal.fault_when {
        doubts.push(format!("when {}", condition.text));
    }
    SignalExplained {
        name: signal.name.clone(),
        device: profile.device(signal.device).name.clone(),
        register: Register::at(&signal.address, encoding.data_type),
        data_type: encoding.data_type.name(),
        word_order: (encoding.data_type.registers() > 1 && signal.address.register().is_some())
            .then(|| encoding.word_order.to_string()),
        scale: encoding.scale.get(),
        offset: encoding.offset,
        unit: signal.unit.0,
        doubts,
        capture: signal
            .capture
            .map(|capture| format!("{} = {}", Register::of(capture.address), capture.value)),
        channel: device::channel(profile.device(signal.device), &signal.name),
    }
}

/// `-512 (open circuit)`.
fn sentinel(bad: &Sentinel) -> String {
    match bad.means {
        Reason::Sentinel => bad.raw.to_string(),
        means => format!("{} ({means})", bad.raw),
    }
}

impl fmt::Display for Preview {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.machine)?;
        if !self.description.is_empty() {
            write!(f, ": {}", self.description)?;
        }
        writeln!(f)?;
        for bus in &self.buses {
            writeln!(f, "\nbus {}: {} at {}, timeout {}", bus.name, bus.kind, bus.address, bus.timeout)?;
            writeln!(f, "  a write that is not answered may still arrive for {}", bus.late)?;
            if let Some(tls) = &bus.tls {
                let TlsExplained { name, trusts, shows } = tls;
                writeln!(
                    f,
                    "  trusts a certificate for {name} signed by one in {trusts}, or one in there; shows {shows}"
                )?;
            }
            if let Some(serial) = &bus.serial {
                write!(f, "{serial}")?;
            }
            if let Some(can) = &bus.can {
                write!(f, "{can}")?;
            }
            if let Some(load) = &bus.load {
                write!(f, "{load}")?;
            }
            for device in self.devices.iter().filter(|device| device.bus == bus.name) {
                let DeviceExplained { name, unit, every, summary, .. } = device;
                match &device.can {
                    None => writeln!(f, "  {name}: unit {unit}, every {every}: {summary}")?,
                    Some(CanExplained { node: Some(node), .. }) => {
                        writeln!(f, "  {name}: CANopen node {node}")?
                    }
                    Some(_) => writeln!(f, "  {name}: sends frames by itself")?,
                }
                if let Some(can) = &device.can {
                    write!(f, "{can}")?;
                }
                for request in &device.requests {
                    let signals = request.signals.join(", ");
                    writeln!(f, "    {}, function {:02}: {signals}", request.read, request.function)?;
                }
                for check in &device.checks {
                    writeln!(f, "    {check}")?;
                }
                if let Some(template) = &device.template {
                    device::write_template(f, template)?;
                }
            }
        }
        writeln!(f, "\nsignals")?;
        for signal in &self.signals {
            let SignalExplained { name, register, device, data_type, .. } = signal;
            match register.is_in_frames() {
                true => write!(f, "  {name}: {register}, from {device}")?,
                false => write!(f, "  {name}: {register} of {device}, {data_type}")?,
            }
            if let Some(order) = &signal.word_order {
                write!(f, " {order}")?;
            }
            if signal.data_type != "bool" {
                let unit = Unit(signal.unit).to_string();
                let space = if unit.is_empty() { "" } else { " " };
                write!(f, ", {}{space}{unit} per count", signal.scale)?;
            }
            if signal.offset.abs() > 0.0 {
                write!(f, ", plus {}", signal.offset)?;
            }
            write!(f, "; not believed {}", signal.doubts.join(", "))?;
            match &signal.channel {
                Some(channel) => writeln!(f, "; {channel}")?,
                None => writeln!(f)?,
            }
        }
        for axis in &self.axes {
            write!(f, "\n{axis}")?;
        }
        writeln!(f, "\nwrites")?;
        for write in &self.writes {
            write!(f, "{write}")?;
        }
        let captures = self.signals.iter().filter_map(|signal| Some((signal, signal.capture.as_ref()?)));
        for (signal, capture) in captures.clone() {
            let (name, device) = (&signal.name, &signal.device);
            writeln!(f, "  {capture} of {device}: before each read of {name}, in a dry run too")?;
        }
        for set in &self.sets {
            write!(f, "{set}")?;
        }
        match &self.heartbeat {
            Some(heartbeat) => writeln!(f, "  {heartbeat}"),
            None if self.writes.is_empty() && captures.count() == 0 => writeln!(f, "  nothing"),
            None => Ok(()),
        }
    }
}

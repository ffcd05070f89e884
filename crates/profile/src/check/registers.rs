//! Which registers belong to whom: two things may not half share one.

use std::collections::{BTreeSet, HashMap, HashSet};

use super::{Check, Signals, get};
use crate::place::child;
use crate::{Bus, Device, DeviceId, Heartbeat, Output, OutputSet, Writes};
use isotherm_core::codec::{Address, DataType, Register};

/// A stretch of registers that something reads or writes.
struct Claim {
    /// The line's address and the unit: the same device may have two names.
    device: (String, u8),
    address: Register,
    data_type: DataType,
    /// The key that names it.
    path: String,
    what: String,
    written: bool,
}

impl Claim {
    fn last(&self) -> u32 {
        u32::from(self.address.offset) + u32::from(self.data_type.registers()) - 1
    }

    /// All of its registers that there are.
    fn registers(&self) -> impl Iterator<Item = Register> {
        let Register { table, offset } = self.address;
        (offset..=u16::try_from(self.last()).unwrap_or(u16::MAX))
            .map(move |offset| Register { table, offset })
    }

    fn overlaps(&self, other: &Claim) -> bool {
        self.device == other.device
            && self.address.table == other.address.table
            && u32::from(self.address.offset) <= other.last()
            && u32::from(other.address.offset) <= self.last()
    }

    fn is_same_value(&self, other: &Claim) -> bool {
        let is_bit = |claim: &Claim| matches!(claim.data_type, DataType::Bit(_));
        let single = self.data_type.registers() == 1 && other.data_type.registers() == 1;
        self.address == other.address
            && (self.data_type == other.data_type || (single && (is_bit(self) || is_bit(other))))
    }

    fn shown(&self) -> String {
        let Register { table, offset } = self.address;
        let span = if self.data_type.registers() == 1 {
            format!("{table}:{offset}", table = table.name())
        } else {
            format!("{}:{offset}..{}", table.name(), self.last())
        };
        format!("{} ({} at {span})", self.what, self.data_type.name())
    }
}

impl Check<'_> {
    pub(super) fn registers(
        &mut self,
        buses: &[Option<Bus>],
        devices: &[Option<Device>],
        signals: &Signals,
        outputs: &[Option<Output>],
        sets: &[Option<OutputSet>],
        heartbeat: Option<&Heartbeat>,
    ) {
        let device = |id: DeviceId| {
            let device = get(devices, id.0)?;
            let bus = get(buses, device.bus.0)?;
            Some((bus.address.clone(), device.unit))
        };
        let claim = |id, address, data_type, path: String, what: String, written| {
            Some(Claim { device: device(id)?, address, data_type, path, what, written })
        };
        let mut claims: Vec<Claim> = Vec::new();
        let boot_counters: HashMap<usize, &Output> = outputs
            .iter()
            .flatten()
            .rev()
            .filter_map(|output| Some((output.boot_counter?.0, output)))
            .collect();
        let mut captured = HashSet::new();
        let register = |table, name: &str| child(&child(table, name), "register");
        for (place, signal) in signals.iter().enumerate() {
            let Some(signal) = signal else { continue };
            let (path, what) = match boot_counters.get(&place) {
                Some(output) => {
                    let path = child(&child("output", &output.name), "restart");
                    (child(&path, "boot_counter"), "the boot counter".to_owned())
                }
                None => (register("signal", &signal.name), format!("signal `{}`", signal.name)),
            };
            if let Address::Modbus(register) = signal.address {
                claims.extend(claim(signal.device, register, signal.encoding.data_type, path, what, false));
            }
            // Several counters of a device may be captured by one command.
            let mut is_first = |address| captured.insert((signal.device, address));
            if let Some(capture) = signal.capture.filter(|capture| is_first(capture.address)) {
                let path = child(&child(&child("signal", &signal.name), "counter"), "capture");
                let what = format!("the capture command of `{}`", signal.name);
                let kind = if capture.address.table.is_bits() { DataType::Bool } else { DataType::U16 };
                claims.extend(claim(
                    signal.device,
                    capture.address,
                    kind,
                    child(&path, "register"),
                    what,
                    true,
                ));
            }
        }
        for output in outputs.iter().flatten() {
            let (path, what) = (register("output", &output.name), format!("output `{}`", output.name));
            if let Address::Modbus(register) = output.address {
                claims.extend(claim(output.device, register, output.encoding.data_type, path, what, true));
            }
        }
        for output in outputs.iter().flatten() {
            let path = child("output", &output.name);
            for address in output.display.registers() {
                let (path, what) =
                    (child(&path, "beside"), format!("the display of output `{}`", output.name));
                claims.extend(claim(output.device, address, DataType::U16, path, what, true));
            }
        }
        for set in sets.iter().flatten() {
            for (path, what, address, written) in words_of(set) {
                let kind = if address.table.is_bits() { DataType::Bool } else { DataType::U16 };
                claims.extend(claim(set.device, address, kind, path, what, written));
            }
        }
        if let Some(heartbeat) = heartbeat {
            let (path, what) = ("heartbeat.register".to_owned(), "the heartbeat".to_owned());
            claims.extend(claim(heartbeat.device, heartbeat.address, DataType::U16, path, what, true));
        }
        // The later of two is the one to blame.
        claims.sort_by_key(|claim| self.places.rank(&claim.path));
        let mut claimed: HashMap<(&str, u8, Register), Vec<usize>> = HashMap::new();
        for (index, later) in claims.iter().enumerate() {
            let mut earlier = BTreeSet::new();
            for register in later.registers() {
                let there = claimed.entry((&later.device.0, later.device.1, register)).or_default();
                earlier.extend(there.iter().copied());
                there.push(index);
            }
            for earlier in earlier {
                self.collision(&claims[earlier], later);
            }
        }
        self.runaway(signals, outputs, &claims);
    }

    fn collision(&mut self, earlier: &Claim, later: &Claim) {
        let both_write = earlier.written && later.written;
        if !both_write && earlier.is_same_value(later) {
            return;
        }
        let there = self.places.line_of(&earlier.path);
        let verb = if both_write { "writes the same registers as" } else { "overlaps" };
        let message = format!("{} {verb} {} at {there}", later.shown(), earlier.shown());
        let help = if both_write {
            "one register has one writer: give each its own"
        } else {
            "two names for one value need the same register and the same type; else one of the two addresses is wrong"
        };
        self.wrong(&later.path, message, help);
    }

    /// A corrected position that is read back as the position grows by Cz at every write.
    fn runaway(&mut self, signals: &Signals, outputs: &[Option<Output>], claims: &[Claim]) {
        let by_path: HashMap<&str, &Claim> =
            claims.iter().rev().map(|claim| (claim.path.as_str(), claim)).collect();
        for output in outputs.iter().flatten() {
            let Writes::Corrected { position } = output.writes else { continue };
            let Some(signal) = get(signals, position.0) else { continue };
            let of =
                |table, name: &str| by_path.get(child(&child(table, name), "register").as_str()).copied();
            let read = of("signal", &signal.name);
            let written = of("output", &output.name);
            if let (Some(read), Some(written)) = (read, written)
                && read.overlaps(written)
            {
                let path = child(&child("output", &output.name), "register");
                let message = format!(
                    "the corrected position would overwrite {}, from which it is computed",
                    read.shown()
                );
                self.wrong(&path, message, "read the scale's own register; write another");
            }
        }
    }
}

/// What a set reads and writes besides its outputs: the key, what it is, where, and whether it is written.
fn words_of(set: &OutputSet) -> Vec<(String, String, Register, bool)> {
    let path = child(if set.is_named { "set" } else { "output" }, &set.name);
    let label = set.label();
    let of_set = [
        ("sequence", set.sequence),
        ("complement", set.complement),
        ("heartbeat", set.heartbeat),
        ("control", set.control),
        ("version", set.version.map(|(at, _)| at)),
    ];
    let handshake = set.handshake.map(|handshake| {
        [("strobe", handshake.strobe, true), ("acknowledge", handshake.acknowledge, false)].map(
            |(key, flag, written)| {
                let path = child(&child(&path, "handshake"), key);
                (path, format!("the {key} of {label}"), flag.address, written)
            },
        )
    });
    let of_set = of_set.into_iter().filter_map(|(key, address)| {
        Some((child(&path, key), format!("the {key} of {label}"), address?, true))
    });
    of_set.chain(handshake.into_iter().flatten()).collect()
}

//! Checks which tables of the profile use the same registers or OPC UA nodes. Registers of two tables may
//! overlap only if both tables name the same value, and at most one of them writes it. Two tables must not
//! write the same register or node.

use std::collections::hash_map::Entry;
use std::collections::{BTreeSet, HashMap, HashSet};

use super::heartbeat::Heartbeat;
use super::register::one;
use super::{Check, KeyContext};
use crate::DeviceId;
use isotherm_core::codec::{Address, DataType, NodeId, Register};

/// Indices of the claims on each register. The key is the address of the bus line, the Modbus unit identifier, and the
/// register.
type Claimed<'c> = HashMap<(&'c str, u8, Register), Vec<usize>>;

/// Claim on registers: one key of the profile names registers that the gateway reads or writes.
struct Claim<'c> {
    /// Address of the bus line, and Modbus unit identifier. Together they identify a physical device, which may have
    /// two names in the profile.
    device: (String, u8),
    address: Register,
    data_type: DataType,
    /// Context of the key that names the registers.
    at: KeyContext<'c>,
    what: String,
    is_written: bool,
}

impl Claim<'_> {
    fn last(&self) -> u32 {
        u32::from(self.address.offset) + u32::from(self.data_type.registers()) - 1
    }

    /// Iterates over the claimed registers. Registers beyond the last valid address are left out.
    fn registers(&self) -> impl Iterator<Item = Register> {
        let Register { table, offset } = self.address;
        (offset..=u16::try_from(self.last()).unwrap_or(u16::MAX))
            .map(move |offset| Register { table, offset })
    }

    fn overlaps(&self, other: &Claim<'_>) -> bool {
        self.device == other.device
            && self.address.table == other.address.table
            && u32::from(self.address.offset) <= other.last()
            && u32::from(other.address.offset) <= self.last()
    }

    fn is_same_value(&self, other: &Claim<'_>) -> bool {
        let is_part = |claim: &Claim<'_>| matches!(claim.data_type, DataType::Bit(_) | DataType::Part(_));
        let are_as_long = self.data_type.registers() == other.data_type.registers();
        self.address == other.address
            && (self.data_type == other.data_type || (are_as_long && (is_part(self) || is_part(other))))
    }

    fn shown(&self) -> String {
        let Register { table, offset } = self.address;
        let end = if self.data_type.registers() == 1 { String::new() } else { format!("..{}", self.last()) };
        format!("{} ({} at {}:{offset}{end})", self.what, self.data_type.name(), table.name())
    }
}

pub(super) fn check(check: &Check<'_>, heartbeat: Option<&Heartbeat>) {
    let mut claims = claims(check, heartbeat);
    // The later one of two keys gets the error.
    claims.sort_by_cached_key(|claim| check.report.spans.rank(&claim.at.path));
    let mut claimed = Claimed::new();
    for (index, later) in claims.iter().enumerate() {
        let mut earlier = BTreeSet::new();
        for register in later.registers() {
            let there = claimed.entry((&later.device.0, later.device.1, register)).or_default();
            earlier.extend(there.iter().copied());
            there.push(index);
        }
        for earlier in earlier {
            collision(&claims[earlier], later);
        }
    }
    runaway(check, &claims);
    overwritten_scales(check, &claims, &claimed);
}

fn claims<'c>(check: &'c Check<'c>, heartbeat: Option<&Heartbeat>) -> Vec<Claim<'c>> {
    let mut claims: Vec<Claim<'c>> = Vec::new();
    let mut claim = |id: DeviceId, address, data_type, at, what: String, is_written| {
        let device = check.devices.get(id.0);
        let line = device.and_then(|device| Some((check.bus_of(device)?.address.clone(), device.unit)));
        claims.extend(line.map(|device| Claim { device, address, data_type, at, what, is_written }));
    };
    let boot_counters: HashMap<usize, &str> = (check.outputs.resolved.iter().flatten().rev())
        .filter_map(|output| Some((output.boot_counter?.0, output.name.as_str())))
        .collect();
    let mut captured = HashSet::new();
    let (signal_at, output_at) =
        (|name: &str| check.at("signal").key(name), |name: &str| check.at("output").key(name));
    for (place, signal) in check.signals.resolved.iter().enumerate() {
        let Some(signal) = signal else { continue };
        let name = &signal.name;
        if let Address::Modbus(register) = signal.address {
            let (at, what) = match boot_counters.get(&place) {
                Some(output) => {
                    (output_at(output).key("restart").key("boot_counter"), "the boot counter".to_owned())
                }
                None => (signal_at(name).key("register"), format!("signal `{name}`")),
            };
            claim(signal.device, register, signal.encoding.data_type, at, what, false);
        }
        // Several counters of a device may be captured by one command.
        let mut is_first = |address| captured.insert((signal.device, address));
        if let Some(capture) = signal.capture.filter(|capture| is_first(capture.address)) {
            let at = signal_at(name).key("counter").key("capture").key("register");
            let what = format!("the capture command of `{name}`");
            claim(signal.device, capture.address, one(capture.address), at, what, true);
        }
    }
    for output in check.outputs.valid() {
        if let Address::Modbus(register) = output.address {
            let (at, what) = (output_at(&output.name).key("register"), format!("output `{}`", output.name));
            claim(output.device, register, output.encoding.data_type, at, what, true);
        }
    }
    for output in check.outputs.valid() {
        for address in output.display.registers() {
            let what = format!("the display of output `{}`", output.name);
            claim(output.device, address, DataType::U16, output_at(&output.name).key("beside"), what, true);
        }
    }
    for set in check.sets.valid() {
        let at = set.at(check);
        let what = |key: &str| format!("the {key} of {}", set.label());
        for (key, address) in set.own().filter_map(|(key, at)| Some((key, at.register()?))) {
            claim(set.device, address, one(address), at.key(key), what(key), true);
        }
        if let Some(handshake) = &set.handshake {
            let bits = [("strobe", &handshake.strobe, true), ("acknowledge", &handshake.acknowledge, false)];
            for (key, bit, is_written) in bits {
                let Some(register) = bit.address().register() else { continue };
                let at = at.key("handshake").key(key);
                claim(set.device, register, one(register), at, what(key), is_written);
            }
        }
    }
    if let Some(heartbeat) = heartbeat {
        let at = check.at("heartbeat").key("register");
        if let Some(register) = heartbeat.address.register() {
            claim(heartbeat.device, register, DataType::U16, at, "the heartbeat".to_owned(), true);
        }
    }
    claims
}

fn collision(earlier: &Claim<'_>, later: &Claim<'_>) {
    let both_write = earlier.is_written && later.is_written;
    if !both_write && earlier.is_same_value(later) {
        return;
    }
    let (verb, help) = if both_write {
        ("writes the same registers as", "a register must have one writer: give each its own register")
    } else {
        (
            "overlaps",
            "two names for one value need the same register and the same type; otherwise one of the \
             addresses is wrong",
        )
    };
    let message = format!("{} {verb} {} at {}", later.shown(), earlier.shown(), earlier.at.line());
    later.at.invalid(message, help);
}

/// Reports an output that would write a position plus Cz into the registers from which the position is read. The
/// position would grow by Cz with every write.
fn runaway(check: &Check<'_>, claims: &[Claim<'_>]) {
    let by_path: HashMap<&str, &Claim<'_>> =
        claims.iter().rev().map(|claim| (claim.at.path.as_str(), claim)).collect();
    for output in check.outputs.valid() {
        let Some(position) = output.writes.position() else { continue };
        let Some(signal) = check.signals.get(position.0) else { continue };
        let of =
            |table, name: &str| by_path.get(check.at(table).key(name).key("register").path.as_str()).copied();
        if let Some((read, written)) = of("signal", &signal.name).zip(of("output", &output.name))
            && read.overlaps(written)
        {
            let message =
                format!("the corrected position would overwrite {}, from which it is computed", read.shown());
            written.at.invalid(message, "read the register of the linear scale, and write another register");
        }
    }
}

/// Reports tables that write a register from which a signal's scale is read.
fn overwritten_scales(check: &Check<'_>, claims: &[Claim<'_>], claimed: &Claimed<'_>) {
    for signal in check.signals.valid() {
        let Some(from) = &signal.scale_from else { continue };
        let device = check.devices.get(signal.device.0);
        let line = device.and_then(|device| Some((check.bus_of(device)?.address.as_str(), device.unit)));
        let there = line.and_then(|(address, unit)| claimed.get(&(address, unit, from.address)));
        let mut there = there.into_iter().flatten().map(|index| &claims[*index]);
        if let Some(written) = there.find(|claim| claim.is_written) {
            let scale = format!("the scale of signal `{}` at {}", signal.name, from.address);
            let message = format!("{} would overwrite {scale}", written.shown());
            written.at.invalid(message, "one of the two addresses is wrong: correct it");
        }
    }
}

/// OPC UA node that a table of the profile writes.
struct Written<'c> {
    /// Address of the server. It identifies the server, which may have two device names in the profile.
    server: String,
    node: NodeId,
    /// Context of the key that names the node.
    at: KeyContext<'c>,
    what: String,
}

/// Reports nodes that two tables write.
pub(super) fn one_writer_each(check: &Check<'_>, heartbeat: Option<&Heartbeat>) {
    let mut written = written(check, heartbeat);
    // The later one of two keys gets the error.
    written.sort_by_cached_key(|written| check.report.spans.rank(&written.at.path));
    let mut writers: HashMap<(&str, &NodeId), &str> = HashMap::new();
    for later in &written {
        match writers.entry((&later.server, &later.node)) {
            Entry::Occupied(first) => {
                let message = format!("{} writes this node already", first.get());
                later.at.invalid(message, "a node must have one writer: give each its own node");
            }
            Entry::Vacant(free) => {
                free.insert(&later.what);
            }
        }
    }
}

fn written<'c>(check: &'c Check<'c>, heartbeat: Option<&Heartbeat>) -> Vec<Written<'c>> {
    let mut all = Vec::new();
    let mut writes = |device: DeviceId, address: &Address, at: KeyContext<'c>, what: String| {
        let bus = check.devices.get(device.0).and_then(|device| check.bus_of(device));
        let named = bus.map(|bus| bus.address.clone()).zip(address.node());
        all.extend(named.map(|(server, node)| Written { server, node: node.id.clone(), at, what }));
    };
    for output in check.outputs.valid() {
        let at = check.at("output").key(&output.name).key("node");
        writes(output.device, &output.address, at, format!("output `{}`", output.name));
    }
    for set in check.sets.valid() {
        let at = set.at(check);
        for (key, address) in set.own() {
            writes(set.device, &address, at.key(key).key("node"), format!("the {key} of {}", set.label()));
        }
        if let Some(handshake) = &set.handshake {
            let at = at.key("handshake").key("strobe").key("node");
            writes(
                set.device,
                &handshake.strobe.address(),
                at,
                format!("the strobe signal of {}", set.label()),
            );
        }
    }
    if let Some(heartbeat) = heartbeat {
        let at = check.at("heartbeat").key("node");
        writes(heartbeat.device, &heartbeat.address, at, "the heartbeat".to_owned());
    }
    all
}

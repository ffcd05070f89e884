//! Which registers belong to whom: two things may not half share one.

use super::{Check, Signals, get};
use crate::codec::{Address, DataType};
use crate::profile::place::child;
use crate::profile::{Bus, Device, DeviceId, Heartbeat, Output, Writes};

/// A stretch of registers that something reads or writes.
struct Claim {
    /// The line's address and the unit: the same device may have two names.
    device: (String, u8),
    address: Address,
    data_type: DataType,
    path: String,
    what: String,
    written: bool,
}

impl Claim {
    fn last(&self) -> u32 {
        u32::from(self.address.offset) + u32::from(self.data_type.registers()) - 1
    }

    fn overlaps(&self, other: &Claim) -> bool {
        self.device == other.device
            && self.address.table == other.address.table
            && u32::from(self.address.offset) <= other.last()
            && u32::from(other.address.offset) <= self.last()
    }

    fn is_same_value(&self, other: &Claim) -> bool {
        self.address == other.address && self.data_type == other.data_type
    }

    fn shown(&self) -> String {
        let Address { table, offset } = self.address;
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
        for signal in signals.iter().flatten() {
            let (path, what) = (child("signal", &signal.name), format!("signal `{}`", signal.name));
            claims.extend(claim(signal.device, signal.address, signal.encoding.data_type, path, what, false));
        }
        for output in outputs.iter().flatten() {
            let (path, what) = (child("output", &output.name), format!("output `{}`", output.name));
            claims.extend(claim(output.device, output.address, output.encoding.data_type, path, what, true));
        }
        if let Some(heartbeat) = heartbeat {
            let (path, what) = ("heartbeat".to_owned(), "the heartbeat".to_owned());
            claims.extend(claim(heartbeat.device, heartbeat.address, DataType::U16, path, what, true));
        }
        // The later of two is the one to blame.
        claims.sort_by_key(|claim| self.places.rank(&child(&claim.path, "register")));
        for (index, later) in claims.iter().enumerate() {
            for earlier in claims[..index].iter().filter(|earlier| later.overlaps(earlier)) {
                self.collision(earlier, later);
            }
        }
        self.runaway(signals, outputs, &claims);
    }

    fn collision(&mut self, earlier: &Claim, later: &Claim) {
        let both_write = earlier.written && later.written;
        if !both_write && earlier.is_same_value(later) {
            return;
        }
        let there = self.places.line_of(&child(&earlier.path, "register"));
        let verb = if both_write { "writes the same registers as" } else { "overlaps" };
        let message = format!("{} {verb} {} at {there}", later.shown(), earlier.shown());
        let help = if both_write {
            "one register has one writer: give each its own"
        } else {
            "two names for one value need the same register and the same type; else one of the two addresses is wrong"
        };
        self.wrong(&child(&later.path, "register"), message, help);
    }

    /// A corrected position that is read back as the position grows by Cz at every write.
    fn runaway(&mut self, signals: &Signals, outputs: &[Option<Output>], claims: &[Claim]) {
        for output in outputs.iter().flatten() {
            let Writes::Corrected { position } = output.writes else { continue };
            let Some(signal) = get(signals, position.0) else { continue };
            let of = |path: String| claims.iter().find(|claim| claim.path == path);
            let read = of(child("signal", &signal.name));
            let written = of(child("output", &output.name));
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

//! Checks the keys of each line, and compares the lines with each other.

use std::collections::HashMap;
use std::time::Duration;

use super::periods::{Due, TIMEOUT};
use super::transport::LATE;
use super::{APART, Bus, LineSettings, RawBus};
use crate::duration::{Timespan, shown};
use crate::kinds::modbus::quirks::Quirks;
use crate::tables::{Check, KeyContext};

const LONGEST_LATE: Duration = Duration::from_mins(10);
/// Keys that only some types of lines have. Each group comes with the description of these types for messages.
const OWNERS: [(&[&str], &str); 8] = [
    (&["address"], "a TCP line"),
    (&["late"], "a line with writes"),
    (&["port", "baud", "parity", "stop_bits"], "a line with a serial port"),
    (&["data_bits"], "a serial-ascii or modbus-ascii line"),
    (&["tls", "pipeline"], "a modbus-tcp line"),
    (&["interface", "sync"], "a can line"),
    (&["security", "user", "cert", "key", "trusted"], "an opcua line"),
    (&["quirks"], "a Modbus line"),
];

impl RawBus {
    pub(crate) fn resolve(&self, check: &Check<'_>, at: &KeyContext<'_>, name: &str) -> Option<Bus> {
        let quirks =
            self.quirks.as_ref().map_or_else(Quirks::default, |quirks| quirks.over(Quirks::default()));
        let timeout = at.key("timeout").duration(self.timeout);
        let kind = check.kind_of_line(self);
        let usual = kind.filter(|_| self.kind.is_some()).and_then(|kind| kind.timeout);
        let timeout = timeout.or(usual).unwrap_or_else(|| check.periods.timeout(name));
        let Some((of, kind)) = self.kind.zip(kind) else {
            // The type has an error. The other keys are checked nevertheless.
            check.kinds.iter().for_each(|other| (other.line_without_type)(self, at, kind.is_some()));
            self.late(&at.key("late"), timeout, LATE.max(timeout));
            return None;
        };
        foreign_keys(at, kind.line_type(of).map_or(&[], |known| known.keys));
        let (transport, address) = (kind.line)(self, at, of)?;
        let late = self.late(&at.key("late"), timeout, transport.late(timeout));
        let LineSettings { tls, opcua, sync } = (kind.settings)(self, at, of, address.as_deref())?;
        let pipeline = self.pipeline(&at.key("pipeline"), quirks);
        Some(Bus {
            name: name.to_owned(),
            transport,
            address: address?,
            tls: tls.map(Box::new),
            opcua: opcua.map(Box::new),
            timeout,
            late,
            pipeline,
            quirks,
            sync,
        })
    }

    fn pipeline(&self, at: &KeyContext<'_>, quirks: Quirks) -> u8 {
        let pipeline = self.pipeline.unwrap_or(1);
        if !(1..=2).contains(&pipeline) {
            at.invalid(format!("{pipeline} is not possible"), "write 1 or 2");
        }
        if pipeline > 1 && !quirks.support_two() {
            at.invalid(APART, "remove `pipeline`, or the quirk of this bus");
        }
        pipeline
    }

    fn late(&self, at: &KeyContext<'_>, timeout: Duration, default: Duration) -> Duration {
        let Some(late) = at.duration(self.late) else { return default };
        let left_out = format!("or remove `late` (default {})", shown(default));
        if late < timeout {
            let (late, timeout) = (shown(late), shown(timeout));
            let message = format!("{late} is shorter than `timeout`, which is {timeout}");
            at.invalid(message, format!("write {timeout} or more, {left_out}"));
        } else if late > LONGEST_LATE {
            let (late, longest) = (shown(late), shown(LONGEST_LATE));
            let message =
                format!("{late} is longer than {longest}: a lost answer could stop an axis for this time");
            at.invalid(message, format!("write {longest} or less, {left_out}"));
        }
        late
    }
}

/// Reports keys that belong to another type of line. `own` lists the keys of this line's type.
fn foreign_keys(at: &KeyContext<'_>, own: &[&str]) {
    for (keys, owner) in OWNERS {
        let foreign: Vec<&str> = keys.iter().copied().filter(|key| !own.contains(key)).collect();
        at.not_applicable(&foreign, owner, "remove this key, or change `type`");
    }
}

/// Warns if the timeout is as long as the shortest period on the line, because a lost answer then delays further
/// exchanges. The profile stays valid, because overdue exchanges are skipped.
pub(in crate::tables) fn none_waits_for_a_period(check: &Check<'_>) {
    for (name, bus) in &check.raw.bus {
        let at = check.at("bus").key(name).key("timeout");
        let Some(timeout) = bus.timeout.map(|Timespan(timeout)| timeout) else { continue };
        let of_line = check.periods.of(name).iter();
        let mut due: Vec<&Due> = of_line.filter(|(_, every)| *every <= timeout).collect();
        due.sort_by_key(|(_, every)| *every);
        let Some((_, shortest)) = due.first() else { continue };
        let shortest = shown(*shortest);
        let due: Vec<String> =
            due.into_iter().map(|(what, every)| format!("{what} {}", shown(*every))).collect();
        let message = format!("`timeout` is {}, but {}", shown(timeout), due.join(", "));
        let help = format!(
            "write a `timeout` shorter than {shortest}, or remove this key (default: half the shortest \
             period, at most {}). During the wait for a lost answer, due reads and writes are skipped",
            shown(TIMEOUT)
        );
        at.warn(message, help);
    }
}

/// Reports two buses that use the same physical line. Two such buses would send at the same time, and receive each
/// other's answers.
pub(in crate::tables) fn one_owner_each(check: &Check<'_>) {
    let exclusive = |bus: &Bus| {
        let of = bus.transport.bus_type();
        check.kinds.iter().find_map(|kind| kind.line_type(of)?.exclusive)
    };
    let mut owners: HashMap<&str, &str> = HashMap::new();
    for (bus, key) in check.buses.valid().filter_map(|bus| exclusive(bus).map(|key| (bus, key))) {
        let first = *owners.entry(&bus.address).or_insert(&bus.name);
        if first != bus.name {
            let at = check.at("bus").key(&bus.name);
            // A line with frames or text has a port, or the address of a serial server.
            let key = if at.key("address").is_written() { "address" } else { key };
            let message = format!("the bus `{first}` already has this {key}");
            let help = "put all devices of one line on one bus; each has its own `every`";
            at.key(key).invalid(message, help);
        }
    }
}

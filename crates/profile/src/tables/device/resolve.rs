//! Resolves and checks a table `[device.*]`.

use super::{Device, DeviceParts, RawDevice};
use crate::BusId;
use crate::kinds::modbus::functions::Functions;
use crate::kinds::modbus::quirks::Quirks;
use crate::tables::bus::APART;
use crate::tables::bus::periods::EVERY;
use crate::tables::{Check, KeyContext, label};

impl RawDevice {
    pub(crate) fn resolve(&self, check: &Check<'_>, at: &KeyContext<'_>, name: &str) -> Option<Device> {
        if self.template.is_none() && at.key("template").is_left_out() {
            let help = "write template = \"…\" as well, or remove this key";
            at.not_applicable(&["variant", "sha256", "base", "expect"], "a device template", help);
        }
        let every = at.key("every").period(self.every).unwrap_or(EVERY);
        if self.functions.as_ref().is_some_and(Vec::is_empty) {
            let help = "write the allowed functions, as [\"read-holding\", \"write-multiple\"], or remove \
                        the key to allow all";
            at.key("functions").invalid("a device without an allowed function cannot be used", help);
        }
        let functions = self.functions.as_deref().map_or(Functions::ALL, Functions::of);
        let bus = at.key("bus").named(&check.buses.names, self.bus.as_ref());
        let line = bus.and_then(|bus| check.buses.get(bus));
        let over = line.map_or_else(Quirks::default, |line| line.quirks);
        let quirks = self.quirks.as_ref().map_or(over, |quirks| quirks.over(over));
        if line.is_some_and(|line| line.pipeline > 1 && line.quirks.support_two()) && !quirks.support_two() {
            at.key("quirks").invalid(APART, "remove the quirk, or `pipeline` of the bus");
        }
        let known = check.line_kind_of(self);
        if let Some(kind) = known {
            for (keys, owner, help) in kind.foreign_device_keys {
                at.not_applicable(keys, owner, help);
            }
            check.kinds_beside(kind).for_each(|other| (other.device_keys_elsewhere)(self, at));
        }
        if known.is_none() && !at.key("unit").is_written() {
            // The line has an error, so it is unknown whether its devices need a unit.
            return None;
        }
        let kind = known.unwrap_or(check.kinds[0]);
        let DeviceParts { unit, can, source_time, is_pc } = (kind.device)(check, self, at, line);
        let list = at.key("verify");
        let verify = self.verify.iter().flatten().enumerate();
        let verify = verify.filter_map(|(place, raw)| (kind.verify)(raw, &list.item(place), functions));
        let verify = verify.collect();
        let template = check.templates.get(name).cloned().map(Box::new);
        let (bus, unit) = (BusId(bus?), unit?);
        let label = label::resolve(&at.key("label"), self.label.as_ref());
        Some(Device {
            name: name.to_owned(),
            label,
            bus,
            unit,
            every,
            functions,
            quirks,
            verify,
            template,
            can,
            source_time,
            read: self.read.unwrap_or_default(),
            is_pc,
        })
    }
}

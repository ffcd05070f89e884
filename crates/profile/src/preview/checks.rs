//! Preview of the checks (`verify`) of a device that are repeated in operation. It states their periods, and
//! how far Cz (the compensation value) of an axis may change before a changed setting is detected.

use std::time::Duration;

use super::load::exchange_time;
use super::traffic::Exchange;
use crate::document::Section;
use crate::duration::shown;
use crate::kinds;
use crate::kinds::modbus::frames::read_cells;
use crate::members::Members;
use crate::tables::device::verify::Expected;
use crate::{BusId, Device, DeviceId, Profile};
use isotherm_core::compensation::model::Model;

/// Largest fraction of a line's time that the checks of its devices may take.
const SHARE: f64 = 0.01;

/// Returns the factor by which the periods of all checks on a line are extended, at least 1. With this factor, the
/// checks take at most 1 % of the line's time.
pub fn stretch(profile: &Profile, bus: BusId) -> f64 {
    let checks =
        profile.devices_on(bus).flat_map(|(id, device)| device.verify.iter().map(move |check| (id, check)));
    let share =
        checks.map(|(id, check)| time_of(profile, id, check).as_secs_f64() / check.every.as_secs_f64());
    (share.sum::<f64>() / SHARE).max(1.0)
}

/// Returns the period of a check, multiplied by the factor `stretch` of its line. An extended period is
/// rounded up to whole seconds.
pub fn period(check: &Expected, stretch: f64) -> Duration {
    if stretch <= 1.0 {
        return check.every;
    }
    let seconds = check.every.mul_f64(stretch);
    Duration::from_secs(seconds.as_secs() + u64::from(seconds.subsec_nanos() > 0))
}

/// Returns the names of the devices that answer requests but have no `verify`. A replaced device would not be detected.
pub(super) fn unidentified(profile: &Profile) -> Vec<&str> {
    let is_asked = |device: &Device| {
        let (kind, _) = kinds::of(profile.bus(device.bus).transport);
        (kind.can_be_identified)(device)
    };
    let devices = profile.devices.iter().filter(|device| is_asked(device) && device.verify.is_empty());
    devices.map(|device| device.name.as_str()).collect()
}

fn time_of(profile: &Profile, device: DeviceId, check: &Expected) -> Duration {
    let (question, answer) = read_cells(&check.address, check.encoding.data_type.registers());
    let asked = Exchange { device, per_second: 0.0, question, answer, writes: false };
    let owner = profile.device(device);
    exchange_time(profile.bus(owner.bus), owner, &asked)
}

/// Returns for each device the axes whose models use signals of this device.
pub(super) fn readers(profile: &Profile) -> Members {
    let pairs = profile.axes.iter().enumerate().flat_map(|(place, axis)| {
        let signals = axis.settings.models.iter().flat_map(Model::signals);
        signals.map(move |signal| (profile.signal(signal).device.0, place))
    });
    pairs.collect()
}

/// Returns the checks of a device with their actual periods, and a list of sentences. The sentences state how
/// far Cz may change before a changed setting is detected, for each axis that uses the device (`readers`).
pub(super) fn preview(
    profile: &Profile,
    (id, device): (DeviceId, &Device),
    readers: &Members,
) -> (Vec<Section>, Vec<String>) {
    let stretch = stretch(profile, device.bus);
    let checks = device.verify.iter().map(|check| check.preview(period(check, stretch))).collect();
    let Some(longest) = device.verify.iter().map(|check| period(check, stretch)).max() else {
        return (checks, Vec::new());
    };
    let bounds = readers.of(id.0).map(|axis| &profile.axes[axis]).map(|axis| {
        let guard = &axis.settings.guard;
        let moved = (guard.rate.get() * longest.as_secs_f64()).min(2.0 * guard.limit.get());
        format!(
            "settings that are changed in operation are detected within {}: until then, Cz of axis {} \
             changes by at most {:.1} µm",
            shown(longest),
            axis.settings.name,
            moved
        )
    });
    (checks, bounds.collect())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::parse;

    /// Creates a line at 9600 baud with this number of units, each with one check.
    fn line(units: usize, every: &str) -> Profile {
        let mut text = "[machine]\nname = \"line\"\n[bus.b]\ntype = \"modbus-rtu\"\nport = \
                        \"/dev/serial/by-id/usb-x\"\nbaud = 9600\n"
            .to_owned();
        for unit in 1..=units {
            text += &format!(
                "[device.m{unit}]\nbus = \"b\"\nunit = {unit}\nverify = [{{ register = \"holding:90\", \
                 equals = 1{every} }}]\n"
            );
        }
        let loaded = parse(Path::new("line.toml"), &text, &[], &[]);
        loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
    }

    fn periods(profile: &Profile) -> Vec<u64> {
        let stretch = stretch(profile, BusId(0));
        profile.devices.iter().map(|device| period(&device.verify[0], stretch).as_secs()).collect()
    }

    #[test]
    fn the_checks_of_a_line_take_at_most_one_percent_of_its_time() {
        // One exchange takes 34 ms, including the assumed answer time of a device.
        assert_eq!(periods(&line(8, "")), [60; 8]);
        for (units, every, shortest) in [(8, ", every = \"10s\"", 25), (32, "", 105)] {
            let periods = periods(&line(units, every));
            assert!(periods.iter().all(|period| (shortest..shortest + 5).contains(period)), "{periods:?}");
        }
    }

    #[test]
    fn a_device_that_no_check_identifies_is_named() {
        let text = "[machine]\nname = \"line\"\n[bus.b]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:502\"\n\
                    [device.one]\nbus = \"b\"\nunit = 1\n[device.two]\nbus = \"b\"\nunit = 2\n\
                    verify = [{ register = \"holding:90\", equals = 1 }]\n";
        let profile =
            parse(Path::new("two.toml"), text, &[], &[]).unwrap_or_else(|errors| panic!("{errors}")).profile;
        assert_eq!(unidentified(&profile), ["one"]);
    }
}

//! Resolves and checks a table `[signal.*]`.

use std::time::Duration;

use super::bad::sentinels_fit;
use super::limits::{DefaultLimits, RateValue};
use super::unit::Unit;
use super::{Located, PLACES, RawSignal, Signal};
use crate::duration::shown;
use crate::tables::device::Device;
use crate::tables::{Check, KeyContext, expression, label};
use crate::{DeviceId, ReadBy};

/// Largest age of a value from a subscription, in poll periods. Sampling, sending, requesting and using the
/// value may each take one period.
const SENT_WITHIN: u32 = 4;

impl RawSignal {
    pub(crate) fn resolve(&self, check: &Check<'_>, at: &KeyContext<'_>, name: &str) -> Option<Signal> {
        let index = at.key("device").named(&check.devices.names, self.device.as_ref());
        let device = index.and_then(|index| check.devices.get(index));
        if PLACES.into_iter().filter(|key| at.has(key)).count() > 1 {
            let help = "keep one of register, channel, dbc, pdo, sdo, frame, node, sensor, text";
            at.wrong_key("the signal is read from more than one place", help);
        }
        let known = check.line_kind(self.device.as_ref());
        if let Some((kind, device)) = known.zip(self.device.as_ref()) {
            let reported = (kind.check_signal)(self, at, device);
            for other in check.kinds_beside(kind) {
                let own = &other.signal_keys;
                let keys: Vec<&str> =
                    own.keys.iter().copied().filter(|key| !reported.contains(key)).collect();
                let help = own.help.map_or_else(|| (kind.signal_help)(device), str::to_owned);
                at.not_applicable(&keys, own.owner, &help);
            }
        }
        let kind = known.unwrap_or(check.kinds[0]);
        let has_place = (kind.has_place)(self);
        // Without its place, it is unknown whether the value arrives without a request, and so how old it may be.
        let max_age = if has_place { self.max_age(check, at, device) } else { None };
        let range = self.range.and_then(|range| range.resolve(&at.key("range")));
        let max_rate = self.max_rate.and_then(RateValue::number);
        let has_max_rate = max_rate.is_some();
        let max_rate = at.key("max_rate").positive(max_rate);
        let fault_when = expression::condition(&at.key("fault_when"), self.fault_when.as_ref(), Some(name));
        if !has_place && at.key("channel").is_written() {
            // A channel without an address has been reported.
            return None;
        }
        let Located { address, encoding, unit, scale_from } = (kind.signal)(check, self, at, device)?;
        let unit = match self.unit.as_deref() {
            Some(unit) => Unit::named(unit),
            None => unit.or(Some(Unit("1"))),
        };
        sentinels_fit(&at.key("bad"), &encoding);
        let is_difference = self.is_difference(&at.key("difference"), unit);
        let every = device.map_or(Duration::ZERO, |device| device.every);
        // A value that arrives without a request must arrive twice before it is stale.
        let apart = max_age.filter(|_| (kind.comes_by_itself)(self)).map_or(every, |age| every.min(age / 2));
        let place = at.key("counter");
        let counter = self.counter.as_ref();
        let counter = counter.map(|raw| raw.resolve(&place, &encoding, device, apart, has_max_rate));
        let (counter, capture) = counter.unwrap_or_default();
        Some(Signal {
            name: name.to_owned(),
            label: label::resolve(&at.key("label"), self.label.as_ref()),
            device: DeviceId(index?),
            address,
            encoding,
            scale_from: scale_from.map(Box::new),
            unit: unit?,
            range,
            max_rate,
            // The models that use the signal are resolved later.
            defaults: DefaultLimits::default(),
            is_difference,
            max_age: max_age?,
            fault_when: fault_when.map(Box::new),
            merge: !kind.has_registers || self.merge.unwrap_or(true),
            counter,
            capture: capture.filter(|_| kind.has_registers),
        })
    }

    fn max_age(&self, check: &Check<'_>, at: &KeyContext<'_>, device: Option<&Device>) -> Option<Duration> {
        let at = at.key("max_age");
        let given = at.duration(self.max_age);
        let device = device?;
        let every = device.every;
        let Some(age) = given else {
            let timeout = check.bus_of(device).map_or(Duration::ZERO, |bus| bus.timeout);
            return Some((5 * every).max(3 * timeout));
        };
        if check.kinds.iter().any(|kind| (kind.comes_by_itself)(self)) {
            return Some(age);
        }
        let figures = format!(
            "`max_age` is {}, and device `{}` is read every {}",
            shown(age),
            device.name,
            shown(every)
        );
        if device.read == ReadBy::Subscription && age < SENT_WITHIN * every {
            let help = format!(
                "write max_age = \"{}\", or write read = \"poll\" at the device",
                shown((SENT_WITHIN + 1) * every)
            );
            let message = format!("{figures}: a value from a subscription may be {SENT_WITHIN} periods old");
            return at.reject(message, help);
        }
        let help = format!("allow at least two polls: write max_age = \"{}\"", shown(2 * every));
        if age <= every {
            at.invalid(format!("{figures}: the signal would always become stale"), help);
        } else if age < 2 * every {
            at.warn(format!("{figures}: one late answer makes the signal stale"), help);
        }
        Some(age)
    }
}

//! Table of signals: the latest reading of each signal, whether the reading may be used, and since when the signal is
//! bad.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use isotherm_core::codec::{Motion, Tracked};
use isotherm_core::continuity::{RateFault, RateFilter};
use isotherm_core::explained::Cause;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Quality, Reading, Reason, SignalId};
use isotherm_profile::{DeviceId, Profile};
use serde::{Deserialize, Serialize};

/// Consecutive steps with a new reason before a bad signal is reported with that reason.
const CHANGED_AFTER_STEPS: u32 = 2;

#[derive(Debug)]
pub(in crate::gateway) struct SignalTable {
    latest: Latest,
    /// Filter of the rate of change of each signal.
    rates: Vec<RateFilter>,
    /// Last value of each signal as it was read.
    read: Vec<Option<(Result<f64, Reason>, Moment)>>,
    /// Positions of the counters, with their rollovers.
    tracked: Vec<Tracked>,
    /// Positions before and after a counter was set to another value, until the change is reported.
    rereferenced: Vec<Option<(f64, f64)>>,
    /// Readings of the last step, after the check of their age and of `fault_when`. Each step refills them without
    /// reallocation.
    seen: Vec<Reading>,
    /// Since when and why each signal is bad.
    bad: Vec<Option<BadSignal>>,
}

/// Cause of a signal that is bad, and the time since when it is bad.
#[derive(Debug)]
struct BadSignal {
    cause: Cause<Reason>,
    since: Moment,
    /// Whether the bad signal was reported. A device or line that does not answer is reported separately.
    is_reported: bool,
}

/// Last good value of a signal, and the age of the value when it was saved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct LastGood {
    pub(in crate::gateway) value: f64,
    pub(in crate::gateway) age: Duration,
}

/// Latest readings, and their quality at any moment.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct Latest {
    profile: Arc<Profile>,
    /// Readings as the lines store them.
    readings: Vec<Reading>,
    /// Reason why the latest reads of each signal failed. The last value is used until it is stale.
    failing: Vec<Option<Reason>>,
}

/// Change of the quality of a signal that must be reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::gateway) enum QualityChange {
    /// The signal cannot be used, for this reason.
    Lost(SignalId, Reason),
    /// The signal can be used again. It was bad since this moment.
    Back(SignalId, Moment),
    /// The counter was set to another value: the first position is now the second one, and nothing has moved.
    Rereferenced(SignalId, f64, f64),
}

impl SignalTable {
    pub(in crate::gateway) fn new(profile: &Arc<Profile>) -> SignalTable {
        let signals = profile.signals.len();
        SignalTable {
            latest: Latest {
                profile: profile.clone(),
                readings: vec![Reading::NEVER; signals],
                failing: vec![None; signals],
            },
            rates: vec![RateFilter::default(); signals],
            read: vec![None; signals],
            tracked: vec![Tracked::default(); signals],
            rereferenced: vec![None; signals],
            seen: vec![Reading::NEVER; signals],
            bad: (0..signals).map(|_| None).collect(),
        }
    }

    /// Starts the rate filters with the last good values of the previous run, by signal name. Signals without a limit of
    /// the rate and signals of devices with checks are left out.
    pub(in crate::gateway) fn recall(&mut self, values: &BTreeMap<String, LastGood>, start: Moment) {
        let profile = &self.latest.profile;
        for (place, signal) in profile.signals.iter().enumerate() {
            if profile.device(signal.device).is_checked() || signal.rate_limit().is_none() {
                continue;
            }
            if let Some(LastGood { value, age }) = values.get(&signal.name) {
                self.rates[place] = RateFilter::after_start(*value, start, *age);
            }
        }
    }

    /// Returns the last good value of each signal that has a limit of the rate, by name.
    pub(in crate::gateway) fn last_good(&self, now: Moment) -> BTreeMap<String, LastGood> {
        let signals = self.latest.profile.signals.iter().zip(&self.rates);
        let good = signals.filter_map(|(signal, filter)| {
            let (value, age) = filter.before_stop(now, signal.rate_limit()?)?;
            Some((signal.name.clone(), LastGood { value, age }))
        });
        good.collect()
    }

    /// Stores a value from a line. The value is good if it is within the range of the signal. It must also not differ
    /// from the last good value by more than its rate allows. Values before and after a break of the device's
    /// continuity are compared too. `breaks`: number of breaks so far.
    pub(in crate::gateway) fn store(
        &mut self,
        id: SignalId,
        value: Result<f64, Reason>,
        at: Moment,
        breaks: u64,
    ) {
        self.latest.failing[id.0] = None;
        self.read[id.0] = Some((value, at));
        let position = value.and_then(|value| self.position(id, value, at));
        let signal = self.latest.profile.signal(id);
        let assessed = position.and_then(|value| {
            if !signal.is_plausible(value) {
                return Err(Reason::OutOfRange);
            }
            match self.rates[id.0].assess(value, at, signal.rate_limit(), breaks) {
                Ok(()) => Ok(value),
                Err(RateFault::TooFast) => Err(Reason::TooFast),
                Err(RateFault::Jumped) => Err(Reason::Jumped),
            }
        });
        self.latest.readings[id.0] = match assessed {
            Ok(value) => Reading::good(value, at),
            Err(reason) => Reading::bad(at, reason),
        };
    }

    /// Stores a value that may be the answer to a request of another master. The value is used only if it agrees with
    /// the value read before it: within the `max_rate` of the profile, or exactly if there is none. The default is too
    /// wide to distinguish two masters. Otherwise the last good value is used until it is stale.
    pub(in crate::gateway) fn store_ambiguous(
        &mut self,
        id: SignalId,
        value: Result<f64, Reason>,
        at: Moment,
        breaks: u64,
    ) {
        let (rate, max_age) =
            (self.latest.profile.signal(id).max_rate, self.latest.profile.signal(id).max_age);
        let before = self.read[id.0].replace((value, at)).filter(|(_, taken)| at.since(*taken) <= max_age);
        let agrees = match (value, before, rate) {
            (Ok(value), Some((Ok(before), taken)), Some(rate)) => {
                !is_too_fast((value, at), (before, taken), rate)
            }
            (value, Some((before, _)), _) => value == before,
            (_, None, _) => false,
        };
        if agrees {
            self.store(id, value, at, breaks);
        } else {
            self.fail(id, Reason::BadReply);
        }
    }

    /// Marks the last reading as doubtful: it may be the answer to a request of another master that was detected after
    /// it. Without a `max_rate` of the profile no check has confirmed the reading, so it is rejected.
    pub(in crate::gateway) fn doubt(&mut self, id: SignalId) {
        let reading = &mut self.latest.readings[id.0];
        if reading.quality == Quality::Good && self.latest.profile.signal(id).max_rate.is_none() {
            *reading = Reading::bad(reading.at, Reason::BadReply);
        }
        self.read[id.0] = None;
    }

    /// Discards two answers of which one may belong to another master. The last good value is used until it is stale.
    pub(in crate::gateway) fn store_contested(&mut self, id: SignalId) {
        self.read[id.0] = None;
        self.fail(id, Reason::BadReply);
    }

    /// Returns the position of a counter with its rollovers. Any other value is returned unchanged.
    fn position(&mut self, id: SignalId, value: f64, at: Moment) -> Result<f64, Reason> {
        let signal = self.latest.profile.signal(id);
        let Some(counter) = &signal.counter else { return Ok(value) };
        match self.tracked[id.0].take(counter, &signal.encoding, value, at) {
            Motion::To(position) => Ok(position),
            Motion::Doubtful => Err(Reason::TooFast),
            Motion::Rereferenced { from, to } => {
                let from = self.rereferenced[id.0].map_or(from, |(first, _)| first);
                self.rereferenced[id.0] = Some((from, to));
                Ok(to)
            }
        }
    }

    /// Accepts the next values of the signals of a device that the operator has confirmed. Returns the names of the
    /// signals that had jumped.
    pub(in crate::gateway) fn confirm(&mut self, device: DeviceId) -> Vec<String> {
        let profile = self.latest.profile.clone();
        let of_device = profile.signals_of(device).filter(|(id, _)| self.rates[id.0].has_jumped());
        let jumped: Vec<(SignalId, String)> =
            of_device.map(|(id, signal)| (id, signal.name.clone())).collect();
        jumped.iter().for_each(|(id, _)| self.rates[id.0].forget());
        jumped.into_iter().map(|(_, name)| name).collect()
    }

    /// Records a failed attempt to read a signal. One lost answer is no fault: the last value is used until it is
    /// stale.
    pub(in crate::gateway) fn fail(&mut self, id: SignalId, reason: Reason) {
        self.latest.failing[id.0] = Some(reason);
    }

    /// Marks all good readings as stale after a pause of the computer. Counters and reports continue.
    pub(in crate::gateway) fn forget(&mut self) {
        for reading in &mut self.latest.readings {
            if reading.quality == Quality::Good {
                *reading = Reading::bad(reading.at, Reason::Stale);
            }
        }
    }

    pub(in crate::gateway) fn taken(&self, id: SignalId) -> Moment {
        self.latest.taken(id)
    }

    pub(in crate::gateway) fn latest(&self) -> &Latest {
        &self.latest
    }

    /// Returns the last moment at which the latest reading of the signal may be used.
    pub(in crate::gateway) fn usable_until(&self, id: SignalId) -> Moment {
        self.taken(id).after(self.latest.profile.signal(id).max_age)
    }

    /// Updates all readings for `now`. A reading that is too old becomes stale. A reading whose `fault_when` is true or
    /// unknown is rejected.
    pub(in crate::gateway) fn check(&mut self, now: Moment) -> &[Reading] {
        for place in 0..self.seen.len() {
            self.seen[place] = self.latest.assess(SignalId(place), now);
        }
        &self.seen
    }

    /// Returns the readings of the last call of `check`.
    pub(in crate::gateway) fn seen(&self) -> &[Reading] {
        &self.seen
    }

    /// Returns whether any reading may be used at `now`.
    pub(in crate::gateway) fn has_usable(&self, now: Moment) -> bool {
        (0..self.seen.len()).any(|place| self.value(SignalId(place), now).is_some())
    }

    /// Returns the value of a signal at `now`, if it may be used.
    pub(in crate::gateway) fn value(&self, id: SignalId, now: Moment) -> Option<f64> {
        self.latest.assess(id, now).usable()
    }

    /// Returns the changes of quality since the last call.
    pub(in crate::gateway) fn changes(&mut self, now: Moment) -> Vec<QualityChange> {
        let mut changes = Vec::new();
        for (place, reading) in self.seen.iter().enumerate() {
            if let Some((from, to)) = self.rereferenced[place].take() {
                changes.push(QualityChange::Rereferenced(SignalId(place), from, to));
            }
            let is_of_the_device =
                |reason| matches!(reason, Reason::LinkDown | Reason::Timeout | Reason::BadReply);
            match (reading.quality, &mut self.bad[place]) {
                (Quality::Good, bad) => {
                    let ended = bad.take().filter(|bad| bad.is_reported);
                    changes.extend(ended.map(|bad| QualityChange::Back(SignalId(place), bad.since)));
                }
                (Quality::Bad(Reason::NeverRead), _) => {}
                (Quality::Bad(reason), Some(bad)) => {
                    if bad.cause.is_now(reason, CHANGED_AFTER_STEPS)
                        && (bad.is_reported || !is_of_the_device(reason))
                    {
                        bad.is_reported = true;
                        changes.push(QualityChange::Lost(SignalId(place), reason));
                    }
                }
                (Quality::Bad(reason), bad) => {
                    let is_reported = !is_of_the_device(reason);
                    *bad = Some(BadSignal { cause: Cause::new(reason), since: now, is_reported });
                    changes.extend(is_reported.then_some(QualityChange::Lost(SignalId(place), reason)));
                }
            }
        }
        changes
    }
}

/// Returns whether a value has changed faster than `rate` allows since the value before.
fn is_too_fast((value, at): (f64, Moment), (before, taken): (f64, Moment), rate: f64) -> bool {
    // At least one second: noise between two polls in quick succession must not look fast.
    let seconds = at.since(taken).as_secs_f64().max(1.0);
    (value - before).abs() > rate * seconds
}

impl Latest {
    pub(in crate::gateway) fn taken(&self, id: SignalId) -> Moment {
        self.readings[id.0].at
    }

    /// Returns all readings at `now`. A reading that is too old is stale. A reading whose `fault_when` is true or
    /// unknown is rejected.
    pub(in crate::gateway) fn at(&self, now: Moment) -> Vec<Reading> {
        (0..self.readings.len()).map(|place| self.assess(SignalId(place), now)).collect()
    }

    fn assess(&self, id: SignalId, now: Moment) -> Reading {
        let plain = |id: SignalId| self.readings[id.0].aged(now, self.profile.signal(id).max_age);
        let reading = plain(id);
        match (reading.quality, self.failing[id.0], &self.profile.signal(id).fault_when) {
            (Quality::Bad(Reason::Stale | Reason::NeverRead), Some(reason), _) => {
                Reading { quality: Quality::Bad(reason), ..reading }
            }
            (Quality::Good, _, Some(condition))
                if condition.holds(&|id| plain(id).usable()) != Some(false) =>
            {
                Reading::bad(reading.at, Reason::FaultBit)
            }
            _ => reading,
        }
    }
}

#[cfg(test)]
mod tests;

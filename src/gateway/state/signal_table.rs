//! Table of signals: the latest reading of each signal, whether the reading may be used, and the beginning of each
//! fault.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use super::scales::{ScalePlace, SignalScale};
use isotherm_core::codec::{Encoded, Motion, Tracked};
use isotherm_core::compensation::model::Condition;
use isotherm_core::continuity::{RateFault, RateFilter};
use isotherm_core::explained::Cause;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::{Quality, Reading, Reason, SignalId};
use isotherm_profile::{DeviceId, Profile, Signal};
use serde::{Deserialize, Serialize};

/// Number of consecutive steps with a new reason, after which the new reason of a bad signal is reported.
const CHANGED_AFTER_STEPS: u32 = 2;
/// Number of consecutive ambiguous values that must agree before the last of these values is used. An
/// ambiguous value may be the answer to a request of another master.
const AGREEING: u32 = 2;
/// Number of consecutive ambiguous values that must agree, if a signal with `max_rate` has no recent good
/// value. Answers to the other master also agree with each other, and no good value shows that they are
/// wrong. During so many reads, a value of the signal itself is likely to interrupt the series. After as many
/// good values, the last good value remains in use when another master is detected.
pub(in crate::gateway) const MANY: u32 = 30;

/// Table of all signals of the profile. Each list contains one item for each signal, in the order of the profile.
#[derive(Debug)]
pub(in crate::gateway) struct SignalTable {
    latest: Latest,
    /// Filter of each signal, which rejects a value that has changed too fast since the last good value.
    rates: Vec<RateFilter>,
    /// Last value that the gateway read for each signal, before any check, with its time.
    read: Vec<Option<LastRead>>,
    /// Length of the present series of good values of each signal. A good value continues the series if it is
    /// at most `max_age` later than the previous good value. Rejected values in between neither count nor end
    /// the series.
    chains: Vec<u32>,
    /// State of each signal that is a counter; `None` for other signals.
    counters: Vec<Option<Box<CounterState>>>,
    /// Scale of each signal whose scale is in another register. `None` for other signals, and before the first read.
    scales: Vec<Option<Box<SignalScale>>>,
    /// Readings of the last step, after the check of their age and of `fault_when`. Each step overwrites them in the
    /// same memory.
    seen: Vec<Reading>,
    /// Cause and beginning of the fault of each bad signal; `None` for a good signal.
    bad: Vec<Option<Box<BadSignal>>>,
}

/// State of one counter, for example of a scale that counts steps.
#[derive(Debug, Default)]
struct CounterState {
    /// State of the conversion from counts to a position. The conversion adds the rollovers of the counter (restarts
    /// after the highest count).
    tracked: Tracked,
    /// Positions before and after the counter was set to another value without a movement. `None` if no such change
    /// must be reported.
    rereferenced: Option<(f64, f64)>,
}

/// Value of a signal before any check.
#[derive(Clone, Copy, Debug)]
struct LastRead {
    value: Result<f64, Reason>,
    at: Moment,
    /// Length of the series that ends with this value. In a series, each value agrees with the previous
    /// value.
    agreeing: u32,
}

/// Cause of a signal's fault, and the time at which the fault began.
#[derive(Debug)]
struct BadSignal {
    cause: Cause<Reason>,
    since: Moment,
    /// Whether the fault of the signal was reported. If the device or the bus does not answer, only the device or bus
    /// is reported.
    is_reported: bool,
}

/// Last good value of a signal in the saved state, and the age of the value at the time of saving.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::gateway) struct LastGood {
    pub(in crate::gateway) value: f64,
    pub(in crate::gateway) age: Duration,
    /// Power of ten of the scale, if the scale is in another register. `None` for a fixed scale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(in crate::gateway) exponent: Option<i8>,
}

/// Settings of one signal that are needed for each reading, copied from the profile. With many signals, each access
/// to the profile would miss the cache of the processor, because the signals are far apart in memory.
#[derive(Clone, Copy, Debug)]
struct SignalRules {
    max_age: Duration,
    /// Smallest and largest plausible value, in the unit of the signal.
    plausible: (f64, f64),
    rate_limit: Option<f64>,
    has_fault_condition: bool,
    has_scale: bool,
}

/// Latest readings of all signals, and functions for the quality of the readings at any time.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct Latest {
    profile: Arc<Profile>,
    rules: Arc<[SignalRules]>,
    /// Latest reading of each signal, as the task of its bus line has stored it.
    readings: Vec<Reading>,
    /// Reason why the latest reads of each signal failed; `None` after a successful read. The last value remains in
    /// use until it is too old.
    failing: Vec<Option<Reason>>,
}

/// Change of the quality of a signal that must be reported.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::gateway) enum QualityChange {
    /// The signal can no longer be used, for the contained reason.
    Lost(SignalId, Reason),
    /// The signal can be used again. The contained time is the beginning of its fault.
    Back(SignalId, Moment),
    /// The counter was set to another value although the machine did not move. Contains the positions before and
    /// after the change.
    Rereferenced(SignalId, f64, f64),
    /// The device has changed the scale of the signal. Contains the former and the new power of ten.
    ScaleChanged(SignalId, i8, i8),
}

impl SignalTable {
    pub(in crate::gateway) fn new(profile: &Arc<Profile>) -> SignalTable {
        let signals = profile.signals.len();
        let counter = |signal: &Signal| signal.counter.map(|_| Box::default());
        SignalTable {
            latest: Latest {
                profile: profile.clone(),
                rules: profile.signals.iter().map(SignalRules::of).collect(),
                readings: vec![Reading::NEVER; signals],
                failing: vec![None; signals],
            },
            rates: vec![RateFilter::default(); signals],
            read: vec![None; signals],
            chains: vec![0; signals],
            counters: profile.signals.iter().map(counter).collect(),
            scales: vec![None; signals],
            seen: vec![Reading::NEVER; signals],
            bad: (0..signals).map(|_| None).collect(),
        }
    }

    /// Starts the rate filters with the last good values of the previous run, by signal name. Signals without
    /// a rate limit are left out. Signals of a device with checks are left out, too, unless their scale is in
    /// another register, because the checks do not cover such a scale.
    pub(in crate::gateway) fn recall(&mut self, values: &BTreeMap<String, LastGood>, start: Moment) {
        let profile = &self.latest.profile;
        for (place, signal) in profile.signals.iter().enumerate() {
            let is_checked = profile.device(signal.device).is_checked() && signal.scale_from.is_none();
            if is_checked || signal.rate_limit().is_none() {
                continue;
            }
            if let Some(LastGood { value, age, exponent }) = values.get(&signal.name) {
                self.rates[place] = RateFilter::after_start(*value, start, *age);
                self.scales[place] = exponent.map(|_| Box::new(SignalScale::after_start(*exponent)));
            }
        }
    }

    /// Returns the last good value of each signal with a limit of its rate of change. The keys are the signal names.
    pub(in crate::gateway) fn last_good(&self, now: Moment) -> BTreeMap<String, LastGood> {
        let signals = self.latest.profile.signals.iter().zip(&self.rates).zip(&self.scales);
        let good = signals.filter_map(|((signal, filter), scale)| {
            let (value, age) = filter.before_stop(now, signal.rate_limit()?)?;
            let exponent = scale.as_ref().and_then(|scale| scale.exponent());
            Some((signal.name.clone(), LastGood { value, age, exponent }))
        });
        good.collect()
    }

    /// Stores a value that a line task has read. The value is good if it is within the range of the signal. In
    /// addition, its change since the last good value must be within the rate limit. This also applies if the
    /// device's continuity was broken between the two values. `breaks`: number of breaks so far.
    pub(in crate::gateway) fn store(
        &mut self,
        id: SignalId,
        value: Result<f64, Reason>,
        at: Moment,
        breaks: u64,
    ) {
        self.latest.failing[id.0] = None;
        self.read[id.0] = Some(LastRead { value, at, agreeing: 1 });
        let position = value.and_then(|value| self.position(id, value, at));
        let is_chained = self.is_good_recent(id, at);
        let (rules, scale) = (self.latest.rules[id.0], &mut self.scales[id.0]);
        let assessed = position.and_then(|value| {
            let breaks = scale.as_ref().map_or(breaks, |scale| scale.breaks(breaks));
            if !rules.is_plausible(value) {
                // With a new scale, a value out of range is a value too: a later one is not plausible by waiting.
                let is_open = scale.as_ref().is_some_and(|scale| scale.is_open());
                if let Some(rate) = rules.rate_limit.filter(|_| is_open) {
                    self.rates[id.0].reject(value, at, rate, breaks);
                }
                return Err(Reason::OutOfRange);
            }
            match self.rates[id.0].assess(value, at, rules.rate_limit, breaks) {
                Ok(()) => {
                    scale.iter_mut().for_each(|scale| scale.confirm());
                    Ok(value)
                }
                Err(RateFault::TooFast) => Err(Reason::TooFast),
                Err(RateFault::Jumped) => {
                    Err(scale.as_ref().map_or(Reason::Jumped, |scale| scale.why_jumped()))
                }
            }
        });
        self.latest.readings[id.0] = match assessed {
            Ok(value) => {
                self.chains[id.0] = if is_chained { self.chains[id.0].saturating_add(1) } else { 1 };
                Reading::good(value, at)
            }
            Err(reason) => Reading::bad(at, reason),
        };
    }

    /// Stores the scale exponent (power of ten) of a signal, and the value that has waited for the exponent.
    pub(in crate::gateway) fn store_scale(
        &mut self,
        id: SignalId,
        exponent: Result<i8, Reason>,
        breaks: u64,
    ) {
        let encoding = &self.latest.profile.signal(id).encoding;
        let scale = self.scales[id.0].get_or_insert_default();
        if let Some((value, at)) = scale.read(exponent, encoding, breaks) {
            self.store(id, value, at, breaks);
        }
    }

    /// Returns whether the scale of a signal is in another register.
    pub(in crate::gateway) fn has_scale(&self, id: SignalId) -> bool {
        self.latest.rules[id.0].has_scale
    }

    /// Stores the registers of a value whose scale is in another register.
    pub(in crate::gateway) fn store_scaled(
        &mut self,
        id: SignalId,
        raw: Result<Encoded, Reason>,
        at: Moment,
        breaks: u64,
        scale: ScalePlace,
    ) {
        let encoding = &self.latest.profile.signal(id).encoding;
        let state = self.scales[id.0].get_or_insert_default();
        match (raw, scale) {
            (Ok(raw), ScalePlace::OtherAnswer) => state.wait(raw, at, breaks),
            (Ok(raw), ScalePlace::SameAnswer) => {
                let value = state.value(raw, encoding);
                self.store(id, value, at, breaks);
            }
            (Err(reason), _) => {
                state.forget();
                self.store(id, Err(reason), at, breaks);
            }
        }
    }

    /// Stores a value that may be the answer to a request of another master. The value is used only if it
    /// agrees with the previous value. If the profile sets `max_rate`, and no good value is younger than
    /// `max_age`, [`MANY`] consecutive values must agree. Two values agree if their difference is within the
    /// `max_rate` of the profile. Without `max_rate` in the profile, they must be equal, because the default
    /// is too wide to distinguish two masters. Until enough values agree, the last good value is used, at
    /// most until it is stale. Returns whether enough values agree. The value is then stored, but may still
    /// be rejected, for example because it is out of range.
    pub(in crate::gateway) fn store_ambiguous(
        &mut self,
        id: SignalId,
        value: Result<f64, Reason>,
        at: Moment,
        breaks: u64,
    ) -> bool {
        let (rate, rules) = (self.latest.profile.signal(id).max_rate, self.latest.rules[id.0]);
        let agrees = |before: &LastRead| match (value, before.value, rate) {
            (Ok(value), Ok(other), Some(rate)) => !is_too_fast((value, at), (other, before.at), rate),
            (value, other, _) => value == other,
        };
        let before = self.read[id.0].filter(|before| at.since(before.at) <= rules.max_age && agrees(before));
        let agreeing = before.map_or(1, |before| before.agreeing.saturating_add(1));
        // A value out of range moves nothing, and must be reported soon.
        let may_move = rate.is_some() && value.is_ok_and(|value| rules.is_plausible(value));
        let needed = if may_move && !self.is_good_recent(id, at) { MANY } else { AGREEING };
        let is_confirmed = agreeing >= needed;
        if is_confirmed {
            self.store(id, value, at, breaks);
            if self.latest.readings[id.0].quality == Quality::Good {
                self.chains[id.0] = self.chains[id.0].max(needed);
            }
        } else {
            if let (Ok(value), Some(rate)) = (value, rules.rate_limit)
                && rules.is_plausible(value)
            {
                self.rates[id.0].hold_back(value, at, rate, breaks);
            }
            self.fail(id, Reason::BadReply);
        }
        self.read[id.0] = Some(LastRead { value, at, agreeing });
        is_confirmed
    }

    /// Returns whether the last good value of the signal is not older than `max_age`.
    fn is_good_recent(&self, id: SignalId, at: Moment) -> bool {
        self.rates[id.0].age_of_good(at).is_some_and(|age| age <= self.latest.rules[id.0].max_age)
    }

    /// Marks the last reading as doubtful. Another master was detected after this reading, so the reading may
    /// be the answer to a request of that master. The reading is rejected, unless the profile sets `max_rate`
    /// and the reading ends a series of at least [`MANY`] good values. A shorter series may consist only of
    /// answers to the other master.
    pub(in crate::gateway) fn doubt(&mut self, id: SignalId) {
        let has_rate = self.latest.profile.signal(id).max_rate.is_some();
        if !has_rate || self.chains[id.0] < MANY {
            if has_rate {
                self.rates[id.0].forget_good();
            }
            let reading = &mut self.latest.readings[id.0];
            if reading.quality == Quality::Good {
                *reading = Reading::bad(reading.at, Reason::BadReply);
            }
        }
        self.read[id.0] = None;
        self.forget_waiting(id);
    }

    /// Discards two answers, because one of them may belong to another master. The last good value is used until it
    /// is stale.
    pub(in crate::gateway) fn store_contested(&mut self, id: SignalId) {
        self.read[id.0] = None;
        self.forget_waiting(id);
        self.fail(id, Reason::BadReply);
    }

    /// Discards a value that waits for the read of its scale.
    fn forget_waiting(&mut self, id: SignalId) {
        self.scales[id.0].iter_mut().for_each(|scale| scale.forget());
    }

    /// Adds the rollovers to the value of a counter. Returns the value of any other signal unchanged.
    fn position(&mut self, id: SignalId, value: f64, at: Moment) -> Result<f64, Reason> {
        let Some(state) = &mut self.counters[id.0] else { return Ok(value) };
        let signal = self.latest.profile.signal(id);
        let Some(counter) = &signal.counter else { return Ok(value) };
        match state.tracked.take(counter, &signal.encoding, value, at) {
            Motion::To(position) => Ok(position),
            Motion::Doubtful => Err(Reason::TooFast),
            Motion::Rereferenced { from, to } => {
                let from = state.rereferenced.map_or(from, |(first, _)| first);
                state.rereferenced = Some((from, to));
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

    /// Records a failed attempt to read a signal. A single lost answer is not a fault, because the last value is used
    /// until it is stale.
    pub(in crate::gateway) fn fail(&mut self, id: SignalId, reason: Reason) {
        self.latest.failing[id.0] = Some(reason);
    }

    /// Marks all good readings as stale after a pause of the computer. The states of counters and reports are kept.
    pub(in crate::gateway) fn forget(&mut self) {
        self.scales.iter_mut().flatten().for_each(|scale| scale.forget());
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

    /// Returns the latest time at which the last reading of the signal may be used.
    pub(in crate::gateway) fn usable_until(&self, id: SignalId) -> Moment {
        self.taken(id).after(self.latest.rules[id.0].max_age)
    }

    /// Updates the quality of all readings for the time `now`. Readings that are too old become stale. Readings of a
    /// signal whose `fault_when` is true or unknown are rejected.
    pub(in crate::gateway) fn check(&mut self, now: Moment) -> &[Reading] {
        for place in 0..self.seen.len() {
            self.seen[place] = self.latest.assess(SignalId(place), now);
        }
        &self.seen
    }

    /// Returns the readings as the last call of `check` has updated them.
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

    /// Returns the changes of quality since the last call. `is_lost` returns whether the device of a signal was reported
    /// as lost.
    pub(in crate::gateway) fn changes(
        &mut self,
        now: Moment,
        is_lost: impl Fn(SignalId) -> bool,
    ) -> Vec<QualityChange> {
        let mut changes = Vec::new();
        for (place, reading) in self.seen.iter().enumerate() {
            if let Some(counter) = &mut self.counters[place] {
                let change = counter.rereferenced.take();
                changes
                    .extend(change.map(|(from, to)| QualityChange::Rereferenced(SignalId(place), from, to)));
            }
            if let Some(scale) = &mut self.scales[place] {
                let change = scale.take_change();
                changes
                    .extend(change.map(|(from, to)| QualityChange::ScaleChanged(SignalId(place), from, to)));
            }
            let is_of_the_device = |reason| match reason {
                Reason::LinkDown | Reason::Timeout | Reason::BadReply => true,
                // A Modbus gateway reports that the device behind it did not answer.
                Reason::Exception(10 | 11) => is_lost(SignalId(place)),
                _ => false,
            };
            match (reading.quality, &mut self.bad[place]) {
                (Quality::Good, bad) => {
                    let ended = bad.take().filter(|bad| bad.is_reported);
                    changes.extend(ended.map(|bad| QualityChange::Back(SignalId(place), bad.since)));
                }
                (Quality::Bad(Reason::NeverRead), _) => {}
                (Quality::Bad(reason), Some(bad)) => {
                    let is_news = bad.cause.is_now(reason, CHANGED_AFTER_STEPS);
                    // The device answers its gateway again, but this signal is still bad.
                    let is_own = !is_of_the_device(reason);
                    let is_left = is_own && !bad.is_reported && *bad.cause.reported() == reason;
                    if is_left || (is_news && (is_own || bad.is_reported)) {
                        bad.is_reported = true;
                        changes.push(QualityChange::Lost(SignalId(place), reason));
                    }
                }
                (Quality::Bad(reason), bad) => {
                    let is_reported = !is_of_the_device(reason);
                    *bad = Some(Box::new(BadSignal { cause: Cause::new(reason), since: now, is_reported }));
                    changes.extend(is_reported.then_some(QualityChange::Lost(SignalId(place), reason)));
                }
            }
        }
        changes
    }
}

/// Returns whether a value has changed faster than `rate` permits since the previous value.
fn is_too_fast((value, at): (f64, Moment), (before, taken): (f64, Moment), rate: f64) -> bool {
    // At least one second: noise between two polls in quick succession must not look fast.
    let seconds = at.since(taken).as_secs_f64().max(1.0);
    (value - before).abs() > rate * seconds
}

impl SignalRules {
    fn of(signal: &Signal) -> SignalRules {
        SignalRules {
            max_age: signal.max_age,
            plausible: signal.plausible_range(),
            rate_limit: signal.rate_limit(),
            has_fault_condition: signal.fault_when.is_some(),
            has_scale: signal.scale_from.is_some(),
        }
    }

    fn is_plausible(&self, value: f64) -> bool {
        let (low, high) = self.plausible;
        (low..=high).contains(&value)
    }
}

impl Latest {
    pub(in crate::gateway) fn taken(&self, id: SignalId) -> Moment {
        self.readings[id.0].at
    }

    /// Returns all readings with their quality at `now`. Readings that are too old are stale. Readings of a signal
    /// whose `fault_when` is true or unknown are rejected.
    pub(in crate::gateway) fn at(&self, now: Moment) -> Vec<Reading> {
        (0..self.readings.len()).map(|place| self.assess(SignalId(place), now)).collect()
    }

    fn assess(&self, id: SignalId, now: Moment) -> Reading {
        let plain = |id: SignalId| self.readings[id.0].aged(now, self.rules[id.0].max_age);
        let reading = plain(id);
        match (reading.quality, self.failing[id.0], self.fault_condition(id)) {
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

    /// Returns the condition `fault_when`, under which the signal is bad; `None` if the profile sets no condition.
    fn fault_condition(&self, id: SignalId) -> Option<&Condition> {
        let has_condition = self.rules[id.0].has_fault_condition;
        has_condition.then(|| self.profile.signal(id).fault_when.as_deref()).flatten()
    }
}

#[cfg(test)]
mod tests;

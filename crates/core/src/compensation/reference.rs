//! What ΔT is measured from, and how long the machine has been running.
//!
//! Both belong to the machine, not to an axis, and both survive a restart. Edges of the `on` and `zero` signals
//! are seen between two calls of [`Machine::observe`]; the caller asks [`Machine::would_notice`] on every new
//! reading, so that a short press of a button is not lost between two updates.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::Snapshot;
use super::settings::MachineSettings;
use super::stand_in::Beginning;
use crate::quantity::{Celsius, Moment, shifted};
use crate::reading::SignalId;

/// What ΔT is measured from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reference {
    /// A number; 0 means the temperature itself.
    Fixed(Celsius),
    /// The value at machine start.
    Start,
    /// The value at the last zero.
    Zero,
}

/// The time since machine start and the captured references of every signal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    on_since: Option<Moment>,
    /// How long it had been running then: what was counted before a restart.
    #[serde(default)]
    on_before: Duration,
    /// What of the time since then was not counted, at most: nobody looked.
    #[serde(default, skip_serializing_if = "Duration::is_zero")]
    on_away: Duration,
    was_on: Option<bool>,
    was_zeroed: Option<bool>,
    start: Vec<Capture>,
    zero: Vec<Capture>,
    #[serde(skip)]
    known: Known,
}

/// What saves looking at captures. It says nothing that they do not say: no two machines differ by it.
#[derive(Clone, Copy, Debug, Default)]
struct Known {
    /// How often what is captured has changed since the gateway started.
    captures: u32,
    /// None is being gathered.
    is_complete: bool,
}

impl PartialEq for Known {
    fn eq(&self, _: &Known) -> bool {
        true
    }
}

/// The reference of one signal: captured, or being gathered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Capture {
    value: Option<f64>,
    /// When it was complete: tells two captures of the same value apart.
    #[serde(default)]
    at: Moment,
    gathering: Option<Gathering>,
    /// It was not gathered when it could be read last: the sensor is not believed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    withheld: bool,
    /// What of the time since then was not counted, at most: the machine was away.
    #[serde(default, skip_serializing_if = "Duration::is_zero")]
    away: Duration,
}

/// A reference value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Captured {
    /// In the signal's unit.
    pub value: Celsius,
    /// When it was complete; the beginning of time for a fixed one.
    pub at: Moment,
}

/// A mean that is still growing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Gathering {
    until: Moment,
    sum: f64,
    count: u32,
}

/// What [`Machine::observe`] noticed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Noticed {
    /// The time since machine start begins to count now.
    pub started: bool,
    /// The references given as "zero" are captured from now on.
    pub zeroed: bool,
}

impl Machine {
    /// The same machine, whose time since its start is counted on from this moment.
    pub(super) fn counted_until(self, at: Moment) -> Machine {
        let on_before = self.on_time(at).unwrap_or_default();
        Machine { on_since: self.on_since.map(|_| at), on_before, ..self }
    }

    /// The same machine, after it was away for at most so long.
    pub(super) fn away(mut self, span: Duration) -> Machine {
        for capture in self.start.iter_mut().chain(&mut self.zero) {
            capture.away = capture.away.saturating_add(span);
        }
        self.on_away = self.on_away.saturating_add(span);
        self
    }

    /// How long ago the reference of a term was captured, at most: while the machine was away it grew older. `None` for a
    /// number, and while none has been captured.
    pub fn age(&self, reference: Reference, signal: SignalId, now: Moment) -> Option<Duration> {
        let capture = match reference {
            Reference::Fixed(_) => return None,
            Reference::Start => self.start.get(signal.0)?,
            Reference::Zero => self.zero.get(signal.0)?,
        };
        capture.value.map(|_| now.since(capture.at).saturating_add(capture.away))
    }

    /// How long the machine has been running; `None` before it was first seen running.
    pub fn on_time(&self, now: Moment) -> Option<Duration> {
        self.on_since.map(|since| self.on_before + now.since(since))
    }

    /// The same with the time in which nobody looked, at most: so old may be what was measured from the start.
    pub(super) fn on_time_at_most(&self, now: Moment) -> Option<Duration> {
        self.on_time(now).map(|counted| counted.saturating_add(self.on_away))
    }

    /// The reference value of a term; `None` while it has not been captured.
    #[inline]
    pub fn captured(&self, reference: Reference, signal: SignalId) -> Option<Captured> {
        let capture = match reference {
            Reference::Fixed(value) => return Some(Captured { value, at: Moment::default() }),
            Reference::Start => self.start.get(signal.0)?,
            Reference::Zero => self.zero.get(signal.0)?,
        };
        Some(Captured { value: Celsius::new(capture.value?)?, at: capture.at })
    }

    /// A number that is another one whenever some reference has been captured, or taken away: whoever knows it need look
    /// nothing up.
    #[inline]
    pub(super) fn captures(&self) -> u32 {
        self.known.captures
    }

    /// What is captured is not what it was.
    fn changed(&mut self) {
        self.known.captures = self.known.captures.wrapping_add(1);
    }

    /// A reference waits for its sensor to be believed.
    pub(super) fn is_withheld(&self, reference: Reference, signal: SignalId) -> bool {
        let captures = match reference {
            Reference::Fixed(_) => return false,
            Reference::Start => &self.start,
            Reference::Zero => &self.zero,
        };
        captures.get(signal.0).is_some_and(|capture| capture.gathering.is_some() && capture.withheld)
    }

    /// A zero was commanded, and that of this signal is not captured yet.
    pub(super) fn is_zeroed_anew(&self, signal: SignalId) -> bool {
        self.zero.get(signal.0).is_some_and(|capture| capture.gathering.is_some())
    }

    /// A sensor is believed again, and this is what it began from. It holds where nothing was captured before it was distrusted.
    pub(super) fn begins(&mut self, signal: SignalId, beginning: Beginning) {
        let Some(capture) = self.start.get_mut(signal.0) else { return };
        let Some(began) = self.on_since.filter(|_| beginning.value.is_finite()) else { return };
        if capture.value.is_none() {
            (capture.at, capture.away) = (began, self.on_before.saturating_add(self.on_away));
        } else if capture.at < beginning.distrusted_since {
            return;
        }
        (capture.value, capture.gathering) = (Some(beginning.value), None);
        self.changed();
    }

    /// Whether these values hold an edge, or the first good reading, that [`Machine::observe`] would act upon.
    pub fn would_notice(
        &self,
        settings: &MachineSettings,
        value: impl Fn(SignalId) -> Option<f64>,
        any_usable: impl FnOnce() -> bool,
    ) -> bool {
        let differs = |signal: Option<SignalId>, last: Option<bool>| {
            let level = signal.and_then(&value).map(is_high);
            level.is_some() && level != last
        };
        differs(settings.on, self.was_on)
            || differs(settings.zero, self.was_zeroed)
            || (self.waits_for_a_reading(settings) && any_usable())
    }

    /// Takes in a snapshot: edges, the machine start, references being gathered.
    pub fn observe(&mut self, settings: &MachineSettings, snapshot: &Snapshot<'_>) -> Noticed {
        self.observe_without(settings, snapshot, |_| false)
    }

    /// The same; nothing is gathered from a sensor that is not believed.
    pub(super) fn observe_without(
        &mut self,
        settings: &MachineSettings,
        snapshot: &Snapshot<'_>,
        is_distrusted: impl Fn(SignalId) -> bool,
    ) -> Noticed {
        let fresh = Capture { gathering: Some(Gathering::new(snapshot.now, settings)), ..Capture::default() };
        self.known.is_complete &= self.start.len() == settings.signals && self.zero.len() == settings.signals;
        self.start.resize(settings.signals, Capture::default());
        self.zero.resize(settings.signals, Capture::default());
        if self.on_since.is_some() && !self.known.is_complete {
            // A signal that is new or forgotten since the machine started is captured from now on.
            let all = self.start.iter_mut().chain(&mut self.zero);
            all.filter(|capture| capture.is_nothing()).for_each(|capture| *capture = fresh);
        }
        let started = self.begins_to_run(settings, snapshot);
        if started {
            (self.on_since, self.on_before, self.on_away) =
                (Some(snapshot.now), Duration::ZERO, Duration::ZERO);
            self.start.fill(fresh);
            self.changed();
            self.known.is_complete = false;
            // A machine that was never zeroed is zeroed by its first start.
            for capture in self.zero.iter_mut().filter(|capture| capture.value.is_none()) {
                *capture = fresh;
            }
        }
        let zeroed = rising(&mut self.was_zeroed, settings.zero, snapshot);
        if zeroed {
            self.zero(settings, snapshot.now);
        }
        if !self.known.is_complete {
            self.gather(snapshot, is_distrusted);
        }
        Noticed { started, zeroed }
    }

    /// Takes what can be read now into the references that are open.
    fn gather(&mut self, snapshot: &Snapshot<'_>, is_distrusted: impl Fn(SignalId) -> bool) {
        let is_open = |capture: &Capture| capture.gathering.is_some();
        let mut has_captured = false;
        for captures in [&mut self.start, &mut self.zero] {
            let readings = snapshot.readings.iter().enumerate();
            for ((place, reading), capture) in readings.zip(captures).filter(|(_, capture)| is_open(capture))
            {
                let Some(value) = reading.usable() else { continue };
                capture.withheld = is_distrusted(SignalId(place));
                if !capture.withheld {
                    capture.gather(value, snapshot.now);
                    has_captured |= !is_open(capture);
                }
            }
        }
        if has_captured {
            self.changed();
        }
        self.known.is_complete = !self.start.iter().chain(&self.zero).any(is_open);
    }

    /// Forgets what was captured from this signal. It is captured again from the next snapshot on. Returns whether anything was.
    pub(super) fn forget(&mut self, signal: SignalId) -> bool {
        let mut was_captured = false;
        for capture in [&mut self.start, &mut self.zero].into_iter().filter_map(|all| all.get_mut(signal.0)) {
            was_captured |= std::mem::take(capture).value.is_some();
        }
        self.known.is_complete = false;
        self.changed();
        was_captured
    }

    /// Captures the "zero" references from now on. The old ones serve until the new ones are complete.
    pub fn zero(&mut self, settings: &MachineSettings, now: Moment) {
        self.zero.resize(settings.signals, Capture::default());
        self.known.is_complete = false;
        for capture in &mut self.zero {
            capture.gathering = Some(Gathering::new(now, settings));
        }
    }

    /// The same for these signals.
    pub(super) fn zero_of(&mut self, signals: &[SignalId], settings: &MachineSettings, now: Moment) {
        self.zero.resize(settings.signals, Capture::default());
        self.known.is_complete = false;
        for signal in signals {
            if let Some(capture) = self.zero.get_mut(signal.0) {
                capture.gathering = Some(Gathering::new(now, settings));
            }
        }
    }

    fn begins_to_run(&mut self, settings: &MachineSettings, snapshot: &Snapshot<'_>) -> bool {
        if settings.on.is_some() {
            return rising(&mut self.was_on, settings.on, snapshot);
        }
        self.waits_for_a_reading(settings) && snapshot.has_usable()
    }

    /// The first good reading starts a machine that has no signal for it.
    fn waits_for_a_reading(&self, settings: &MachineSettings) -> bool {
        settings.on.is_none() && self.on_since.is_none()
    }
}

shifted!(Machine: on_since, start, zero);
shifted!(Capture: at, gathering);
shifted!(Gathering: until);

impl Gathering {
    fn new(now: Moment, settings: &MachineSettings) -> Gathering {
        Gathering { until: now.after(settings.settle), sum: 0.0, count: 0 }
    }
}

impl Capture {
    /// Returns whether nothing is captured and nothing is being gathered.
    fn is_nothing(&self) -> bool {
        self.value.is_none() && self.gathering.is_none()
    }

    fn gather(&mut self, value: f64, now: Moment) {
        let Some(gathering) = &mut self.gathering else { return };
        // What is read when the time is over belongs to what follows, unless there is nothing else.
        if now < gathering.until || gathering.count == 0 {
            gathering.sum += value;
            gathering.count += 1;
        }
        if now >= gathering.until {
            self.value = Some(gathering.sum / f64::from(gathering.count));
            (self.at, self.away) = (now, Duration::ZERO);
            self.gathering = None;
        }
    }
}

/// A signal as a yes or no.
fn is_high(value: f64) -> bool {
    value >= 0.5
}

/// A signal that is high now and was not: a first look at a high signal counts as its edge.
fn rising(last: &mut Option<bool>, signal: Option<SignalId>, snapshot: &Snapshot<'_>) -> bool {
    let Some(now) = signal.and_then(|id| snapshot.value(id)).map(is_high) else { return false };
    let rose = now && *last != Some(true);
    *last = Some(now);
    rose
}

#[cfg(test)]
mod tests;

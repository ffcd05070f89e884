//! References of temperature rises, and the running time of the machine. A reference is a value that is subtracted from
//! a signal; the difference is the rise.
//!
//! References and running time belong to the machine, not to an axis, and are saved for a restart. [`Machine::observe`]
//! detects edges of the `on` and `zero` signals by comparing two calls. The caller calls [`Machine::would_notice`] at
//! every new reading, so that a short press of a button between two updates is not lost.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::Snapshot;
use super::settings::MachineSettings;
use super::stand_in::StartEstimate;
use crate::quantity::{Celsius, Moment, shifted};
use crate::reading::SignalId;

/// Reference that is subtracted from a signal to get its rise ΔT.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reference {
    /// Fixed value. If it is 0, the rise is the value of the signal itself.
    Fixed(Celsius),
    /// Value of the signal at machine start.
    Start,
    /// Value of the signal at the last zero command.
    Zero,
}

/// State of the machine: time since its start, and the captured references of every signal.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    on_since: Option<Moment>,
    /// Running time of the machine before `on_since`. It was counted before a restart of the gateway.
    #[serde(default)]
    on_before: Duration,
    /// Largest possible total time, since machine start, in which the gateway did not run. If the wall clock
    /// does not give the duration of a stop, `Stop::LONGEST` is added. The running time of the machine does not
    /// include this time.
    #[serde(default, skip_serializing_if = "Duration::is_zero")]
    on_away: Duration,
    was_on: Option<bool>,
    was_zeroed: Option<bool>,
    start: Vec<Capture>,
    zero: Vec<Capture>,
    #[serde(skip)]
    known: CaptureFacts,
}

/// Number of changes of the captured values, and whether no capture is running. They are stored, so that a step need
/// not search all captures. A comparison of two machines ignores them.
#[derive(Clone, Copy, Debug, Default)]
struct CaptureFacts {
    /// Number of changes of the captured values since the gateway started. The number wraps around at its maximum.
    captures: u32,
    /// Whether no capture is running.
    is_complete: bool,
}

impl PartialEq for CaptureFacts {
    fn eq(&self, _: &CaptureFacts) -> bool {
        true
    }
}

/// Reference of one signal: its captured value, and a running capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Capture {
    value: Option<f64>,
    /// Time at which the capture was complete. It distinguishes two captures that gave the same value.
    #[serde(default)]
    at: Moment,
    gathering: Option<CaptureMean>,
    /// Whether the capture did not use the last reading, because the sensor was rejected.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    withheld: bool,
    /// Largest possible total time, since the capture, during which the gateway did not run.
    #[serde(default, skip_serializing_if = "Duration::is_zero")]
    away: Duration,
}

/// Captured reference of a signal: its value, and the time of the capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapturedReference {
    /// Value in the signal's unit.
    pub value: Celsius,
    /// Time at which the capture was complete. For a fixed reference, the earliest moment.
    pub at: Moment,
}

/// Sum of the readings in a running capture, whose mean becomes the reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct CaptureMean {
    until: Moment,
    sum: f64,
    count: u32,
}

/// Result of [`Machine::observe`]: events of the machine that a snapshot shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MachineChange {
    /// Whether a machine start was detected. The time since machine start is counted from this snapshot on.
    pub started: bool,
    /// Whether a zero command was detected. This snapshot is the first from which the references
    /// [`Reference::Zero`] are captured.
    pub zeroed: bool,
}

impl Machine {
    /// Returns the state with the running time up to `at` added to `on_before`. Later running time is counted from
    /// `at`.
    pub(super) fn counted_until(self, at: Moment) -> Machine {
        let on_before = self.on_time(at).unwrap_or_default();
        Machine { on_since: self.on_since.map(|_| at), on_before, ..self }
    }

    /// Returns the state after a time of at most `span` in which the gateway did not run.
    pub(super) fn away(mut self, span: Duration) -> Machine {
        for capture in self.start.iter_mut().chain(&mut self.zero) {
            capture.away = capture.away.saturating_add(span);
        }
        self.on_away = self.on_away.saturating_add(span);
        self
    }

    /// Returns the largest possible age of a captured reference, including the time in which the gateway did not run.
    /// `None` for a fixed reference, and while no reference has been captured.
    pub fn age(&self, reference: Reference, signal: SignalId, now: Moment) -> Option<Duration> {
        let capture = match reference {
            Reference::Fixed(_) => return None,
            Reference::Start => self.start.get(signal.0)?,
            Reference::Zero => self.zero.get(signal.0)?,
        };
        capture.value.map(|_| now.since(capture.at).saturating_add(capture.away))
    }

    /// Takes the references of all signals out of the state. The first list contains the references of machine start,
    /// the second list the references of the last zero command.
    pub fn take_references(&mut self) -> [Vec<Capture>; 2] {
        [&mut self.start, &mut self.zero].map(std::mem::take)
    }

    /// Returns the time since machine start, without the time in which the gateway did not run. The time also counts
    /// while the machine is off. `None` if no machine start was ever detected.
    pub fn on_time(&self, now: Moment) -> Option<Duration> {
        self.on_since.map(|since| self.on_before + now.since(since))
    }

    /// Returns the running time of the machine, plus the largest time since its start in which the gateway may not have
    /// run.
    pub(super) fn on_time_at_most(&self, now: Moment) -> Option<Duration> {
        self.on_time(now).map(|counted| counted.saturating_add(self.on_away))
    }

    /// Returns the reference of a signal; `None` while it has not been captured.
    #[inline]
    pub fn captured(&self, reference: Reference, signal: SignalId) -> Option<CapturedReference> {
        let capture = match reference {
            Reference::Fixed(value) => return Some(CapturedReference { value, at: Moment::default() }),
            Reference::Start => self.start.get(signal.0)?,
            Reference::Zero => self.zero.get(signal.0)?,
        };
        Some(CapturedReference { value: Celsius::new(capture.value?)?, at: capture.at })
    }

    /// Returns a number that changes whenever a reference is captured or removed. While the number is the same, results
    /// derived from references stay valid.
    #[inline]
    pub(super) fn captures(&self) -> u32 {
        self.known.captures
    }

    /// Records that captured values have changed, so that results derived from them are calculated again.
    fn changed(&mut self) {
        self.known.captures = self.known.captures.wrapping_add(1);
    }

    /// Returns whether the capture of this reference is waiting because the signal's sensor is rejected.
    pub(super) fn is_withheld(&self, reference: Reference, signal: SignalId) -> bool {
        let captures = match reference {
            Reference::Fixed(_) => return false,
            Reference::Start => &self.start,
            Reference::Zero => &self.zero,
        };
        captures.get(signal.0).is_some_and(|capture| capture.gathering.is_some() && capture.withheld)
    }

    /// Returns whether the "zero" reference of this signal is being captured.
    pub(super) fn is_zeroed_again(&self, signal: SignalId) -> bool {
        self.zero.get(signal.0).is_some_and(|capture| capture.gathering.is_some())
    }

    /// Sets the machine-start reference of a sensor that is accepted again, to an estimate. A reference that was
    /// captured before the sensor was rejected stays.
    pub(super) fn begins(&mut self, signal: SignalId, beginning: StartEstimate) {
        let Some(capture) = self.start.get_mut(signal.0) else { return };
        let Some(began) = self.on_since.filter(|_| beginning.value.is_finite()) else { return };
        if capture.value.is_none() {
            (capture.at, capture.away) = (began, self.on_before.saturating_add(self.on_away));
        } else if capture.at < beginning.rejected_since {
            return;
        }
        (capture.value, capture.gathering) = (Some(beginning.value), None);
        self.changed();
    }

    /// Returns whether [`Machine::observe`] would react to the present values: to an edge of the `on` or `zero` signal,
    /// or to the first good reading. `value` returns the value of a signal, and `any_usable` whether any reading may be
    /// used.
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

    /// Processes a snapshot: detects a machine start and a zero command, and continues running captures.
    pub fn observe(&mut self, settings: &MachineSettings, snapshot: &Snapshot<'_>) -> MachineChange {
        self.observe_without(settings, snapshot, |_| false)
    }

    /// Processes a snapshot as [`Machine::observe`] does, without capturing references from sensors for which
    /// `is_distrusted` returns true.
    pub(super) fn observe_without(
        &mut self,
        settings: &MachineSettings,
        snapshot: &Snapshot<'_>,
        is_distrusted: impl Fn(SignalId) -> bool,
    ) -> MachineChange {
        let fresh =
            Capture { gathering: Some(CaptureMean::new(snapshot.now, settings)), ..Capture::default() };
        self.known.is_complete &= self.start.len() == settings.signals && self.zero.len() == settings.signals;
        self.start.resize(settings.signals, Capture::default());
        self.zero.resize(settings.signals, Capture::default());
        if self.on_since.is_some() && !self.known.is_complete {
            // A signal that is new, or was forgotten since machine start, is captured from now on.
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
            // The first start of a machine also sets its zero.
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
        MachineChange { started, zeroed }
    }

    /// Adds the readings of the snapshot to the running captures.
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

    /// Discards the references of this signal, which are then captured again from the next snapshot on. Returns whether
    /// at least one of these references had been captured.
    pub(super) fn forget(&mut self, signal: SignalId) -> bool {
        let mut was_captured = false;
        for capture in [&mut self.start, &mut self.zero].into_iter().filter_map(|all| all.get_mut(signal.0)) {
            was_captured |= std::mem::take(capture).value.is_some();
        }
        self.known.is_complete = false;
        self.changed();
        was_captured
    }

    /// Starts to capture the "zero" references of all signals. The old references are used until the new references are
    /// complete.
    pub fn zero(&mut self, settings: &MachineSettings, now: Moment) {
        self.zero.resize(settings.signals, Capture::default());
        self.known.is_complete = false;
        for capture in &mut self.zero {
            capture.gathering = Some(CaptureMean::new(now, settings));
        }
    }

    /// Starts to capture the "zero" references of these signals.
    pub(super) fn zero_of(&mut self, signals: &[SignalId], settings: &MachineSettings, now: Moment) {
        self.zero.resize(settings.signals, Capture::default());
        self.known.is_complete = false;
        for signal in signals {
            if let Some(capture) = self.zero.get_mut(signal.0) {
                capture.gathering = Some(CaptureMean::new(now, settings));
            }
        }
    }

    fn begins_to_run(&mut self, settings: &MachineSettings, snapshot: &Snapshot<'_>) -> bool {
        if settings.on.is_some() {
            return rising(&mut self.was_on, settings.on, snapshot);
        }
        self.waits_for_a_reading(settings) && snapshot.has_usable()
    }

    /// Returns whether the next good reading counts as machine start: the machine has no `on` signal, and has not
    /// started yet.
    fn waits_for_a_reading(&self, settings: &MachineSettings) -> bool {
        settings.on.is_none() && self.on_since.is_none()
    }
}

shifted!(Machine: on_since, start, zero);
shifted!(Capture: at, gathering);
shifted!(CaptureMean: until);

impl CaptureMean {
    fn new(now: Moment, settings: &MachineSettings) -> CaptureMean {
        CaptureMean { until: now.after(settings.settle), sum: 0.0, count: 0 }
    }
}

impl Capture {
    /// Returns whether no value has been captured, and no capture is running.
    fn is_nothing(&self) -> bool {
        self.value.is_none() && self.gathering.is_none()
    }

    fn gather(&mut self, value: f64, now: Moment) {
        let Some(gathering) = &mut self.gathering else { return };
        // A reading after the end belongs to the time that follows. It is used only if there is no other.
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

/// Returns whether this value of an on/off signal is high.
fn is_high(value: f64) -> bool {
    value >= 0.5
}

/// Returns whether a signal is high now and was low before, and stores its level in `last`. The first value counts as
/// an edge if it is high.
fn rising(last: &mut Option<bool>, signal: Option<SignalId>, snapshot: &Snapshot<'_>) -> bool {
    let Some(now) = signal.and_then(|id| snapshot.value(id)).map(is_high) else { return false };
    let rose = now && *last != Some(true);
    *last = Some(now);
    rose
}

#[cfg(test)]
mod tests;

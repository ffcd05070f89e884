//! State that is saved for a restart: references of the machine, lags of the terms, datum of the axes, and corrections
//! from probings (measured errors). The datum of an axis is the zero point of its Cz.
//!
//! The state file contains this state, and so does the first row of a run in its log. A replay of the log therefore
//! gives the decisions of the gateway. A lag is saved with the axis, the model and the index of its term. A term whose
//! signal, lag or kind of reference has changed starts without its saved lag.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::AxisRunning;
use super::axis::ModelWatch;
use super::datum::{Level, Zeroing};
use super::model::{Input, Lag, Lagged, Model, Reference};
use super::preference::Preference;
use super::probe::Probe;
use super::reference::Machine;
use super::settings::{AxisSettings, Datum};
use super::stand_in::Watch;
use crate::quantity::{Moment, Shift, Shifted, shifted};
use crate::reading::SignalId;

/// Saved state of a machine and its axes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Remembered {
    /// State of the machine: time since its start, and references.
    #[serde(flatten)]
    pub machine: Machine,
    /// States of the axes that have lags, a datum, watched sensors or probings.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub axes: Vec<AxisMemory>,
    /// Running state of the axes, for a log that continues in a new file. It is empty after a restart, because all axes
    /// are then off.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub running: Vec<AxisRunning>,
}

/// Saved state of one axis: lags, datum (zero point of Cz), sensor checks, corrections from probings, preferred model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxisMemory {
    axis: String,
    lags: Vec<KeptLag>,
    datum: Vec<KeptDatum>,
    /// End of a running capture of the datum (zero point of Cz); `None` if no capture is running.
    datum_until: Option<Moment>,
    /// Time at which the last capture of the datum was complete; `None` before the first capture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    datum_at: Option<Moment>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    probe: Option<Probe>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    watches: Vec<Watch>,
    /// Preferred model, the model that was preferred before, and a change that waits. `None` if the models of the
    /// profile are preferred, and nothing else must be saved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    preference: Option<Preference>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct KeptLag {
    model: String,
    term: usize,
    /// Index of the term's signal in the profile's list of signals.
    signal: usize,
    constant: Duration,
    reference: ReferenceKind,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    squared: bool,
    lagged: Lagged,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ReferenceKind {
    Fixed,
    Start,
    Zero,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct KeptDatum {
    model: String,
    level: Level,
}

impl Remembered {
    /// Returns the state with the running time of the machine summed up to `at`. Later running time is counted from
    /// `at`.
    #[must_use]
    pub fn counted_until(mut self, at: Moment) -> Remembered {
        self.machine = self.machine.counted_until(at);
        self
    }

    /// Returns this state, which was saved at `kept`, for a run that starts at `now`. The two times may come from
    /// different clocks: all saved times are shifted by the difference. `stop` contains the time between the two runs.
    #[must_use]
    pub fn resumed(self, kept: Moment, now: Moment, stop: Stop) -> Remembered {
        let mut resumed = self.counted_until(kept).shifted(Shift::between(kept, now));
        let back = |span| Shift::between(now, now.before(span));
        let away = (back(stop.by_the_clock.unwrap_or_default()), back(stop.of_lags()));
        resumed.machine = resumed.machine.away(stop.of_lags());
        for axis in &mut resumed.axes {
            axis.lags.iter_mut().for_each(|term| term.lagged = term.lagged.away(stop.of_lags()));
            axis.probe.iter_mut().for_each(|probe| probe.away(away));
            axis.watches.iter_mut().for_each(|watch| watch.away(stop.of_lags()));
            axis.datum_at.shift(away.1);
        }
        resumed
    }

    /// Returns the names of the first axis and model whose stand-ins file has changed since the state was saved; `None`
    /// if no file has changed.
    pub fn other_stand_ins<'a>(
        &'a self,
        axes: impl IntoIterator<Item = &'a AxisSettings>,
    ) -> Option<(&'a str, &'a str)> {
        let known = self.by_axis();
        axes.into_iter().find_map(|settings| {
            let kept = known.get(settings.name.as_str())?;
            kept.watches.iter().find_map(|watch| {
                let model = settings.models.iter().find(|model| model.name == watch.model)?;
                let is_other = model.stand_ins.as_ref()?.fingerprint() != watch.file;
                is_other.then_some((settings.name.as_str(), model.name.as_str()))
            })
        })
    }

    /// Returns each axis whose saved learned model is not used, and the name of this model. The reason is that the
    /// models of the profile have changed, or that the axis lacks an input of the learned model.
    pub fn superseded<'a>(
        &'a self,
        axes: impl IntoIterator<Item = &'a AxisSettings>,
    ) -> impl Iterator<Item = (&'a str, &'a str)> {
        let known = self.by_axis();
        axes.into_iter().filter_map(move |settings| {
            let preference = known.get(settings.name.as_str())?.preference()?;
            let learned = preference.preferred().learned()?;
            let slot = settings.learned.as_ref().filter(|slot| slot.own == preference.own());
            let model = slot.and_then(|slot| settings.models.get(slot.model));
            let is_used = model.is_some_and(|model| learned.gains_in(model).is_ok());
            (!is_used).then_some((settings.name.as_str(), learned.name.as_str()))
        })
    }

    /// Discards everything that was measured with these signals, because their sensors or settings have changed.
    /// References and lags of these signals, and the datum of models that read the signals, are captured again from the
    /// next snapshot on. Returns the signals that a model of these axes reads and whose reference had been captured.
    pub fn forget(&mut self, signals: &BTreeSet<SignalId>, axes: &[AxisSettings]) -> BTreeSet<SignalId> {
        let captured = signals.iter().copied().filter(|signal| self.machine.forget(*signal));
        let captured: BTreeSet<SignalId> = captured.collect();
        let mut used = BTreeSet::new();
        let places: BTreeMap<String, usize> =
            self.axes.iter().map(|kept| kept.axis.clone()).zip(0..).collect();
        for settings in axes {
            let reads = |model: &str| {
                let model = settings.models.iter().find(|known| known.name == model);
                model.is_some_and(|model| model.signals().iter().any(|signal| signals.contains(signal)))
            };
            used.extend(settings.models.iter().flat_map(Model::signals));
            let Some(place) = places.get(&settings.name) else { continue };
            let kept = &mut self.axes[*place];
            kept.lags.retain(|lag| !signals.contains(&SignalId(lag.signal)));
            kept.watches.retain(|watch| !reads(&watch.model));
            if kept.datum.iter().any(|datum| reads(&datum.model)) {
                // The datum (zero point) of all models is of the same moment.
                kept.datum.clear();
                (kept.datum_until, kept.datum_at) = (Some(Moment::from_nanos(1)), None);
            }
        }
        captured.intersection(&used).copied().collect()
    }

    /// Returns the saved running states by the names of their axes.
    pub(super) fn running_by_axis(&self) -> BTreeMap<&str, &AxisRunning> {
        self.running.iter().map(|axis| (axis.axis.as_str(), axis)).collect()
    }

    /// Returns the saved states by the names of their axes.
    pub(super) fn by_axis(&self) -> BTreeMap<&str, &AxisMemory> {
        self.axes.iter().map(|axis| (axis.axis.as_str(), axis)).collect()
    }
}

shifted!(Remembered: machine, axes, running);
shifted!(AxisMemory: lags, datum_until, datum_at, probe, watches);
shifted!(KeptLag: lagged);

/// Time between two runs of the gateway, by the wall clock. The time is unknown if the clock is not valid.
///
/// The lags continue over this time, because temperatures change while the gateway is stopped. The running time of the
/// machine does not continue: after a day off, the gateway does not know whether the machine was on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stop {
    /// Time between the two runs by the wall clock. `None` if the clock was set in between, or if the time is too long.
    pub by_the_clock: Option<Duration>,
}

impl Stop {
    /// Longest accepted time between two runs.
    pub const LONGEST: Duration = Duration::from_hours(30 * 24);

    /// Returns the time from `kept`, when the state was saved, to `now`, both by the wall clock. A time that
    /// is negative, or longer than [`Stop::LONGEST`], counts as unknown.
    pub fn between(kept: Moment, now: Moment) -> Stop {
        let span = now.since(kept);
        Stop { by_the_clock: (now >= kept && span <= Stop::LONGEST).then_some(span) }
    }

    fn of_lags(self) -> Duration {
        self.by_the_clock.unwrap_or(Stop::LONGEST)
    }
}

impl AxisMemory {
    pub(super) fn of(
        settings: &AxisSettings,
        lags: &[Vec<Lag>],
        watched: &[ModelWatch],
        zeroing: &Zeroing,
        probe: &Probe,
    ) -> Option<AxisMemory> {
        let mut terms = Vec::new();
        for (model, lags) in settings.models.iter().zip(lags) {
            for ((place, input), lag) in model.rises().enumerate().zip(lags) {
                let Some((constant, lagged)) = input.time_constant().zip(lag.kept()) else { continue };
                terms.push(KeptLag {
                    model: model.name.clone(),
                    term: place,
                    signal: input.signal.0,
                    constant,
                    reference: input.reference.into(),
                    squared: input.squared,
                    lagged,
                });
            }
        }
        let (levels, datum_until) = zeroing.kept();
        let datum = settings.models.iter().zip(levels).filter(|_| settings.datum == Datum::Zero);
        let datum = datum.map(|(model, level)| KeptDatum { model: model.name.clone(), level: *level });
        let kept = AxisMemory {
            axis: settings.name.clone(),
            lags: terms,
            datum: datum.collect(),
            datum_until,
            datum_at: zeroing.at(),
            probe: settings.probe.map(|_| probe.clone()),
            watches: watched.iter().filter_map(|watched| watched.watch.as_ref()).map(Watch::kept).collect(),
            preference: None,
        };
        let is_worth_it = !kept.lags.is_empty() || !kept.datum.is_empty() || !kept.watches.is_empty();
        (is_worth_it || kept.probe.is_some()).then_some(kept)
    }

    /// Returns the saved state of this axis with its preferred model. `kept` is the saved state without the preferred
    /// model, if there is any.
    pub(super) fn with_preference(
        kept: Option<AxisMemory>,
        axis: &str,
        preference: &Preference,
    ) -> AxisMemory {
        let preference = Some(preference.clone());
        match kept {
            Some(kept) => AxisMemory { preference, ..kept },
            None => AxisMemory {
                axis: axis.to_owned(),
                lags: Vec::new(),
                datum: Vec::new(),
                datum_until: None,
                datum_at: None,
                probe: None,
                watches: Vec::new(),
                preference,
            },
        }
    }

    /// Returns the name of the axis.
    pub fn name(&self) -> &str {
        &self.axis
    }

    /// Returns the saved preference of the axis. `None` if the models of the profile are preferred, and nothing else
    /// was saved.
    pub fn preference(&self) -> Option<&Preference> {
        self.preference.as_ref()
    }

    pub(super) fn lag(&self, model: &str, place: usize, input: &Input) -> Lag {
        let same = |kept: &&KeptLag| {
            kept.model == model
                && (kept.term, kept.signal) == (place, input.signal.0)
                && (Some(kept.constant), kept.reference) == (input.time_constant(), input.reference.into())
                && kept.squared == input.squared
        };
        self.lags.iter().find(same).map(|kept| kept.lagged).into()
    }

    pub(super) fn recall_watches(&self, watched: &mut [ModelWatch]) {
        for watch in watched.iter_mut().filter_map(|watched| watched.watch.as_mut()) {
            if let Some(kept) = self.watches.iter().find(|kept| kept.model == watch.model) {
                watch.recall(kept);
            }
        }
    }

    pub(super) fn probe(&self) -> Option<&Probe> {
        self.probe.as_ref()
    }

    pub(super) fn zeroing<'a>(&self, models: impl Iterator<Item = &'a str>) -> Zeroing {
        let level = |name: &str| self.datum.iter().find(|kept| kept.model == name).map(|kept| kept.level);
        let first = self.datum.first().map(|kept| kept.level).unwrap_or_default();
        let models = models.map(|name| level(name).unwrap_or(first)).collect();
        Zeroing::restored(models, self.datum_until, self.datum_at)
    }
}

impl From<Reference> for ReferenceKind {
    fn from(reference: Reference) -> ReferenceKind {
        match reference {
            Reference::Fixed(_) => ReferenceKind::Fixed,
            Reference::Start => ReferenceKind::Start,
            Reference::Zero => ReferenceKind::Zero,
        }
    }
}

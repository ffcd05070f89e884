//! Detection of frozen sensors, and stand-ins (estimates from other sensors) for frozen and lost sensors. A step is
//! pure, and allocates no memory.
//!
//! Notation: x̂ is the rise of a sensor, predicted from other sensors (its predictors), as the mean of a
//! minute. s is the time at which the sensor's reading last changed, and y the reading at that time. If the
//! machine does not change, the predictors predict no change. A constant reading is suspected to be frozen
//! only if
//!
//! ```text
//! D = |x̂(now) − x̂(s)| > θ          0 while the reading changed less than 3 min ago
//! ```
//!
//! The sensor is suspected after three consecutive minutes with D > θ. The suspicion is reported, and the
//! reading is still used. Then the value `y + x̂ − x̂(s)` replaces the reading if this changes the axis's
//! target by at most one step of the axis. The lags of the sensor's terms are then replaced by lags that have
//! followed this value since s. For this purpose, each lag has a shadow. The shadow is set to the lag at
//! every change of the reading, and follows the prediction in between. A lost sensor is replaced from its
//! last good reading on. If the sensor was already lost when the machine started, x̂ itself is used as its
//! rise.
//!
//! # Rules
//! - A suspicion alone never puts an axis on hold. The reading of a suspected sensor without a stand-in is
//!   used for everything except the predictions of other sensors. A model whose own watch has no stand-in for
//!   a frozen sensor also uses the reading.
//! - The reading of a sensor with a stand-in is not used. The reading of a lost sensor is not used until the
//!   sensor is accepted again. If a lost sensor has no stand-in, the lags of its terms are not updated, no
//!   probing corrects the model, and no reference is captured from the sensor.
//! - A stand-in is never part of another stand-in. A suspected, frozen or lost sensor only contributes to the detection
//!   of frozen sensors, so that a second frozen sensor is found.
//! - A stand-in depends on at least two other sensors. These sensors and the stand-in must be inside the ranges on
//!   which the model was identified. The envelope gives a range for each input. The Mahalanobis distance of the
//!   envelope is ignored, because a frozen sensor changes it.
//! - A sensor is not suspected while one of its predictors is beyond its range. A sensor is also not
//!   suspected while the sensor itself or a lagged predictor is beyond its range by more than a tenth of the
//!   range. During this time, a frozen sensor keeps its last stand-in from inside the ranges, because its own
//!   reading is older.
//! - The mean of a minute uses the readings that were present. A prediction ends with the first whole minute
//!   in which one of its predictors had no reading. A prediction also ends if the readings were not checked
//!   for two minutes, or for two periods of the axis if this time is longer. For a frozen sensor, the last
//!   prediction is used for ten more minutes; then its reading is used again.
//! - A sensor has no prediction while a lag on which the prediction depends is not settled. A lag that began on a warm
//!   machine is settled after five of its time constants.
//! - A sensor with a stand-in is accepted again if its reading has changed and stayed within θ of the prediction for an
//!   hour. It is also accepted when the operator disarms its axis after a check. A suspected sensor is accepted when
//!   its reading changes.
//! - A sensor that was lost for less than 3 min is accepted at once, because only the connection was lost. A sensor
//!   without a prediction during its loss is also accepted at once. If there is no prediction after the loss, the
//!   sensor is accepted after an hour.
//! - When a sensor is accepted, its value at machine start is set to its reading minus its predicted rise, unless a
//!   valid reference was captured.
//! - A machine start resets everything. A frozen sensor stays frozen until its reading has changed.

use std::time::Duration;

use super::Snapshot;
use super::model::stand_ins::{StandIns, VirtualSensor};
use super::model::{Envelope, Input, Inputs, Lag, Model, Reference};
use super::reference::Machine;
use super::substitution::{SubstituteSource, Substitution};
use crate::quantity::{Micron, Moment, shifted};
use crate::reading::SignalId;

mod bank;
mod sensor;

use bank::{BankInput, EDGE, FAR};
pub(super) use sensor::StartEstimate;
use sensor::{Predicted, Prediction, Sensor, Verdict};
use serde::{Deserialize, Serialize};

/// Time over which the mean of a prediction is calculated.
const MINUTE: Duration = Duration::from_secs(60);
/// Maximum time between two checks of the readings, unless two periods of the axis are longer. After a longer
/// pause, earlier predictions are discarded.
const PAUSE: Duration = Duration::from_secs(2 * 60);

/// Sensor whose reading is replaced by a stand-in, an estimate from other sensors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SubstitutedSensor {
    /// Signal of the sensor whose reading is replaced.
    pub signal: SignalId,
    /// Time at which the sensor's reading last changed (frozen), or was last good (lost).
    pub since: Moment,
    /// Whether the sensor is frozen: its reading does not change. Otherwise the sensor is lost.
    pub frozen: bool,
    /// Number of other sensors from which the stand-in is estimated.
    pub others: usize,
}

/// Sensor of an axis that is suspected, frozen or lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RejectedSensor {
    /// Signal of the suspected, frozen or lost sensor.
    pub signal: SignalId,
    /// Time at which the sensor's reading last changed (suspected or frozen), or was last good (lost).
    pub since: Moment,
    /// Whether the sensor is suspected or frozen: its reading does not change. Otherwise the sensor is lost.
    pub frozen: bool,
    /// Number of other sensors from which the stand-in is estimated; `None` if the sensor has no stand-in. The reading
    /// of a frozen sensor without a stand-in is still used.
    pub others: Option<usize>,
}

shifted!(SubstitutedSensor: since);

/// Watch of the sensors of one model: it detects frozen and lost sensors, and estimates their stand-ins. Its state is
/// saved for a restart, and in the first row of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Watch {
    /// Name of the model whose sensors are checked.
    pub(super) model: String,
    /// Fingerprint (hash) of the stand-ins file.
    pub(super) file: u64,
    /// Offset and gains of the model in the profile. A saved state with other numbers is not used.
    numbers: Vec<f64>,
    /// Signal and time constant of the lag of each term of the model.
    #[serde(default)]
    terms: Vec<TermOfModel>,
    /// State of each sensor of the stand-ins file.
    sensors: Vec<Sensor>,
    /// State of each input (other sensor with its lag) of the predictions.
    bank: Vec<BankInput>,
    /// Shadow of each lag: the state that the lag would have if its sensor had been frozen since its last change.
    shadows: Vec<Lag>,
    /// End of the current minute, over which means are calculated; `None` before the first minute.
    until: Option<Moment>,
    /// Time of the last check of the readings.
    #[serde(default)]
    looked: Option<Moment>,
    /// For each term of the model: index of its sensor in `sensors`; `None` if the stand-ins file does not contain this
    /// sensor.
    #[serde(skip)]
    of_terms: Vec<Option<usize>>,
    /// Substitutes for the rejected readings, at most one for each sensor.
    #[serde(skip)]
    substitutions: Vec<Substitution>,
    /// For each sensor that was accepted again in this step: the estimate of its reading at machine start.
    #[serde(skip)]
    beginnings: Vec<Option<StartEstimate>>,
    /// Buffers for computing the effect of a substitution before it is made.
    #[serde(skip)]
    tried: (Vec<Substitution>, Vec<Lag>),
}

/// Limit for the effect of a substitution on the target of the axis, and the function that computes this
/// effect.
#[derive(Clone, Copy)]
pub(super) struct Bounds<'a> {
    /// Largest change of the axis's target, µm, that a substitution may cause: one step of the axis.
    pub(super) step: Micron,
    /// Whether the control itself multiplies the slope (tanβ) by the distance of the axis from the reference position
    /// P0.
    pub(super) splits_slope: bool,
    /// Function that returns the values that the axis would follow with these inputs: Cz, and the effect of the slope
    /// (position-dependent part of the compensation). The envelope and the correction from probings are applied. `None`
    /// if the model has no value.
    pub(super) target: &'a dyn Fn(&Inputs<'_>) -> Option<(Micron, Micron)>,
}

/// Signal that a term of the model reads, as an index of the list of signals, and the time constant of its lag.
type TermOfModel = (usize, Option<Duration>);

shifted!(Watch: sensors, bank, shadows, until, looked);

impl Watch {
    pub(super) fn new(model: &Model, settings: &StandIns) -> Watch {
        let place = |signal| settings.sensors().iter().position(|sensor| sensor.signal == signal);
        Watch {
            model: model.name.clone(),
            file: settings.fingerprint(),
            numbers: model.numbers().collect(),
            terms: model.rises().map(|input| (input.signal.0, input.time_constant())).collect(),
            sensors: vec![Sensor::default(); settings.sensors().len()],
            bank: vec![BankInput::default(); settings.bank().len()],
            shadows: model.rises().map(|_| Lag::default()).collect(),
            of_terms: model.rises().map(|input| place(input.signal)).collect(),
            until: None,
            looked: None,
            substitutions: Vec::with_capacity(settings.sensors().len()),
            beginnings: vec![None; settings.sensors().len()],
            tried: (
                Vec::with_capacity(settings.sensors().len() + 1),
                Vec::with_capacity(model.rises().count()),
            ),
        }
    }

    /// Returns the state that must be saved, without values that the next step computes again.
    pub(super) fn kept(&self) -> Watch {
        let mut kept = self.clone();
        let lags = kept.bank.iter_mut().map(|gathered| &mut gathered.lag).chain(&mut kept.shadows);
        lags.for_each(|lag| *lag = lag.kept().into());
        (kept.of_terms, kept.substitutions, kept.beginnings, kept.tried) = Default::default();
        kept
    }

    /// Restores the saved state, if it belongs to the same model and the same stand-ins file.
    pub(super) fn recall(&mut self, kept: &Watch) {
        let sizes = |watch: &Watch| (watch.sensors.len(), watch.bank.len(), watch.shadows.len());
        let is_same = kept.file == self.file && kept.numbers == self.numbers && kept.terms == self.terms;
        if is_same && sizes(kept) == sizes(self) {
            let Watch { of_terms, substitutions, beginnings, tried, .. } =
                std::mem::replace(self, kept.clone());
            (self.of_terms, self.substitutions, self.beginnings, self.tried) =
                (of_terms, substitutions, beginnings, tried);
        }
    }

    /// Handles a time of length `span` in which the gateway did not run. The lags are advanced over this time. If this
    /// time was longer than [`PAUSE`], the earlier predictions are discarded.
    pub(super) fn away(&mut self, span: Duration) {
        if span > PAUSE {
            self.sensors.iter_mut().for_each(Sensor::away);
            self.until = None;
            self.bank.iter_mut().for_each(BankInput::begin_minute);
        }
        let lags = self.bank.iter_mut().map(|gathered| &mut gathered.lag).chain(&mut self.shadows);
        lags.for_each(|lag| *lag = lag.kept().map(|lagged| lagged.away(span)).into());
    }

    /// Returns the substitutes for the rejected readings.
    pub(super) fn substitutions(&self) -> &[Substitution] {
        &self.substitutions
    }

    /// Returns the rejected sensors, each with the number of other sensors that its stand-in uses.
    pub(super) fn rejected<'a>(
        &'a self,
        settings: &'a StandIns,
    ) -> impl Iterator<Item = RejectedSensor> + 'a {
        settings.sensors().iter().zip(&self.sensors).filter_map(|(known, sensor)| {
            let (since, frozen) = sensor.rejected()?;
            let signal = known.signal;
            let mut stood_in = self.substitutions.iter().filter(|substitution| substitution.has_source());
            let others = stood_in.any(|substitution| substitution.signal == signal).then_some(known.others);
            Some(RejectedSensor { signal, since, frozen, others })
        })
    }

    /// Resets predictions, lags and shadows after a machine start.
    pub(super) fn started(&mut self, model: &Model, settings: &StandIns, now: Moment) {
        self.sensors.iter_mut().for_each(|sensor| sensor.started(now));
        for (input, shadow) in model.rises().zip(&mut self.shadows) {
            shadow.started(input);
        }
        for (predictor, gathered) in settings.bank().iter().zip(&mut self.bank) {
            gathered.lag.started(&predictor.input);
            gathered.ready = Moment::default();
        }
        self.begin_minute(now);
        self.fill((model, settings), None, now);
    }

    /// Accepts every sensor that has a reading, because the operator has checked the sensors.
    pub(super) fn trust(&mut self, (model, settings): (&Model, &StandIns), machine: &Machine, now: Moment) {
        for (sensor, beginning) in self.sensors.iter_mut().zip(&mut self.beginnings) {
            if let Some(Verdict::Accepted(found)) = sensor.trust(now) {
                *beginning = found;
            }
        }
        self.fill((model, settings), Some(machine), now);
    }

    /// Checks the readings of the sensors before lags and references use them. `every`: intended time between two
    /// checks.
    pub(super) fn check(
        &mut self,
        (model, settings): (&Model, &StandIns),
        snapshot: &Snapshot<'_>,
        machine: &Machine,
        every: Duration,
    ) {
        let now = snapshot.now;
        let longest = PAUSE.max(every.saturating_mul(2));
        if self.looked.is_some_and(|last| now < last || now.since(last) > longest) {
            self.sensors.iter_mut().for_each(Sensor::pause);
            self.begin_minute(now);
        }
        self.looked = Some(now);
        for (known, sensor) in settings.sensors().iter().zip(&mut self.sensors) {
            sensor.check(snapshot.reading(known.signal), now);
        }
        self.fill((model, settings), Some(machine), now);
    }

    /// Computes the substitutes for the rejected readings. `machine` is `None` while no reference has been captured. A
    /// frozen sensor without a stand-in becomes suspected.
    fn fill(&mut self, (model, settings): (&Model, &StandIns), machine: Option<&Machine>, now: Moment) {
        self.substitutions.clear();
        for (place, known) in settings.sensors().iter().enumerate() {
            let may = known.may_replace(self.sensors[place].is_frozen())
                && !self.depends_on_suspected(settings, known);
            let sensor = &mut self.sensors[place];
            let Some((since, frozen)) = sensor.rejected().filter(|_| !sensor.is_suspected()) else {
                continue;
            };
            let said = sensor.stand_in(now).filter(|_| may);
            let source =
                said.map_or(SubstituteSource::None, |rise| source(sensor, known.signal, rise, machine));
            let substitution = Substitution { signal: known.signal, frozen, since, source };
            if frozen && !answers(model, &substitution, machine, now) {
                sensor.suspect();
                continue;
            }
            // If a sensor has no good reading, the reading itself gives the reason.
            if source != SubstituteSource::None || sensor.reads(now) {
                self.substitutions.push(substitution);
            }
        }
    }

    fn depends_on_suspected(&self, settings: &StandIns, known: &VirtualSensor) -> bool {
        let of = |place: &usize| settings.bank()[*place].sensor;
        known.terms.iter().filter_map(|(place, _)| of(place)).any(|sensor| self.sensors[sensor].is_doubted())
    }

    /// Updates the shadows and the inputs of the predictions, after the lags of the model. At the end of a minute,
    /// judges each sensor. `lags`: lags of the model. If a stand-in now replaces a sensor, the lags of this sensor are
    /// set to their shadows. `seen`: the snapshot as the model uses it.
    pub(super) fn follow(
        &mut self,
        (model, settings, bounds): (&Model, &StandIns, Bounds<'_>),
        lags: &mut [Lag],
        seen: &Snapshot<'_>,
        machine: &Machine,
    ) {
        self.follow_shadows(model, lags, seen, machine);
        for (predictor, gathered) in settings.bank().iter().zip(&mut self.bank) {
            gathered.follow(predictor, seen, machine);
        }
        let now = seen.now;
        let until = *self.until.get_or_insert(now.after(MINUTE));
        if now >= until || until.since(now) > MINUTE {
            self.assess((model, settings, bounds), seen, machine, lags);
            self.begin_minute(now);
        }
    }

    /// Updates the shadows to the values that the lags would have if the sensor had been frozen since its last change.
    /// A shadow without a prediction, or of a lost sensor, does not change.
    fn follow_shadows(&mut self, model: &Model, lags: &[Lag], seen: &Snapshot<'_>, machine: &Machine) {
        let shadows = model.rises().zip(lags).zip(&mut self.shadows).zip(&self.of_terms);
        for (((input, lag), shadow), sensor) in shadows {
            let sensor = sensor.map(|place| &self.sensors[place]).filter(|sensor| !sensor.is_lost());
            let Some(sensor) = sensor else { continue };
            if sensor.renewed {
                *shadow = *lag;
                continue;
            }
            let start = machine.captured(Reference::Start, input.signal);
            let Some((value, start)) = sensor.shadowed().zip(start) else { continue };
            let source = SubstituteSource::Predictors { value: Some(value), rise: value - start.value.get() };
            let substitution =
                Substitution { signal: input.signal, frozen: true, since: sensor.changed(), source };
            shadow.follow(input, &Snapshot { substitutions: &[substitution], ..*seen }, machine);
        }
        for sensor in self.sensors.iter_mut().filter(|sensor| sensor.is_live()) {
            sensor.renewed = false;
        }
    }

    /// Judges each sensor by the minute that has ended: it may become suspected, replaced by its stand-in, or accepted
    /// again.
    fn assess(
        &mut self,
        (model, settings, bounds): (&Model, &StandIns, Bounds<'_>),
        seen: &Snapshot<'_>,
        machine: &Machine,
        lags: &mut [Lag],
    ) {
        let inputs = Inputs { snapshot: *seen, machine, lags: &[], splits_slope: false };
        if let Some(envelope) = &model.envelope {
            for (predictor, gathered) in settings.bank().iter().zip(&mut self.bank) {
                gathered.check_bank_range(predictor, envelope, &inputs);
            }
        }
        for (place, known) in settings.sensors().iter().enumerate() {
            let prediction = self.predict((model, settings), place, &inputs);
            let reading = seen.reading(known.signal);
            match self.sensors[place].assess(prediction, reading, known.threshold, seen.now) {
                Verdict::AsBefore => {}
                Verdict::Accepted(beginning) => self.beginnings[place] = beginning,
            }
        }
        self.fill((model, settings), Some(machine), seen.now);
        for place in 0..self.sensors.len() {
            let moved = self.moved_by((model, settings, bounds), place, lags, seen, machine);
            if moved.is_some_and(|moved| moved <= bounds.step.get()) {
                if self.sensors[place].shadowed().is_some() {
                    let terms = lags.iter_mut().zip(&self.shadows).zip(&self.of_terms);
                    terms.filter(|(_, of)| **of == Some(place)).for_each(|((lag, shadow), _)| *lag = *shadow);
                }
                self.sensors[place].substitute();
                self.fill((model, settings), Some(machine), seen.now);
            }
        }
    }

    /// Returns the change of the axis's target, µm, that would occur if a stand-in replaced this sensor from now on.
    /// `None` if the sensor is not suspected, if it has no stand-in, or if the model has no value.
    fn moved_by(
        &mut self,
        (model, settings, bounds): (&Model, &StandIns, Bounds<'_>),
        place: usize,
        lags: &[Lag],
        seen: &Snapshot<'_>,
        machine: &Machine,
    ) -> Option<f64> {
        let (sensor, known) = (&self.sensors[place], settings.sensors().get(place)?);
        let may =
            known.may_replace(true) && sensor.is_suspected() && !self.depends_on_suspected(settings, known);
        let (since, frozen) = sensor.rejected().filter(|_| may)?;
        let source = source(sensor, known.signal, sensor.said()?, Some(machine));
        let substitution = Substitution { signal: known.signal, frozen, since, source };
        if !answers(model, &substitution, Some(machine), seen.now) {
            return None;
        }
        let has_shadow = sensor.shadowed().is_some();
        let (all, others) = &mut self.tried;
        all.clear();
        all.extend(self.substitutions.iter().copied().chain([substitution]));
        others.clear();
        let terms = lags.iter().zip(&self.shadows).zip(&self.of_terms);
        others.extend(terms.map(|((lag, shadow), of)| match has_shadow && *of == Some(place) {
            true => *shadow,
            false => *lag,
        }));
        let target = |substitutions: &[Substitution], lags: &[Lag]| {
            let snapshot = Snapshot { substitutions, is_followed: false, ..*seen };
            (bounds.target)(&Inputs { snapshot, machine, lags, splits_slope: bounds.splits_slope })
        };
        let (before, after) = (target(&self.substitutions, lags)?, target(all, others)?);
        let (of_cz, of_slope) = (after.0 - before.0, after.1 - before.1);
        Some(of_cz.abs().get().max(of_slope.abs().get()))
    }

    /// Returns the prediction of one sensor for the minute that has ended.
    fn predict(
        &self,
        (model, settings): (&Model, &StandIns),
        place: usize,
        inputs: &Inputs<'_>,
    ) -> Prediction {
        let (known, sensor) = (&settings.sensors()[place], &self.sensors[place]);
        let predicted = self.sum(settings, known, &inputs.snapshot);
        let predicted = predicted.filter(|predicted| predicted.rise.is_finite());
        let Some(envelope) = &model.envelope else {
            return predicted.map_or(Prediction::Missing, Prediction::Known);
        };
        let mut places = known.terms.iter().map(|(place, _)| *place);
        let is_far = envelope.beyond_range(known.signal, inputs).is_some_and(|share| share > FAR);
        if is_far || places.clone().any(|place| self.bank[place].beyond) {
            let is_near = |place: usize| self.bank[place].is_near(&settings.bank()[place], envelope, inputs);
            let is_near = !is_far && places.all(is_near);
            return Prediction::Outside(predicted.filter(|_| is_near).map(|predicted| predicted.rise));
        }
        let Some(predicted) = predicted else { return Prediction::Missing };
        let used = match source(sensor, known.signal, predicted.rise, Some(inputs.machine)) {
            SubstituteSource::Predictors { rise, .. } => rise,
            SubstituteSource::None => predicted.rise,
        };
        let own = Input::of(known.signal, Reference::Start, None);
        let edge = if sensor.is_outside() { 0.0 } else { EDGE };
        let inside = envelope.rise_beyond_range(&own, used).is_none_or(|share| share <= edge);
        Prediction::Known(Predicted { inside, ..predicted })
    }

    /// Returns the predicted rise of one sensor, the sum of its terms; `None` if one of its predictors has no value.
    fn sum(&self, settings: &StandIns, known: &VirtualSensor, seen: &Snapshot<'_>) -> Option<Predicted> {
        let mut predicted = Predicted { rise: 0.0, lent: false, present: true, inside: true };
        for (place, gain) in &known.terms {
            let (predictor, gathered) = (&settings.bank()[*place], &self.bank[*place]);
            let is_doubted = predictor.sensor.is_some_and(|sensor| self.sensors[sensor].is_doubted());
            let (rise, lent) = gathered.rise(is_doubted, seen.now)?;
            predicted.rise += gain * rise;
            predicted.lent |= lent;
            let signal = predictor.input.signal;
            predicted.present &= seen.instead_of(signal).is_none() && seen.reading(signal).is_some();
        }
        Some(predicted)
    }

    fn begin_minute(&mut self, now: Moment) {
        self.until = Some(now.after(MINUTE));
        self.bank.iter_mut().for_each(BankInput::begin_minute);
    }

    /// Calls `take` for each sensor that was accepted again since the last call, with the estimate of its reading at
    /// machine start. Then discards the estimates.
    pub(super) fn take_beginnings(
        &mut self,
        settings: &StandIns,
        mut take: impl FnMut(SignalId, StartEstimate),
    ) {
        for (known, beginning) in settings.sensors().iter().zip(&mut self.beginnings) {
            if let Some(beginning) = beginning.take() {
                take(known.signal, beginning);
            }
        }
    }
}

/// Returns the source of a substitute for a sensor, from its predicted rise.
fn source(sensor: &Sensor, signal: SignalId, rise: f64, machine: Option<&Machine>) -> SubstituteSource {
    let value = sensor.value(rise);
    let start = machine.and_then(|machine| machine.captured(Reference::Start, signal));
    let rise = value.zip(start).map_or(rise, |(value, start)| value - start.value.get());
    SubstituteSource::Predictors { value, rise }
}

/// Returns whether a substitute for a sensor provides every input that a model and its envelope take from this sensor.
fn answers(model: &Model, substitution: &Substitution, machine: Option<&Machine>, now: Moment) -> bool {
    let Some(machine) = machine.filter(|_| substitution.has_source()) else { return false };
    let only_this = [*substitution];
    let snapshot = Snapshot { substitutions: &only_this, ..Snapshot::new(now, &[]) };
    let is_known = |input: &Input| input.level(&snapshot, machine).is_ok();
    let mut own = model.rises().filter(|input| input.signal == substitution.signal).peekable();
    if own.peek().is_none() && substitution.value().is_none() {
        return false;
    }
    let of_envelope = model.envelope.iter().flat_map(Envelope::inputs).map(|known| &known.input);
    own.all(is_known) && of_envelope.filter(|input| input.signal == substitution.signal).all(is_known)
}

//! The stuck test, and what is used instead of a sensor that is frozen or lost. Pure, and no allocation in a step.
//!
//! x̂ is what the others predict of a sensor, as the mean of a minute; s the moment at which its reading last changed, y
//! the reading then. A machine that rests predicts no motion: a reading that stands is frozen only where
//!
//! ```text
//! D = |x̂(now) − x̂(s)| > θ          0 while the reading changed less than 3 min ago
//! ```
//!
//! Three minutes of that in a row are a suspicion: it is reported, and the reading is used all the same. Its value is `y + x̂ − x̂(s)`
//! instead, and the lags of its terms are those that have followed this since s, if that moves the target by one step of the axis at
//! most: beside each lag runs its shadow, which is the lag at every change of the reading and follows the prediction in between. A
//! sensor that is lost is replaced from its last good reading on, one that was lost when the machine started by x̂ as its rise.
//!
//! # Rules
//! - A suspicion alone never makes an axis hold. Where nobody stands in for a sensor that is suspected, its reading serves for
//!   everything, but for the predictions of others. So it does for the models whose own watch has no stand-in for it.
//! - A sensor that others stand in for, or that was lost and is not believed yet, is used for nothing itself: where nobody says
//!   what a lost one would read, lags wait, nothing is learned, and no reference is captured from it.
//! - A stand-in is never an input of another: what is suspected, frozen or lost predicts nothing. It serves the test alone, so that
//!   a second sensor that freezes is found too.
//! - A stand-in depends on two other sensors or more, and both they and it are inside the ranges on which the model was
//!   identified: the envelope says so, input by input. Its distance does not count: a sensor that is frozen moves it itself. While one
//!   of the others is beyond its range, or the sensor itself or what follows the others by more than a tenth of that, it is not
//!   suspected either. For a frozen sensor the last value from inside serves meanwhile: its own reading is older than that.
//! - A mean is that of the readings that there were. A prediction ends with the first whole minute in which one of those
//!   it depends on had none, and where nobody looked for two minutes. For a frozen sensor the last one serves for ten minutes more;
//!   then the reading of the sensor is used again.
//! - There is none while a lag that it depends on began on a warm machine less than five of its time constants ago.
//! - A sensor that others stand in for is believed again when it has moved and stayed within θ of the prediction for an hour, and when
//!   a person disarms its axis, who has looked; one that is suspected, when it moves. Lost for less than 3 min it was the line that
//!   was lost, and it is believed at once; so it is where nobody could have said meanwhile what it reads, and where for an hour
//!   nobody can.
//! - What it would have read when the machine started is then what it reads less its predicted rise, where nothing was
//!   captured that can be believed.
//! - A machine start begins everything anew. Frozen stays frozen until it has moved.

use std::time::Duration;

use super::Snapshot;
use super::instead::{Instead, Says};
use super::model::stand_ins::{StandIns, VirtualSensor};
use super::model::{Envelope, Input, Inputs, Lag, Model, Reference};
use super::reference::Machine;
use crate::quantity::{Micron, Moment, shifted};
use crate::reading::SignalId;

mod bank;
mod sensor;

use bank::{EDGE, FAR, Gathered};
pub(super) use sensor::Beginning;
use sensor::{Predicted, Prediction, Sensor, Verdict};
use serde::{Deserialize, Serialize};

/// What a prediction is the mean over.
const MINUTE: Duration = Duration::from_secs(60);
/// Where nobody looked for longer, what was predicted before says nothing of now.
const PAUSE: Duration = Duration::from_secs(2 * 60);

/// A sensor that others stand in for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoodIn {
    /// Which.
    pub signal: SignalId,
    /// Its reading last changed, or was last good, then.
    pub since: Moment,
    /// It reads the same all the time; else it is lost.
    pub frozen: bool,
    /// How many others say what it would read.
    pub others: usize,
}

/// A sensor of an axis that is not believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distrusted {
    /// Which.
    pub signal: SignalId,
    /// Its reading last changed, or was last good, then.
    pub since: Moment,
    /// It reads the same all the time; else it was lost.
    pub frozen: bool,
    /// How many others stand in for it; `None` if none do: the reading of a frozen one is used all the same.
    pub others: Option<usize>,
}

shifted!(StoodIn: since);

/// The watch over the sensors of one model. What it knows is kept over a restart, and in the first row of a log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Watch {
    /// Name of the model.
    pub(super) model: String,
    /// Fingerprint of the file of stand-ins.
    pub(super) file: u64,
    /// Offset and gains that the profile gives the model.
    numbers: Vec<f64>,
    /// What the terms of the model read.
    #[serde(default)]
    terms: Vec<TermOfModel>,
    /// By sensor of the file.
    sensors: Vec<Sensor>,
    /// By place in the bank.
    bank: Vec<Gathered>,
    /// By term of the model.
    shadows: Vec<Lag>,
    /// When the minute ends.
    until: Option<Moment>,
    /// When it looked last.
    #[serde(default)]
    looked: Option<Moment>,
    /// By term of the model: the sensor that it reads.
    #[serde(skip)]
    of_terms: Vec<Option<usize>>,
    /// What is not believed now; it never grows beyond the sensors.
    #[serde(skip)]
    instead: Vec<Instead>,
    /// By sensor, where it was believed again in this step: what it began from.
    #[serde(skip)]
    beginnings: Vec<Option<Beginning>>,
    /// Room to try a substitution in.
    #[serde(skip)]
    tried: (Vec<Instead>, Vec<Lag>),
}

/// How far a substitution may move the target of the axis.
#[derive(Clone, Copy)]
pub(super) struct Bounds<'a> {
    /// The largest step of the axis.
    pub(super) step: Micron,
    /// The control multiplies the slope by the distance itself.
    pub(super) splits_slope: bool,
    /// Cz, and the effect of the slope at the reach, that the axis would follow: as its envelope fades them and with what probings have
    /// taught. `None` if the model has no value.
    pub(super) target: &'a dyn Fn(&Inputs<'_>) -> Option<(Micron, Micron)>,
}

/// Signal that a term reads, by its place in the list of signals, and the time constant of its lag.
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
            bank: vec![Gathered::default(); settings.bank().len()],
            shadows: model.rises().map(|_| Lag::default()).collect(),
            of_terms: model.rises().map(|input| place(input.signal)).collect(),
            until: None,
            looked: None,
            instead: Vec::with_capacity(settings.sensors().len()),
            beginnings: vec![None; settings.sensors().len()],
            tried: (
                Vec::with_capacity(settings.sensors().len() + 1),
                Vec::with_capacity(model.rises().count()),
            ),
        }
    }

    /// The same, as it is kept: lags at rest, and nothing that the next step finds out anew.
    pub(super) fn kept(&self) -> Watch {
        let mut kept = self.clone();
        let lags = kept.bank.iter_mut().map(|gathered| &mut gathered.lag).chain(&mut kept.shadows);
        lags.for_each(|lag| *lag = lag.kept().into());
        (kept.of_terms, kept.instead, kept.beginnings, kept.tried) = Default::default();
        kept
    }

    /// Takes up what was kept of this model with this file.
    pub(super) fn recall(&mut self, kept: &Watch) {
        let sizes = |watch: &Watch| (watch.sensors.len(), watch.bank.len(), watch.shadows.len());
        let is_same = kept.file == self.file && kept.numbers == self.numbers && kept.terms == self.terms;
        if is_same && sizes(kept) == sizes(self) {
            let Watch { of_terms, instead, beginnings, tried, .. } = std::mem::replace(self, kept.clone());
            (self.of_terms, self.instead, self.beginnings, self.tried) =
                (of_terms, instead, beginnings, tried);
        }
    }

    /// Takes in how long the machine was away. Lags follow over that time; predictions from before it end.
    pub(super) fn away(&mut self, span: Duration) {
        if span > PAUSE {
            self.sensors.iter_mut().for_each(Sensor::away);
            self.until = None;
            self.bank.iter_mut().for_each(Gathered::begin_minute);
        }
        let lags = self.bank.iter_mut().map(|gathered| &mut gathered.lag).chain(&mut self.shadows);
        lags.for_each(|lag| *lag = lag.kept().map(|lagged| lagged.away(span)).into());
    }

    /// What is used instead of readings.
    pub(super) fn instead(&self) -> &[Instead] {
        &self.instead
    }

    /// The sensors that are not believed, with how many others stand in for each.
    pub(super) fn distrusted<'a>(&'a self, settings: &'a StandIns) -> impl Iterator<Item = Distrusted> + 'a {
        settings.sensors().iter().zip(&self.sensors).filter_map(|(known, sensor)| {
            let (since, frozen) = sensor.distrusted()?;
            let signal = known.signal;
            let mut stood_in = self.instead.iter().filter(|instead| instead.is_stood_in());
            let others = stood_in.any(|instead| instead.signal == signal).then_some(known.others);
            Some(Distrusted { signal, since, frozen, others })
        })
    }

    /// The machine was started: everything begins anew.
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

    /// A person has looked: every sensor that reads something is believed.
    pub(super) fn trust(&mut self, (model, settings): (&Model, &StandIns), machine: &Machine, now: Moment) {
        for (sensor, beginning) in self.sensors.iter_mut().zip(&mut self.beginnings) {
            if let Some(Verdict::Believed(found)) = sensor.trust(now) {
                *beginning = found;
            }
        }
        self.fill((model, settings), Some(machine), now);
    }

    /// Looks at the readings before anything goes on to them. `every`: how often that is meant to be.
    pub(super) fn look(
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
            sensor.look(snapshot.reading(known.signal), now);
        }
        self.fill((model, settings), Some(machine), now);
    }

    /// What is used instead, as it is known now. Without a machine nothing was captured yet. A frozen sensor that nobody stands in
    /// for any more is suspected.
    fn fill(&mut self, (model, settings): (&Model, &StandIns), machine: Option<&Machine>, now: Moment) {
        self.instead.clear();
        for (place, known) in settings.sensors().iter().enumerate() {
            let may = known.stands_in && !self.rests_on_a_doubted_one(settings, known);
            let sensor = &mut self.sensors[place];
            let Some((since, frozen)) = sensor.distrusted().filter(|_| !sensor.is_suspected()) else {
                continue;
            };
            let said = sensor.stand_in(now).filter(|_| may);
            let says = said.map_or(Says::Nobody, |rise| says(sensor, known.signal, rise, machine));
            let instead = Instead { signal: known.signal, frozen, since, says };
            if frozen && !answers(model, &instead, machine, now) {
                sensor.suspect();
                continue;
            }
            // Of one that reads nothing the reading itself says why.
            if says != Says::Nobody || sensor.reads(now) {
                self.instead.push(instead);
            }
        }
    }

    fn rests_on_a_doubted_one(&self, settings: &StandIns, known: &VirtualSensor) -> bool {
        let of = |place: &usize| settings.bank()[*place].sensor;
        known.terms.iter().filter_map(|(place, _)| of(place)).any(|sensor| self.sensors[sensor].is_doubted())
    }

    /// After the lags of the model have gone on: their shadows and the bank do, and where the minute is over what
    /// it says is looked at. `lags`: of one that is frozen they become their shadows. `seen`: the readings as the model
    /// sees them.
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
            self.judge((model, settings, bounds), seen, machine, lags);
            self.begin_minute(now);
        }
    }

    /// A shadow goes on as its lag would, had the sensor frozen at its last change. Where nobody says how, it waits. Of a lost sensor
    /// it stays as it is.
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
            let says = Says::Others { value: Some(value), rise: value - start.value.get() };
            let instead = Instead { signal: input.signal, frozen: true, since: sensor.changed(), says };
            shadow.follow(input, &Snapshot { instead: &[instead], ..*seen }, machine);
        }
        for sensor in self.sensors.iter_mut().filter(|sensor| sensor.is_live()) {
            sensor.renewed = false;
        }
    }

    /// What the minute that is over says of each sensor.
    fn judge(
        &mut self,
        (model, settings, bounds): (&Model, &StandIns, Bounds<'_>),
        seen: &Snapshot<'_>,
        machine: &Machine,
        lags: &mut [Lag],
    ) {
        let inputs = Inputs { snapshot: *seen, machine, lags: &[], splits_slope: false };
        if let Some(envelope) = &model.envelope {
            for (predictor, gathered) in settings.bank().iter().zip(&mut self.bank) {
                gathered.look_at_range(predictor, envelope, &inputs);
            }
        }
        for (place, known) in settings.sensors().iter().enumerate() {
            let prediction = self.predict((model, settings), place, &inputs);
            let reading = seen.reading(known.signal);
            match self.sensors[place].judge(prediction, reading, known.threshold, seen.now) {
                Verdict::AsBefore => {}
                Verdict::Believed(beginning) => self.beginnings[place] = beginning,
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

    /// By how much the target would move, µm, if others stood in for this sensor from now on. `None` if it is not suspected, if nobody can
    /// stand in, or if the model has no value.
    fn moved_by(
        &mut self,
        (model, settings, bounds): (&Model, &StandIns, Bounds<'_>),
        place: usize,
        lags: &[Lag],
        seen: &Snapshot<'_>,
        machine: &Machine,
    ) -> Option<f64> {
        let (sensor, known) = (&self.sensors[place], settings.sensors().get(place)?);
        let may = known.stands_in && sensor.is_suspected() && !self.rests_on_a_doubted_one(settings, known);
        let (since, frozen) = sensor.distrusted().filter(|_| may)?;
        let says = says(sensor, known.signal, sensor.said()?, Some(machine));
        let instead = Instead { signal: known.signal, frozen, since, says };
        if !answers(model, &instead, Some(machine), seen.now) {
            return None;
        }
        let has_shadow = sensor.shadowed().is_some();
        let (all, others) = &mut self.tried;
        all.clear();
        all.extend(self.instead.iter().copied().chain([instead]));
        others.clear();
        let terms = lags.iter().zip(&self.shadows).zip(&self.of_terms);
        others.extend(terms.map(|((lag, shadow), of)| match has_shadow && *of == Some(place) {
            true => *shadow,
            false => *lag,
        }));
        let target = |instead: &[Instead], lags: &[Lag]| {
            let snapshot = Snapshot { instead, is_followed: false, ..*seen };
            (bounds.target)(&Inputs { snapshot, machine, lags, splits_slope: bounds.splits_slope })
        };
        let (before, after) = (target(&self.instead, lags)?, target(all, others)?);
        let (of_cz, of_slope) = (after.0 - before.0, after.1 - before.1);
        Some(of_cz.abs().get().max(of_slope.abs().get()))
    }

    /// What the minute says of one sensor.
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
        let used = match says(sensor, known.signal, predicted.rise, Some(inputs.machine)) {
            Says::Others { rise, .. } => rise,
            Says::Nobody => predicted.rise,
        };
        let own = Input::of(known.signal, Reference::Start, None);
        let edge = if sensor.is_outside() { 0.0 } else { EDGE };
        let inside = envelope.rise_beyond_range(&own, used).is_none_or(|share| share <= edge);
        Prediction::Known(Predicted { inside, ..predicted })
    }

    /// The sum of the terms of one sensor; `None` where somebody is missing who is needed for that.
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
        self.bank.iter_mut().for_each(Gathered::begin_minute);
    }

    /// Of each sensor that was believed again since this was asked: what it began from.
    pub(super) fn take_beginnings(&mut self, settings: &StandIns, mut take: impl FnMut(SignalId, Beginning)) {
        for (known, beginning) in settings.sensors().iter().zip(&mut self.beginnings) {
            if let Some(beginning) = beginning.take() {
                take(known.signal, beginning);
            }
        }
    }
}

/// What others say of a sensor, where they predict this rise of it.
fn says(sensor: &Sensor, signal: SignalId, rise: f64, machine: Option<&Machine>) -> Says {
    let value = sensor.value(rise);
    let start = machine.and_then(|machine| machine.captured(Reference::Start, signal));
    let rise = value.zip(start).map_or(rise, |(value, start)| value - start.value.get());
    Says::Others { value, rise }
}

/// Returns whether everything that a model and its envelope take of a sensor is known of what others say.
fn answers(model: &Model, instead: &Instead, machine: Option<&Machine>, now: Moment) -> bool {
    let Some(machine) = machine.filter(|_| instead.is_stood_in()) else { return false };
    let instead_of_it = [*instead];
    let snapshot = Snapshot { instead: &instead_of_it, ..Snapshot::new(now, &[]) };
    let is_known = |input: &Input| input.level(&snapshot, machine).is_ok();
    let mut own = model.rises().filter(|input| input.signal == instead.signal).peekable();
    if own.peek().is_none() && instead.value().is_none() {
        return false;
    }
    let of_envelope = model.envelope.iter().flat_map(Envelope::inputs).map(|known| &known.input);
    own.all(is_known) && of_envelope.filter(|input| input.signal == instead.signal).all(is_known)
}

//! What the other sensors say of a sensor: a virtual sensor for each, as it was identified beside a model.
//!
//! The rise of a sensor since the machine's start is a sum over lagged rises of others. Where it moves by more than the
//! sensor's threshold while the sensor reads the same, the sensor is frozen; what it should read is then the prediction.

use super::{Input, Reference};
use crate::reading::SignalId;

/// A prediction is used for a reading only if it depends on so many others: the fault of a single one would pass into it whole.
const FEWEST: usize = 2;

/// The virtual sensors of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct StandIns {
    sensors: Vec<VirtualSensor>,
    /// What they are predicted from: each input once.
    bank: Vec<Predictor>,
    /// Of the file they stand in: what was kept with another one is not theirs.
    fingerprint: u64,
}

/// A sensor as a file describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Described {
    /// Which.
    pub signal: SignalId,
    /// θ, °C: a prediction that moved by more, while the reading stood, says that the sensor is frozen.
    pub threshold: f64,
    /// The prediction is good enough to be used for the reading. One that depends on a single other sensor never is.
    pub stands_in: bool,
    /// By signal and time constant of the lag: °C per °C.
    pub terms: Vec<(Input, f64)>,
}

/// A sensor that others predict.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct VirtualSensor {
    pub(in crate::compensation) signal: SignalId,
    pub(in crate::compensation) threshold: f64,
    pub(in crate::compensation) stands_in: bool,
    /// How many others it is predicted from.
    pub(in crate::compensation) others: usize,
    /// Places in the bank, with their gains.
    pub(in crate::compensation) terms: Vec<(usize, f64)>,
}

/// An input of the bank.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct Predictor {
    pub(in crate::compensation) input: Input,
    /// The virtual sensor of the same signal.
    pub(in crate::compensation) sensor: Option<usize>,
}

impl StandIns {
    /// Of these sensors. A term without a gain is none.
    pub fn new(described: Vec<Described>, fingerprint: u64) -> StandIns {
        let place = |signal: SignalId| described.iter().position(|sensor| sensor.signal == signal);
        let mut bank: Vec<Predictor> = Vec::new();
        let mut sensors = Vec::new();
        for sensor in &described {
            let mut terms = Vec::new();
            for (input, gain) in sensor.terms.iter().filter(|(_, gain)| gain.abs() > 0.0) {
                let known = bank.iter().position(|known| known.input == *input);
                if known.is_none() {
                    bank.push(Predictor { input: *input, sensor: place(input.signal) });
                }
                terms.push((known.unwrap_or(bank.len() - 1), *gain));
            }
            let mut others: Vec<SignalId> =
                terms.iter().map(|(place, _)| bank[*place].input.signal).collect();
            others.sort();
            others.dedup();
            let Described { signal, threshold, .. } = *sensor;
            let stands_in = sensor.stands_in && others.len() >= FEWEST;
            sensors.push(VirtualSensor { signal, threshold, stands_in, others: others.len(), terms });
        }
        StandIns { sensors, bank, fingerprint }
    }

    /// Of what file they are.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// The sensors that are watched, with whether another value can be used for each, in the file's order.
    pub fn watched(&self) -> impl Iterator<Item = (SignalId, bool)> + '_ {
        self.sensors.iter().map(|sensor| (sensor.signal, sensor.stands_in))
    }

    /// What a sensor is predicted from; a signal that counts with several lags is named as often.
    pub fn predictors(&self, signal: SignalId) -> impl Iterator<Item = SignalId> {
        let sensor = self.sensors.iter().filter(move |sensor| sensor.signal == signal);
        sensor.flat_map(|sensor| &sensor.terms).map(|(place, _)| self.bank[*place].input.signal)
    }

    pub(in crate::compensation) fn sensors(&self) -> &[VirtualSensor] {
        &self.sensors
    }

    pub(in crate::compensation) fn bank(&self) -> &[Predictor] {
        &self.bank
    }
}

impl Described {
    /// A term of a prediction: a rise since the machine's start, at once or lagged.
    pub fn term(signal: SignalId, lag: Option<std::time::Duration>, gain: f64) -> (Input, f64) {
        (Input::of(signal, Reference::Start, lag), gain)
    }
}

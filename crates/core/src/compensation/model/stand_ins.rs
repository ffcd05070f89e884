//! Predictions of a sensor from other sensors: a virtual sensor for each sensor, identified together with a model.
//!
//! The rise of a sensor since machine start is a sum over lagged rises of others. If it moves by more than the sensor's
//! threshold while the reading is constant, the sensor is suspected. Its stand-in is then the prediction.

use super::{Input, Reference};
use crate::reading::SignalId;

/// Minimum number of predictors of a stand-in. With a single one, its fault would pass fully into the stand-in.
const FEWEST: usize = 2;

/// Virtual sensors of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct StandIns {
    sensors: Vec<VirtualSensor>,
    /// Inputs of all predictions, each once.
    bank: Vec<Predictor>,
    /// Fingerprint of the stand-ins file. State that was kept with another file is not used.
    fingerprint: u64,
}

/// Virtual sensor as a file describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Described {
    /// Signal of the sensor.
    pub signal: SignalId,
    /// Threshold θ, °C. The sensor is frozen if its prediction has moved by more than θ since its reading last changed.
    pub threshold: f64,
    /// The prediction replaces a lost sensor. It is `false` if a model without the sensor leaves less residual error.
    /// A frozen sensor is replaced in both cases. A prediction from a single other sensor replaces nothing.
    pub stands_in: bool,
    /// Gain of each input, °C per °C.
    pub terms: Vec<(Input, f64)>,
}

/// Faults of a sensor in which its stand-in is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replaces {
    /// None: the prediction depends on a single other sensor.
    Nothing,
    /// A frozen sensor. A model without the sensor is better if the sensor is lost, because the stand-in of a lost sensor
    /// may be used for days. The stand-in of a frozen sensor starts from its last reading, and replaces a wrong value.
    Frozen,
    /// A frozen or lost sensor.
    FrozenOrLost,
}

/// Sensor that is predicted from others.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct VirtualSensor {
    pub(in crate::compensation) signal: SignalId,
    pub(in crate::compensation) threshold: f64,
    pub(in crate::compensation) replaces: Replaces,
    /// Number of other sensors from which this one is predicted.
    pub(in crate::compensation) others: usize,
    /// Indices in the bank, with their gains.
    pub(in crate::compensation) terms: Vec<(usize, f64)>,
}

/// Input of the bank.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct Predictor {
    pub(in crate::compensation) input: Input,
    /// Index of the virtual sensor of the same signal; `None` if there is none.
    pub(in crate::compensation) sensor: Option<usize>,
}

impl VirtualSensor {
    /// Returns whether the stand-in may be used. `frozen`: the sensor is frozen; otherwise it is lost.
    pub(in crate::compensation) fn may_replace(&self, frozen: bool) -> bool {
        match self.replaces {
            Replaces::Nothing => false,
            Replaces::Frozen => frozen,
            Replaces::FrozenOrLost => true,
        }
    }
}

impl StandIns {
    /// Creates the virtual sensors. Terms without a gain are dropped.
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
            let replaces = match sensor.stands_in {
                _ if others.len() < FEWEST => Replaces::Nothing,
                true => Replaces::FrozenOrLost,
                false => Replaces::Frozen,
            };
            sensors.push(VirtualSensor { signal, threshold, replaces, others: others.len(), terms });
        }
        StandIns { sensors, bank, fingerprint }
    }

    /// Returns the fingerprint of the file.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Returns the watched sensors in the file's order, each with the use of its stand-in.
    pub fn watched(&self) -> impl Iterator<Item = (SignalId, Replaces)> + '_ {
        self.sensors.iter().map(|sensor| (sensor.signal, sensor.replaces))
    }

    /// Returns the predictors of a sensor. A signal with several lags occurs several times.
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
    /// Creates a term of a prediction: a rise since machine start, with or without a lag.
    pub fn term(signal: SignalId, lag: Option<std::time::Duration>, gain: f64) -> (Input, f64) {
        (Input::of(signal, Reference::Start, lag), gain)
    }
}

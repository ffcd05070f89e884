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
    /// Threshold θ, °C. A prediction that moved by more while the reading was constant shows that the sensor is frozen.
    pub threshold: f64,
    /// The prediction is good enough to be used as a stand-in. A prediction from a single other sensor never is.
    pub stands_in: bool,
    /// Gain of each input, °C per °C.
    pub terms: Vec<(Input, f64)>,
}

/// Sensor that is predicted from others.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct VirtualSensor {
    pub(in crate::compensation) signal: SignalId,
    pub(in crate::compensation) threshold: f64,
    pub(in crate::compensation) stands_in: bool,
    /// Number of predictors.
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
            let stands_in = sensor.stands_in && others.len() >= FEWEST;
            sensors.push(VirtualSensor { signal, threshold, stands_in, others: others.len(), terms });
        }
        StandIns { sensors, bank, fingerprint }
    }

    /// Returns the fingerprint of the file.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Returns the watched sensors in the file's order. The boolean tells whether a stand-in can be used.
    pub fn watched(&self) -> impl Iterator<Item = (SignalId, bool)> + '_ {
        self.sensors.iter().map(|sensor| (sensor.signal, sensor.stands_in))
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

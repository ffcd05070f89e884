//! Predictions of a sensor from other sensors: each sensor of a model gets a virtual sensor, which is identified
//! together with the model.
//!
//! The predicted rise of a sensor since machine start is a sum over lagged rises of other sensors. If the prediction
//! changes by more than the sensor's threshold while its reading is constant, the sensor is suspected to be frozen. The
//! prediction may then replace the reading, as the sensor's stand-in.

use super::{Input, Reference};
use crate::reading::SignalId;

/// Minimum number of other sensors in a prediction that replaces a reading. With a single other sensor, a fault of that
/// sensor would affect the stand-in fully.
const FEWEST: usize = 2;

/// Virtual sensors of a model: predictions of its sensors from each other.
#[derive(Clone, Debug, PartialEq)]
pub struct StandIns {
    sensors: Vec<VirtualSensor>,
    /// Inputs (other sensors with their lags) that the predictions use. An input of several predictions is listed only
    /// once.
    bank: Vec<Predictor>,
    /// Fingerprint (hash) of the stand-ins file. A state that was saved with another file is not used.
    fingerprint: u64,
}

/// Virtual sensor as the stand-ins file describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct Described {
    /// Signal of the sensor that is predicted.
    pub signal: SignalId,
    /// Threshold θ, °C. The sensor is suspected to be frozen if its prediction has changed by more than θ since its
    /// reading last changed.
    pub threshold: f64,
    /// Whether the prediction replaces a lost sensor. It is `false` if a model without the sensor leaves less residual
    /// error. A frozen sensor is replaced in both cases. A prediction from a single other sensor replaces nothing.
    pub stands_in: bool,
    /// Inputs of the prediction, each with its gain in °C per °C.
    pub terms: Vec<(Input, f64)>,
}

/// Faults of a sensor for which its stand-in replaces the reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replaces {
    /// No fault, because the prediction depends on a single other sensor.
    Nothing,
    /// The sensor is frozen. A lost sensor is not replaced: it may be lost for days, and a model without the sensor is
    /// then better. The stand-in of a frozen sensor starts from its last reading, and replaces a wrong value.
    Frozen,
    /// The sensor is frozen or lost.
    FrozenOrLost,
}

/// Sensor that is predicted from other sensors.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct VirtualSensor {
    pub(in crate::compensation) signal: SignalId,
    pub(in crate::compensation) threshold: f64,
    pub(in crate::compensation) replaces: Replaces,
    /// Number of other sensors from which this sensor is predicted.
    pub(in crate::compensation) others: usize,
    /// Terms of the prediction: indices in the common list of inputs, with their gains.
    pub(in crate::compensation) terms: Vec<(usize, f64)>,
}

/// Input of predictions: another sensor with its lag. The predictions of all sensors use one common list of inputs.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::compensation) struct Predictor {
    pub(in crate::compensation) input: Input,
    /// Index of the virtual sensor with the signal of this input; `None` if the signal has no virtual sensor.
    pub(in crate::compensation) sensor: Option<usize>,
}

impl VirtualSensor {
    /// Returns whether the stand-in may replace the reading. `frozen`: the sensor is frozen; otherwise it is lost.
    pub(in crate::compensation) fn may_replace(&self, frozen: bool) -> bool {
        match self.replaces {
            Replaces::Nothing => false,
            Replaces::Frozen => frozen,
            Replaces::FrozenOrLost => true,
        }
    }
}

impl StandIns {
    /// Creates the virtual sensors of a model. Terms with a gain of zero are left out.
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

    /// Returns the fingerprint (hash) of the stand-ins file.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Returns the sensors with a prediction in the order of the file, each with the faults for which its stand-in is
    /// used.
    pub fn watched(&self) -> impl Iterator<Item = (SignalId, Replaces)> + '_ {
        self.sensors.iter().map(|sensor| (sensor.signal, sensor.replaces))
    }

    /// Returns the signals from which a sensor is predicted. A signal with several lags occurs several times.
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
    /// Creates a term of a prediction: a rise of a signal since machine start, with or without a lag, and its gain.
    pub fn term(signal: SignalId, lag: Option<std::time::Duration>, gain: f64) -> (Input, f64) {
        (Input::of(signal, Reference::Start, lag), gain)
    }
}

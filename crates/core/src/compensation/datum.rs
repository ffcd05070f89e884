//! Datum of an axis: the zero point from which its Cz is measured, `Cz(t) − Cz(t_zero)`.
//!
//! If a workpiece is referenced on a warm machine, the drift so far is part of its datum. Compensating the whole drift
//! would count that part twice. After a zero command, the value that each model requests is therefore captured, as the
//! mean over the machine's settling time. From then on, this mean is subtracted from the model's value. Until the
//! capture is complete, the old datum is used. A model without a value during the capture gets the datum of the first
//! model that had a value. A change between the two models then causes no jump.

use serde::{Deserialize, Serialize};

use super::model::Outputs;
use crate::quantity::{Micron, MicronPerMillimetre, Moment};

/// Datum (zero point of Cz) of one axis, for each of its models.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Zeroing {
    models: Vec<Level>,
    /// End of a running capture; `None` if no capture is running.
    until: Option<Moment>,
    /// Time at which the last capture was complete; `None` before the first capture.
    at: Option<Moment>,
}

/// Datum (zero point of Cz) of one model, and the sums of a running capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Level {
    cz: Micron,
    slope: MicronPerMillimetre,
    #[serde(default)]
    apart: Micron,
    sum: (f64, f64),
    #[serde(default)]
    sum_apart: f64,
    count: u32,
}

impl Zeroing {
    pub(super) fn new(models: usize) -> Zeroing {
        Zeroing { models: vec![Level::default(); models], until: None, at: None }
    }

    pub(super) fn restored(models: Vec<Level>, until: Option<Moment>, at: Option<Moment>) -> Zeroing {
        Zeroing { models, until, at }
    }

    /// Returns the datum of each model, and the end of a running capture (`None` if no capture is running), for saving.
    pub(super) fn kept(&self) -> (&[Level], Option<Moment>) {
        (&self.models, self.until)
    }

    /// Returns the time at which the capture of the datum in use was complete; `None` before the first capture.
    pub(super) fn at(&self) -> Option<Moment> {
        self.at
    }

    pub(super) fn is_open(&self) -> bool {
        self.until.is_some()
    }

    /// Returns the datum of a model: Cz and slope that are subtracted from the Cz and slope that the model requests.
    pub(super) fn of(&self, model: usize) -> Outputs {
        self.models.get(model).map_or(Outputs::default(), |level| {
            let Level { cz, slope, apart, .. } = *level;
            Outputs { cz, slope, apart }
        })
    }

    /// Changes the datum of a model so that its Cz increases by `by`, µm. Nothing changes if the result is not finite.
    pub(super) fn raise(&mut self, model: usize, by: f64) {
        let level = self.models.get_mut(model);
        let moved = level.and_then(|level| Some((Micron::new(level.cz.get() - by)?, level)));
        if let Some((cz, level)) = moved {
            level.cz = cz;
        }
    }

    pub(super) fn begin(&mut self, until: Moment) {
        self.until = Some(until);
        for level in &mut self.models {
            (level.sum, level.sum_apart, level.count) = ((0.0, 0.0), 0.0, 0);
        }
    }

    /// Adds the values that the models request now to a running capture. The capture is complete when its time is over
    /// and at least one model has had a value.
    pub(super) fn gather(&mut self, now: Moment, evaluate: impl Fn(usize) -> Option<Outputs>) {
        let Some(until) = self.until else { return };
        for (place, level) in self.models.iter_mut().enumerate() {
            if let Some(outputs) = evaluate(place) {
                level.sum = (level.sum.0 + outputs.cz.get(), level.sum.1 + outputs.slope.get());
                level.sum_apart += outputs.apart.get();
                level.count += 1;
            }
        }
        let first = self.models.iter().find_map(Level::mean);
        if let Some(first) = first.filter(|_| now >= until) {
            for level in &mut self.models {
                let Outputs { cz, slope, apart } = level.mean().unwrap_or(first);
                *level = Level { cz, slope, apart, ..Level::default() };
            }
            (self.until, self.at) = (None, Some(now));
        }
    }
}

impl Level {
    /// Returns the mean of the captured values; `None` if no value was captured, or if the mean is not finite.
    fn mean(&self) -> Option<Outputs> {
        let count = f64::from(self.count);
        let mean = Outputs::of(self.sum.0 / count, self.sum.1 / count).ok()?;
        Some(Outputs { apart: Micron::new(self.sum_apart / count)?, ..mean })
    }
}

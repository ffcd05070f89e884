//! The datum of an axis: `Cz(t) − Cz(t_zero)`.
//!
//! A workpiece that is referenced on a warm machine has the drift of that moment in its datum; compensating all of it
//! again would count it twice. At a zero what each model asks for is captured, as the mean over the machine's settling
//! time, and subtracted from then on. Until it is complete the old one serves. A model that had no value meanwhile takes
//! the datum of the first that had, so that changing to it is no jump.

use serde::{Deserialize, Serialize};

use super::model::Outputs;
use crate::quantity::{Micron, MicronPerMillimetre, Moment};

/// The datum of one axis, model by model.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Zeroing {
    models: Vec<Level>,
    /// A capture is under way and ends here.
    until: Option<Moment>,
    /// When the last one was complete.
    at: Option<Moment>,
}

/// What is subtracted from one model, and the mean that will be.
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

    pub(super) fn recalled(models: Vec<Level>, until: Option<Moment>, at: Option<Moment>) -> Zeroing {
        Zeroing { models, until, at }
    }

    /// By model, and when a capture under way ends.
    pub(super) fn kept(&self) -> (&[Level], Option<Moment>) {
        (&self.models, self.until)
    }

    /// When the datum that serves was complete; `None` before the first.
    pub(super) fn at(&self) -> Option<Moment> {
        self.at
    }

    pub(super) fn is_open(&self) -> bool {
        self.until.is_some()
    }

    /// What is to be subtracted from what a model asks for.
    pub(super) fn of(&self, model: usize) -> Outputs {
        self.models.get(model).map_or(Outputs::default(), |level| {
            let Level { cz, slope, apart, .. } = *level;
            Outputs { cz, slope, apart }
        })
    }

    pub(super) fn begin(&mut self, until: Moment) {
        self.until = Some(until);
        for level in &mut self.models {
            (level.sum, level.sum_apart, level.count) = ((0.0, 0.0), 0.0, 0);
        }
    }

    /// Takes in what the models ask for now; complete once the time is over and at least one had a value.
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
    /// `None` where nothing was counted, or the sum is no finite number.
    fn mean(&self) -> Option<Outputs> {
        let count = f64::from(self.count);
        let mean = Outputs::of(self.sum.0 / count, self.sum.1 / count).ok()?;
        Some(Outputs { apart: Micron::new(self.sum_apart / count)?, ..mean })
    }
}

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
}

/// What is subtracted from one model, and the mean that will be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Level {
    cz: Micron,
    slope: MicronPerMillimetre,
    sum: (f64, f64),
    count: u32,
}

impl Zeroing {
    pub(super) fn new(models: usize) -> Zeroing {
        Zeroing { models: vec![Level::default(); models], until: None }
    }

    pub(super) fn recalled(models: Vec<Level>, until: Option<Moment>) -> Zeroing {
        Zeroing { models, until }
    }

    /// By model, and when a capture under way ends.
    pub(super) fn kept(&self) -> (&[Level], Option<Moment>) {
        (&self.models, self.until)
    }

    pub(super) fn is_open(&self) -> bool {
        self.until.is_some()
    }

    /// What is to be subtracted from what a model asks for.
    pub(super) fn of(&self, model: usize) -> Outputs {
        self.models
            .get(model)
            .map_or(Outputs::default(), |level| Outputs { cz: level.cz, slope: level.slope })
    }

    pub(super) fn begin(&mut self, until: Moment) {
        self.until = Some(until);
        for level in &mut self.models {
            (level.sum, level.count) = ((0.0, 0.0), 0);
        }
    }

    /// Takes in what the models ask for now; complete once the time is over and at least one had a value.
    pub(super) fn gather(&mut self, now: Moment, evaluate: impl Fn(usize) -> Option<Outputs>) {
        let Some(until) = self.until else { return };
        for (place, level) in self.models.iter_mut().enumerate() {
            if let Some(outputs) = evaluate(place) {
                level.sum = (level.sum.0 + outputs.cz.get(), level.sum.1 + outputs.slope.get());
                level.count += 1;
            }
        }
        let first = self.models.iter().find_map(Level::mean);
        if let Some(first) = first.filter(|_| now >= until) {
            for level in &mut self.models {
                let Outputs { cz, slope } = level.mean().unwrap_or(first);
                *level = Level { cz, slope, ..Level::default() };
            }
            self.until = None;
        }
    }
}

impl Level {
    /// `None` where nothing was counted, or the sum is no finite number.
    fn mean(&self) -> Option<Outputs> {
        let count = f64::from(self.count);
        Outputs::of(self.sum.0 / count, self.sum.1 / count).ok()
    }
}

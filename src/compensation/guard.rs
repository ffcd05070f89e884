//! The guard between a model and a register: limit → deadband → step → rate → whole counts.
//!
//! Each stage says when it acted. Two numbers are kept: where the offset is in µm, and the whole counts of it
//! that were decided; without the first, a rate of less than one count per update would never move at all.

use std::fmt;
use std::time::Duration;

use super::settings::GuardSettings;
use crate::quantity::Micron;

/// Which stages changed the value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Stages(u8);

impl Stages {
    /// The model asked for more than the limit.
    pub const LIMIT: Stages = Stages(1);
    /// The change was too small to be made.
    pub const DEADBAND: Stages = Stages(2);
    /// The change was cut to the largest step.
    pub const STEP: Stages = Stages(4);
    /// The change was cut to the largest speed.
    pub const RATE: Stages = Stages(8);
    /// The value was rounded to whole counts.
    pub const ROUND: Stages = Stages(16);

    /// Every stage with its name, in the order in which they stand.
    pub const ALL: [(Stages, &'static str); 5] = [
        (Stages::LIMIT, "limit"),
        (Stages::DEADBAND, "deadband"),
        (Stages::STEP, "step"),
        (Stages::RATE, "rate"),
        (Stages::ROUND, "round"),
    ];

    /// This stage is among them.
    pub fn contains(self, stage: Stages) -> bool {
        self.0 & stage.0 == stage.0
    }

    fn add_if(&mut self, acted: bool, stage: Stages) {
        if acted {
            self.0 |= stage.0;
        }
    }
}

/// `limit+step`; nothing where none acted.
impl fmt::Display for Stages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut between = "";
        for (_, name) in Stages::ALL.iter().filter(|(stage, _)| self.contains(*stage)) {
            write!(f, "{between}{name}")?;
            between = "+";
        }
        Ok(())
    }
}

/// How a change is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pace {
    /// Towards a model's value: every stage.
    Follow,
    /// To rest, at the axis's rate.
    Ramp,
    /// To rest, one whole step at every update.
    Steps,
}

/// Where the offset is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Guard {
    place: Micron,
    counted: Micron,
}

impl Guard {
    /// Takes over what stands in the register. Rounded towards rest, so that it is inside the limit.
    pub(super) fn take_over(&mut self, found: Micron, settings: &GuardSettings) {
        self.place = found.clamp_to(settings.limit);
        self.counted = self.place;
    }

    /// The value decided last: whole counts.
    pub(super) fn value(&self) -> Micron {
        self.counted
    }

    /// Moves towards `target` as far as `dt` and the settings allow.
    pub(super) fn advance(
        &mut self,
        target: Micron,
        dt: Duration,
        pace: Pace,
        settings: &GuardSettings,
    ) -> (Micron, Stages) {
        let mut stages = Stages::default();
        let inside = target.clamp_to(settings.limit);
        stages.add_if(inside != target, Stages::LIMIT);

        let change = inside - self.place;
        let idle = pace == Pace::Follow && change != Micron::ZERO && change.abs() <= settings.deadband;
        stages.add_if(idle, Stages::DEADBAND);
        if !idle {
            let (allowed, stage) = allowance(dt, pace, settings);
            let cut = change.clamp_to(allowed);
            stages.add_if(cut != change, stage);
            self.place = if cut == change { inside } else { self.place + cut };
        }
        let rounded = self.whole_counts(settings);
        stages.add_if(rounded != self.place, Stages::ROUND);
        self.counted = rounded;
        (rounded, stages)
    }

    /// The whole counts nearest to the place, unless they lie outside the limit or a step away from the last
    /// value: then the next ones inwards.
    fn whole_counts(&self, settings: &GuardSettings) -> Micron {
        let Some(count) = settings.count else { return self.place };
        let (place, last, count) = (self.place.get(), self.counted.get(), count.get());
        let (limit, step) = (settings.limit.get(), settings.step.get() * (1.0 + 1e-9));
        let nearest = (place / count).round();
        let fits = |counts: f64| {
            let value = counts * count;
            value.abs() <= limit && (value - last).abs() <= step
        };
        let inwards = if nearest * count > last { nearest - 1.0 } else { nearest + 1.0 };
        let chosen = [nearest, inwards].into_iter().find(|counts| fits(*counts));
        chosen.and_then(|counts| Micron::new(counts * count)).unwrap_or(self.counted)
    }
}

/// The largest change now, and the stage that sets it.
fn allowance(dt: Duration, pace: Pace, settings: &GuardSettings) -> (Micron, Stages) {
    let by_rate = Micron::new(settings.rate * dt.as_secs_f64()).unwrap_or(settings.step);
    if pace != Pace::Steps && by_rate < settings.step {
        (by_rate, Stages::RATE)
    } else {
        (settings.step, Stages::STEP)
    }
}

#[cfg(test)]
mod tests;

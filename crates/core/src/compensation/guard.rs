//! Limiter between a model and a register (the guard). Its stages limit → deadband → step → rate → whole counts bound
//! each change of the offset. The offset is Cz, the compensation value of an axis, or the part of the compensation that
//! depends on the position (effect of the slope).
//!
//! Each stage reports if it changed the value. The limiter stores two numbers: the offset in µm, and the decided offset
//! in whole counts. With the counts alone, a rate of less than one count per update would never change the offset.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::settings::GuardSettings;
use crate::quantity::Micron;

mod deadband;

/// Set of the limits (limit, deadband, step, rate, rounding) that changed a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Stages(u8);

impl Stages {
    /// The model requested more than the limit, so the value was reduced to the limit.
    pub const LIMIT: Stages = Stages(1);
    /// The change was smaller than the deadband and was not made.
    pub const DEADBAND: Stages = Stages(2);
    /// The change was reduced to the largest step.
    pub const STEP: Stages = Stages(4);
    /// The change was reduced to the largest speed (`rate`).
    pub const RATE: Stages = Stages(8);
    /// The value was rounded to whole counts of the register.
    pub const ROUND: Stages = Stages(16);

    /// All stages with their names, in the order in which they act.
    pub const ALL: [(Stages, &'static str); 5] = [
        (Stages::LIMIT, "limit"),
        (Stages::DEADBAND, "deadband"),
        (Stages::STEP, "step"),
        (Stages::RATE, "rate"),
        (Stages::ROUND, "round"),
    ];

    /// Returns whether these stages include `stage`.
    pub fn contains(self, stage: Stages) -> bool {
        self.0 & stage.0 == stage.0
    }

    /// Returns the stages that are in at least one of the two sets.
    pub(super) fn and(self, other: Stages) -> Stages {
        Stages(self.0 | other.0)
    }

    fn add_if(&mut self, acted: bool, stage: Stages) {
        if acted {
            self.0 |= stage.0;
        }
    }
}

/// Formats the stages as `limit+step`; without stages, as an empty text.
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

/// Kind of change of Cz, which determines the limits that apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pace {
    /// Cz follows the value of a model. Every limit applies.
    Follow,
    /// Cz goes to zero at the axis's rate, without deadband.
    Ramp,
    /// Cz goes to zero by the largest step at every update. The limit of the speed does not apply.
    Steps,
}

/// Limiter of one offset, which is Cz or the effect of the slope (position-dependent part of the compensation).
/// `place`: the offset in µm before rounding. `counted`: the same offset, rounded to whole counts of the register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Guard {
    place: Micron,
    counted: Micron,
}

impl Guard {
    /// Takes over the register value `found`, as whole counts inside the limit. An axis that keeps its value then never
    /// writes a value beyond the limit.
    pub(super) fn take_over(&mut self, found: Micron, settings: &GuardSettings) {
        let inside = found.clamp_to(settings.limit);
        self.place = settings.count.map_or(inside, |count| Grid { count, settings }.nearest(inside));
        self.counted = self.place;
    }

    /// Limits the decided value to at most one step from the verified value `behind`. Returns the decided value.
    pub(super) fn stay_near(&mut self, behind: Micron, settings: &GuardSettings) -> Micron {
        let near = behind + (self.counted - behind).clamp_to(settings.step);
        if near != self.counted {
            self.take_over(near, settings);
        }
        self.counted
    }

    /// Returns the last decided value, µm. The value is a whole number of counts.
    pub(super) fn value(&self) -> Micron {
        self.counted
    }

    /// Moves the offset towards `target`, as far as the settings allow in the time `dt`. Returns the decided value, and
    /// the stages that changed it.
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
        let idle = pace == Pace::Follow && deadband::suppresses(change, settings.deadband);
        stages.add_if(idle, Stages::DEADBAND);
        if !idle {
            let (allowed, stage) = allowance(dt, pace, settings);
            let cut = change.clamp_to(allowed);
            stages.add_if(cut != change, stage);
            self.place = if cut == change { inside } else { (self.place + cut).clamp_to(settings.limit) };
        }
        stages.0 |= self.count_off(settings).0;
        (self.counted, stages)
    }

    /// Rounds the offset to whole counts: the count nearest to `place` that is inside the limit and at most one step
    /// from the previous result. Returns the stages that changed the value.
    fn count_off(&mut self, settings: &GuardSettings) -> Stages {
        let mut stages = Stages::default();
        let Some(count) = settings.count else {
            self.counted = self.place;
            return stages;
        };
        let grid = Grid { count, settings };
        let wanted = grid.nearest(self.place);
        self.counted = grid.nearest_within_step(self.place, self.counted);
        stages.add_if((self.counted - self.place).abs().get() > SAME * count.get(), Stages::ROUND);
        if self.counted != wanted {
            // A step that is not a multiple of the count: the place waits, else it would run away from the counts.
            stages.add_if(true, Stages::STEP);
            let half = Micron::new(count.get() / 2.0).unwrap_or_default();
            self.place = self.counted + (self.place - self.counted).clamp_to(half);
        }
        stages
    }
}

/// Relative difference below which two values differ only by the rounding of the calculation.
const SAME: f64 = 1e-12;

/// Values that a register can hold: multiples of one count.
struct Grid<'a> {
    count: Micron,
    settings: &'a GuardSettings,
}

impl Grid<'_> {
    fn nearest(&self, place: Micron) -> Micron {
        self.value(self.counts(place))
    }

    fn nearest_within_step(&self, place: Micron, last: Micron) -> Micron {
        let (last, reach) = (self.counts(last), self.whole_in(self.settings.step));
        self.value(self.counts(place).min(last + reach).max(last - reach))
    }

    /// Returns the whole number of counts that is nearest to `place` and inside the limit.
    fn counts(&self, place: Micron) -> f64 {
        let most = self.whole_in(self.settings.limit);
        (place.get() / self.count.get()).round().min(most).max(-most)
    }

    fn whole_in(&self, span: Micron) -> f64 {
        (span.get() / self.count.get() * (1.0 + SAME)).floor()
    }

    /// Returns the value of this number of counts, µm. Adding zero turns −0 into 0. The clamp corrects the rounding by
    /// which 3 · 0.1 exceeds 0.3.
    fn value(&self, counts: f64) -> Micron {
        Micron::new(counts * self.count.get() + 0.0).unwrap_or_default().clamp_to(self.settings.limit)
    }
}

/// Returns the largest change of one update, and the limit that determines it: the rate times `dt`, or the step.
fn allowance(dt: Duration, pace: Pace, settings: &GuardSettings) -> (Micron, Stages) {
    let by_rate = Micron::new(settings.rate.get() * dt.as_secs_f64()).unwrap_or(settings.step);
    if pace != Pace::Steps && by_rate < settings.step {
        (by_rate, Stages::RATE)
    } else {
        (settings.step, Stages::STEP)
    }
}

#[cfg(test)]
mod tests;

//! The counts of a register, and what they are worth.

use crate::gateway::words::{counts_in_text, cz_factor, one_step};
use isotherm_core::codec::{Encoded, Encoding};
use isotherm_core::output::State;
use isotherm_core::quantity::Micron;
use isotherm_profile::{Output, Profile, Writes};

/// A register of a floating-point type has so many counts in a step: few enough that the 24 bits of a float tell the
/// counts of eight thousand steps apart.
const COUNTS_OF_A_STEP: f64 = 1000.0;
/// What no register of ours holds: where what stands there is no number.
const NO_NUMBER: i64 = i64::MAX / 4;

/// What a register's counts are worth.
#[derive(Clone, Copy, Debug)]
pub(in crate::gateway) struct Units {
    /// Of the register's unit for 1 µm.
    factor: f64,
    /// Of the register's unit for a count, where its type has none itself.
    grain: Option<f64>,
    bias: i64,
}

impl Units {
    pub(super) fn of(profile: &Profile, output: &Output) -> Units {
        let is_whole = output.encoding.data_type.integer_range().is_some();
        let grain = one_step(profile, output) / COUNTS_OF_A_STEP;
        Units {
            factor: cz_factor(profile, output),
            grain: (!is_whole).then_some(grain),
            bias: if is_whole { output.encoding.bias } else { 0 },
        }
    }

    /// Step, limit and bias of an output in counts. A reference position is no correction: it is written at once.
    pub(super) fn bounds(self, profile: &Profile, output: &Output) -> (i64, i64, i64) {
        if output.writes == Writes::Reference {
            return (NO_NUMBER, NO_NUMBER, self.bias);
        }
        let guard = &profile.axis(output.axis).settings.guard;
        let step = self.nearest(&output.encoding, one_step(profile, output)).abs().max(1);
        let limit = self.nearest(&output.encoding, guard.limit.get() * self.factor).abs();
        (step, limit, self.bias)
    }

    /// What stands in the register.
    pub(super) fn found(self, encoding: &Encoding, words: &[u16]) -> i64 {
        match self.grain {
            None => encoding.counts(words).map_or(NO_NUMBER, |counts| counts.saturating_add(self.bias)),
            Some(grain) => match encoding.decode(words) {
                Ok(value) if (value / grain).abs() < as_float(NO_NUMBER) => nearest(value / grain),
                _ => NO_NUMBER,
            },
        }
    }

    /// The registers that hold this.
    pub(super) fn registers(self, encoding: &Encoding, counts: i64) -> Encoded {
        match self.grain {
            None => encoding.encode_counts(counts.saturating_sub(self.bias)),
            Some(grain) => encoding.encode(as_float(counts) * grain),
        }
    }

    /// What the register's value is then, in its unit.
    pub(super) fn value(self, encoding: &Encoding, counts: i64) -> f64 {
        match self.grain {
            None => encoding.value_of(counts.saturating_sub(self.bias)),
            Some(grain) => as_float(counts) * grain,
        }
    }

    /// The Cz that it stands for.
    pub(super) fn cz(self, encoding: &Encoding, counts: i64) -> Micron {
        Micron::new(self.value(encoding, counts) / self.factor).unwrap_or_default()
    }

    /// The counts from the bias that come nearest to this Cz.
    pub(super) fn offset(self, encoding: &Encoding, cz: Micron) -> i64 {
        self.nearest(encoding, cz.get() * self.factor)
    }

    /// The counts from the bias that come nearest to this value of the register.
    pub(super) fn counts(self, encoding: &Encoding, value: f64) -> i64 {
        self.nearest(encoding, value)
    }

    /// The lowest and the highest count that the register holds.
    pub(super) fn range(self, encoding: &Encoding) -> (i64, i64) {
        match encoding.range_of_counts().filter(|_| self.grain.is_none()) {
            Some((low, high)) => (low.saturating_add(self.bias), high.saturating_add(self.bias)),
            None => (-NO_NUMBER, NO_NUMBER),
        }
    }

    /// Values of ours that may still appear in a register, for people.
    pub(in crate::gateway) fn may_arrive(profile: &Profile, output: &Output, state: &State) -> Vec<String> {
        let units = Units::of(profile, output);
        let stands = state.kept().stood;
        let sent =
            state.copies().under_way().filter(|sent| sent.answered.is_none() && Some(sent.value) != stands);
        let mut values: Vec<i64> = sent.map(|sent| sent.value).collect();
        values.dedup();
        values.into_iter().map(|value| units.in_text(output, value)).collect()
    }

    /// What so many counts are worth, in the register's unit.
    pub(super) fn part(self, encoding: &Encoding, counts: i64) -> f64 {
        self.value(encoding, counts.saturating_add(self.bias))
    }

    /// The Cz that a share of so many counts is.
    pub(super) fn cz_of_share(self, encoding: &Encoding, share: i64) -> Micron {
        self.cz(encoding, share.saturating_add(self.bias))
    }

    /// For people.
    pub(super) fn in_text(self, output: &Output, counts: i64) -> String {
        match self.grain {
            _ if counts == NO_NUMBER => "no number".to_owned(),
            None => counts_in_text(output, counts.saturating_sub(self.bias)),
            Some(grain) => format!("{:.4} {}", as_float(counts) * grain, output.writes.unit()),
        }
    }

    fn nearest(self, encoding: &Encoding, value: f64) -> i64 {
        self.grain.map_or_else(|| encoding.nearest_counts(value), |grain| nearest(value / grain))
    }
}

#[allow(clippy::cast_possible_truncation, reason = "beyond 2^53 counts nothing is near")]
fn nearest(counts: f64) -> i64 {
    counts.round() as i64
}

#[allow(clippy::cast_precision_loss, reason = "no register holds 2^53 counts")]
fn as_float(counts: i64) -> f64 {
    counts as f64
}

//! What the counts of an output's register are worth, and what the axis may make of them.

use isotherm_core::codec::{ControlView, Encoded, Encoding, Inadmissible};
use isotherm_core::compensation::Decision;
use isotherm_core::output::State;
use isotherm_core::quantity::{Counts, Micron};
use isotherm_profile::{Output, Profile, Writes};

/// A register of a floating-point type has so many counts in a step: few enough that the 24 bits of a float tell the
/// counts of eight thousand steps apart.
const COUNTS_OF_A_STEP: f64 = 1000.0;
/// What no register of ours holds: where what stands there is no number.
const NO_NUMBER: Counts = Counts(i64::MAX / 4);

/// What the counts of one output's register are worth.
#[derive(Clone, Debug)]
pub(super) struct Units {
    encoding: Encoding,
    /// Of its value.
    unit: &'static str,
    /// Of the register's unit for 1 µm.
    factor: f64,
    /// Of the register's unit for a count, where its type has none itself.
    grain: Option<f64>,
    bias: Counts,
    /// How the control reads it; a reference position is no correction.
    control: Option<ControlView>,
}

impl Units {
    pub(super) fn of(profile: &Profile, output: &Output) -> Units {
        let is_whole = output.encoding.data_type.integer_range().is_some();
        let grain = one_step(profile, output) / COUNTS_OF_A_STEP;
        Units {
            encoding: output.encoding.clone(),
            unit: output.writes.unit(),
            factor: cz_factor(profile, output),
            grain: (!is_whole).then_some(grain),
            bias: if is_whole { Counts(output.encoding.bias) } else { Counts(0) },
            control: profile.control_view(output),
        }
    }

    /// Step, limit and bias of an output in counts. A reference position is no correction: it is written at once.
    pub(super) fn bounds(&self, profile: &Profile, output: &Output) -> (Counts, Counts, Counts) {
        if output.writes == Writes::Reference {
            return (NO_NUMBER, NO_NUMBER, self.bias);
        }
        let guard = &profile.axis(output.axis).settings.guard;
        let step = self.counts(one_step(profile, output)).abs().max(Counts(1));
        let limit = self.counts(guard.limit.get() * self.factor).abs();
        (step, limit, self.bias)
    }

    pub(super) fn found(&self, registers: &[u16]) -> Counts {
        match self.grain {
            None => self.encoding.counts(registers).map_or(NO_NUMBER, |counts| counts + self.bias),
            Some(grain) => match self.encoding.decode(registers) {
                Ok(value) if (value / grain).abs() < as_float(NO_NUMBER) => nearest(value / grain),
                _ => NO_NUMBER,
            },
        }
    }

    pub(super) fn registers(&self, counts: Counts) -> Encoded {
        match self.grain {
            None => self.encoding.encode_counts(counts - self.bias),
            Some(grain) => self.encoding.encode(as_float(counts) * grain),
        }
    }

    /// The registers of these counts, if the control reads in them what is meant. `base` is the operator's part of a shared
    /// register, `held` what the register holds now.
    pub(super) fn admitted(
        &self,
        counts: Counts,
        base: Option<Counts>,
        held: Counts,
    ) -> Result<Encoded, Inadmissible> {
        let encoded = self.registers(counts);
        let Some(control) = &self.control else { return Ok(encoded) };
        let value = |counts| control.value(self.registers(counts).registers());
        let centre = base.map_or(Some(0.0), value).ok_or(Inadmissible::NoNumber)?;
        let held = value(held).and_then(|held| control.micron(held - centre)).unwrap_or_default();
        let own = counts - base.map_or(Counts::ZERO, |base| base - self.bias);
        control.admit(encoded.registers(), self.cz(own), centre, held).map(|()| encoded)
    }

    /// What the register's value is then, in its unit.
    pub(super) fn value(&self, counts: Counts) -> f64 {
        match self.grain {
            None => self.encoding.value_of(counts - self.bias),
            Some(grain) => as_float(counts) * grain,
        }
    }

    pub(super) fn cz(&self, counts: Counts) -> Micron {
        Micron::new(self.value(counts) / self.factor).unwrap_or_default()
    }

    /// The counts from the bias that come nearest to this Cz.
    pub(super) fn offset(&self, cz: Micron) -> Counts {
        self.counts(cz.get() * self.factor)
    }

    /// The counts from the bias that come nearest to this value of the register.
    pub(super) fn counts(&self, value: f64) -> Counts {
        self.grain.map_or_else(|| self.encoding.nearest_counts(value), |grain| nearest(value / grain))
    }

    /// Thousandths of a count that the register has at this value of its unit. `None` if no register holds as many.
    pub(super) fn thousandths(&self, value: f64) -> Option<i64> {
        let thousandths = value / self.worth() * 1000.0 + as_float(self.bias) * 1000.0;
        (thousandths.abs() < as_float(NO_NUMBER)).then(|| nearest(thousandths).0)
    }

    /// A difference of values of the register's unit in thousandths of a count.
    pub(super) fn thousandths_of(&self, difference: f64) -> i64 {
        nearest((difference / self.worth()).abs() * 1000.0).0
    }

    /// Value of a count, in the register's unit.
    fn worth(&self) -> f64 {
        self.grain.unwrap_or_else(|| self.encoding.scale.get())
    }

    /// The lowest and the highest count that the register holds.
    pub(super) fn range(&self) -> (Counts, Counts) {
        match self.encoding.range_of_counts().filter(|_| self.grain.is_none()) {
            Some((low, high)) => (low + self.bias, high + self.bias),
            None => (-NO_NUMBER, NO_NUMBER),
        }
    }

    /// The Cz of each write that the register does not show yet and may still take.
    pub(super) fn may_arrive(&self, state: &State) -> Vec<String> {
        let operator = state.kept().account.map_or(Counts::ZERO, |account| account.base - self.bias);
        let mut values: Vec<Counts> = state.may_arrive().collect();
        values.dedup();
        values.into_iter().map(|value| self.cz(value - operator).to_string()).collect()
    }

    /// So many counts for people, in the register's unit.
    pub(super) fn in_text(&self, counts: Counts) -> String {
        let text = match self.grain {
            _ if counts == NO_NUMBER => return "no number".to_owned(),
            None => tidy(self.value(counts), &self.encoding),
            Some(grain) => format!("{:.4}", as_float(counts) * grain),
        };
        format!("{text} {}", self.unit)
    }
}

/// The largest change of one write, in the output's unit: whole counts, so that rounding cannot add to it.
fn one_step(profile: &Profile, output: &Output) -> f64 {
    let most = profile.axis(output.axis).settings.guard.step.get() * cz_factor(profile, output);
    match output.encoding.data_type.integer_range() {
        // What makes 3 · 0.1 a little more than 0.3 must not cost a count.
        Some(_) => {
            let count = output.encoding.scale.get().abs();
            (most / count * (1.0 + 1e-12)).floor() * count
        }
        None => most,
    }
}

/// What an output makes of a decision: Cz, or what the slope comes to at the axis's reach.
pub(super) fn part(decision: &Decision, writes: Writes) -> Micron {
    if writes == Writes::Slope { decision.slope } else { decision.cz }
}

/// Target of that part.
pub(super) fn target(decision: &Decision, writes: Writes) -> Micron {
    if writes == Writes::Slope { decision.slope_target } else { decision.target }
}

/// What stands in a register is what is wanted there, to half a count of this size. Beside an operator's part, `base`, their
/// sum is never made zero: where it would be, the count beside it is as near as it gets.
pub(super) fn is_near(cz: Micron, wanted: Micron, grain: f64, base: f64) -> bool {
    let would_be_zero = base != 0.0 && (base + wanted.get()).abs() < 0.6 * grain;
    (cz - wanted).abs().get() <= if would_be_zero { 1.1 } else { 0.6 } * grain
}

/// What 1 µm is in the register's unit. A diameter changes by twice what the radius does; a slope is its effect at the
/// axis's reach, divided by that.
pub(super) fn cz_factor(profile: &Profile, output: &Output) -> f64 {
    let axis = profile.axis(output.axis);
    match (output.writes, axis.settings.intercept_slope) {
        (Writes::Slope, Some(line)) => 1.0 / line.reach.get(),
        _ if axis.diameter => 2.0,
        _ => 1.0,
    }
}

/// Whether a register holds more than its axis may. The arithmetic between counts and µm must not decide that: half a
/// count more is the limit itself. A reference position is no correction and has no limit.
pub(super) fn is_beyond_limit(profile: &Profile, output: &Output, cz: Micron) -> bool {
    let limit = profile.axis(output.axis).settings.guard.limit.get();
    let slack = match output.encoding.data_type.integer_range() {
        Some(_) => 0.5 * output.encoding.scale.get().abs() / cz_factor(profile, output),
        // What is left of a number in the 24 bits of a float.
        None => limit * f64::from(f32::EPSILON),
    };
    output.writes != Writes::Reference && cz.abs().get() > limit + slack
}

/// What these registers of an output hold, for people.
pub(super) fn registers_in_text(output: &Output, registers: &[u16]) -> String {
    match output.encoding.decode(registers) {
        Ok(value) => format!("{} {}", tidy(value, &output.encoding), output.writes.unit()),
        Err(_) => format!("{registers:04x?}"),
    }
}

/// As many digits as a count has.
fn tidy(value: f64, encoding: &Encoding) -> String {
    let digits = (0..6).find(|digits| encoding.scale.get().abs() * 10f64.powi(*digits) >= 0.999).unwrap_or(6);
    format!("{value:.*}", usize::try_from(digits).unwrap_or(6))
}

#[allow(clippy::cast_possible_truncation, reason = "beyond 2^53 counts nothing is near")]
fn nearest(counts: f64) -> Counts {
    Counts(counts.round() as i64)
}

#[allow(clippy::cast_precision_loss, reason = "no register holds 2^53 counts")]
fn as_float(counts: Counts) -> f64 {
    counts.0 as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wanted_is_near_to_half_a_count_and_to_one_only_where_the_sum_would_be_zero() {
        let micron = |value| Micron::new(value).unwrap_or_default();
        for (cz, wanted, base, near) in [
            (0.0, 0.04, 0.0, true),
            (0.1, 0.0, 0.0, false),
            // A count of ours beside an operator's part is one too many.
            (0.1, 0.0, 200.0, false),
            (-0.1, 0.0, 200.0, false),
            (0.0, 0.0, 200.0, true),
            // His part is just what would make the sum zero.
            (4.9, 5.0, -5.0, true),
            (5.1, 5.0, -5.0, true),
            (4.8, 5.0, -5.0, false),
        ] {
            assert_eq!(is_near(micron(cz), micron(wanted), 0.1, base), near, "{cz} {wanted} {base}");
        }
    }
}

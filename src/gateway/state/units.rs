//! Conversion between the counts of an output's register, its values and Cz (compensation value). The types also
//! convert step and limit of the axis to counts.

use isotherm_core::codec::{ControlView, Encoded, Encoding, Inadmissible};
use isotherm_core::compensation::Decision;
use isotherm_core::output::State;
use isotherm_core::quantity::{Counts, Micron};
use isotherm_profile::{Output, Profile, Writes};

/// Number of counts in one step of a floating-point register. The 24-bit precision of a float is exact for up to
/// eight thousand steps.
const COUNTS_OF_A_STEP: f64 = 1000.0;
/// Count that stands for a register value that is not a number. No register can hold such a large count.
const NO_NUMBER: Counts = Counts(i64::MAX / 4);

/// Conversion between counts, register values and Cz for the register of one output. A count is the smallest change
/// of the register value that the gateway makes.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct Units {
    encoding: Encoding,
    /// Unit of the register value, as text for messages.
    unit: &'static str,
    /// Factor from Cz in µm to the register value.
    factor: f64,
    /// Size of one count of a floating-point register, in the unit of the register. `None` for an integer register,
    /// whose values are already counts.
    grain: Option<f64>,
    bias: Counts,
    /// Conversion by which the control of the machine gets a value from the register. `None` if the output
    /// writes the reference position P0 (position at which a slope has no effect), because P0 is not a
    /// correction.
    control: Option<ControlView>,
}

impl Units {
    pub(in crate::gateway) fn of(profile: &Profile, output: &Output) -> Units {
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

    /// Returns step, limit and bias of an output in counts. The reference position P0 is not a correction. P0 has no
    /// step limit, and is written at once.
    pub(in crate::gateway) fn bounds(&self, profile: &Profile, output: &Output) -> (Counts, Counts, Counts) {
        if output.writes == Writes::Reference {
            return (NO_NUMBER, NO_NUMBER, self.bias);
        }
        let guard = &profile.axis(output.axis).settings.guard;
        let step = self.counts(one_step(profile, output)).abs().max(Counts(1));
        let limit = self.counts(guard.limit.get() * self.factor).abs();
        (step, limit, self.bias)
    }

    pub(in crate::gateway) fn found(&self, registers: &[u16]) -> Counts {
        match self.grain {
            None => self.encoding.counts(registers).map_or(NO_NUMBER, |counts| counts + self.bias),
            Some(grain) => match self.encoding.decode(registers) {
                Ok(value) if (value / grain).abs() < as_float(NO_NUMBER) => nearest(value / grain),
                _ => NO_NUMBER,
            },
        }
    }

    pub(in crate::gateway) fn registers(&self, counts: Counts) -> Encoded {
        match self.grain {
            None => self.encoding.encode_counts(counts - self.bias),
            Some(grain) => self.encoding.encode(as_float(counts) * grain),
        }
    }

    /// Encodes these counts as registers, if the control would read the intended value from them. `base`: operator
    /// offset (part of a shared register's value that the operator entered). `held`: present register value.
    pub(in crate::gateway) fn admitted(
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

    /// Returns the register value for this number of counts, in the unit of the register.
    pub(in crate::gateway) fn value(&self, counts: Counts) -> f64 {
        match self.grain {
            None => self.encoding.value_of(counts - self.bias),
            Some(grain) => as_float(counts) * grain,
        }
    }

    pub(in crate::gateway) fn cz(&self, counts: Counts) -> Micron {
        Micron::new(self.value(counts) / self.factor).unwrap_or_default()
    }

    /// Returns the offset that is nearest to this Cz, in counts from the bias.
    pub(in crate::gateway) fn offset(&self, cz: Micron) -> Counts {
        self.counts(cz.get() * self.factor)
    }

    /// Returns the offset that is nearest to this register value, in counts from the bias.
    pub(in crate::gateway) fn counts(&self, value: f64) -> Counts {
        self.grain.map_or_else(|| self.encoding.nearest_counts(value), |grain| nearest(value / grain))
    }

    /// Converts a register value to thousandths of a count. `None` if the value is too large for every register, or
    /// not a number.
    pub(in crate::gateway) fn thousandths(&self, value: f64) -> Option<i64> {
        let thousandths = value / self.worth() * 1000.0 + as_float(self.bias) * 1000.0;
        (thousandths.abs() < as_float(NO_NUMBER)).then(|| nearest(thousandths).0)
    }

    /// Converts a difference of register values to thousandths of a count.
    pub(in crate::gateway) fn thousandths_of(&self, difference: f64) -> i64 {
        nearest((difference / self.worth()).abs() * 1000.0).0
    }

    /// Returns the change of the register value for one count.
    fn worth(&self) -> f64 {
        self.grain.unwrap_or_else(|| self.encoding.scale.get())
    }

    /// Returns the lowest and highest count that the register can hold.
    pub(in crate::gateway) fn range(&self) -> (Counts, Counts) {
        match self.encoding.range_of_counts().filter(|_| self.grain.is_none()) {
            Some((low, high)) => (low + self.bias, high + self.bias),
            None => (-NO_NUMBER, NO_NUMBER),
        }
    }

    /// Lists the writes that may still arrive and are not yet visible in the register. Each text is the Cz of one
    /// write.
    pub(in crate::gateway) fn may_arrive(&self, state: &State) -> Vec<String> {
        let operator = state.kept().account.map_or(Counts::ZERO, |account| account.base - self.bias);
        let mut values: Vec<Counts> = state.may_arrive().collect();
        values.dedup();
        values.into_iter().map(|value| self.cz(value - operator).to_string()).collect()
    }

    /// Formats counts as a register value with its unit.
    pub(in crate::gateway) fn in_text(&self, counts: Counts) -> String {
        let text = match self.grain {
            _ if counts == NO_NUMBER => return "no number".to_owned(),
            None => tidy(self.value(counts), &self.encoding),
            Some(grain) => format!("{:.4}", as_float(counts) * grain),
        };
        format!("{text} {}", self.unit)
    }
}

/// Returns the largest permitted change in one write, in the unit of the output. The change is a whole number of
/// counts, so that rounding does not increase it.
fn one_step(profile: &Profile, output: &Output) -> f64 {
    let most = profile.axis(output.axis).settings.guard.step.get() * cz_factor(profile, output);
    match output.encoding.data_type.integer_range() {
        // A rounding error, as in 3 · 0.1 > 0.3, must not cost a count.
        Some(_) => {
            let count = output.encoding.scale.get().abs();
            (most / count * (1.0 + 1e-12)).floor() * count
        }
        None => most,
    }
}

/// Returns the part of a decision that the output writes: Cz, or the effect of the slope at the axis's largest
/// distance from the reference position.
pub(in crate::gateway) fn part(decision: &Decision, writes: Writes) -> Micron {
    if writes == Writes::Slope { decision.slope } else { decision.cz }
}

/// Returns the target of the part that the output writes: the target of Cz, or the target of the position-dependent
/// part (slope).
pub(in crate::gateway) fn target(decision: &Decision, writes: Writes) -> Micron {
    if writes == Writes::Slope { decision.slope_target } else { decision.target }
}

/// Returns whether `cz` equals `wanted`, to half a count of the size `grain`. If `wanted` plus the operator
/// offset `base` is zero, the adjacent count is also accepted, because the gateway writes the adjacent count
/// in place of zero.
pub(super) fn is_near(cz: Micron, wanted: Micron, grain: f64, base: f64) -> bool {
    let would_be_zero = base != 0.0 && (base + wanted.get()).abs() < 0.6 * grain;
    (cz - wanted).abs().get() <= if would_be_zero { 1.1 } else { 0.6 } * grain
}

/// Returns the register value for 1 µm. A diameter changes by twice the change of the radius. The value of a slope is
/// its effect at the axis's largest distance from the reference position, divided by that distance.
pub(in crate::gateway) fn cz_factor(profile: &Profile, output: &Output) -> f64 {
    let axis = profile.axis(output.axis);
    match (output.writes, axis.settings.intercept_slope) {
        (Writes::Slope, Some(line)) => 1.0 / line.reach.get(),
        _ if axis.diameter => 2.0,
        _ => 1.0,
    }
}

/// Formats the value in the registers of an output as text.
pub(in crate::gateway) fn registers_in_text(output: &Output, registers: &[u16]) -> String {
    match output.encoding.decode(registers) {
        Ok(value) => format!("{} {}", tidy(value, &output.encoding), output.writes.unit()),
        Err(_) => format!("{registers:04x?}"),
    }
}

/// Formats a value with as many decimal places as one count has.
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
            // Next to an operator offset, a difference of one count is too large.
            (0.1, 0.0, 200.0, false),
            (-0.1, 0.0, 200.0, false),
            (0.0, 0.0, 200.0, true),
            // With this operator offset the sum would be zero.
            (4.9, 5.0, -5.0, true),
            (5.1, 5.0, -5.0, true),
            (4.8, 5.0, -5.0, false),
        ] {
            assert_eq!(is_near(micron(cz), micron(wanted), 0.1, base), near, "{cz} {wanted} {base}");
        }
    }
}

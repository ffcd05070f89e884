//! What an output's registers mean in the axis's terms.

use isotherm_core::codec::{Encoded, Encoding};
use isotherm_core::compensation::Decision;
use isotherm_core::quantity::Micron;
use isotherm_profile::{Output, Profile, Writes};

/// The largest change of one write, in the output's unit: whole counts, so that rounding cannot add to it.
pub(super) fn one_step(profile: &Profile, output: &Output) -> f64 {
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

pub(super) fn words_in_text(output: &Output, words: &Encoded) -> String {
    let unit = output.writes.unit();
    match output.encoding.decode(words.words()) {
        Ok(value) => format!("{} {unit}", tidy(value, &output.encoding)),
        Err(_) => format!("{:04x?}", words.words()),
    }
}

/// What so many counts of an output are worth.
pub(super) fn counts_in_text(output: &Output, counts: i64) -> String {
    format!("{} {}", tidy(output.encoding.value_of(counts), &output.encoding), output.writes.unit())
}

/// As many digits as a count has.
fn tidy(value: f64, encoding: &Encoding) -> String {
    let digits = (0..6).find(|digits| encoding.scale.get().abs() * 10f64.powi(*digits) >= 0.999).unwrap_or(6);
    format!("{value:.*}", usize::try_from(digits).unwrap_or(6))
}

pub(super) fn can_be_read(profile: &Profile, output: &Output) -> bool {
    profile.device(output.device).functions.reads_at(&output.reads_at())
}

//! Range of the counts that an output can write, calculated from the limits of its axis. Also describes the
//! written quantity for the preview.

use super::Output;
use super::share::Share;
use super::writes::{MICRONS, Writes};
use crate::Profile;
use crate::document::figure;
use crate::tables::axis::Axis;
use crate::tables::{Check, KeyContext};
use isotherm_core::quantity::Micron;

/// Checks that each output can hold every value of its axis. Stores at each axis the largest size of one count among
/// its outputs, in µm. A change of Cz by this size changes the count of every output.
pub(in crate::tables) fn note_counts(check: &mut Check<'_>) {
    for output in check.outputs.valid() {
        let at = check.at("output").key(&output.name);
        if let Some(axis) = check.axes.get(output.axis.0) {
            can_move(check, &at, output, axis);
        }
    }
    for output in check.outputs.resolved.iter().flatten() {
        if let Some(Some(axis)) = check.axes.resolved.get_mut(output.axis.0) {
            note_count(axis, output);
        }
    }
}

/// Describes for the preview the written quantity, the sign, and the counts for a change of the quantity.
pub(super) fn meaning(output: &Output, axis: &Axis, profile: &Profile) -> String {
    let per_count = output.encoding.scale.get();
    let line = axis.settings.intercept_slope;
    match output.writes {
        Writes::Offset => {
            let what = if axis.diameter { "twice Cz" } else { "Cz" };
            format!("{what}: +1 µm of Cz is {} counts", signed(axis.factor() / per_count))
        }
        Writes::Intercept => {
            format!("K0, Cz at the reference position: +1 µm is {} counts", signed(1.0 / per_count))
        }
        Writes::Slope => {
            let limit = axis.settings.guard.limit.get() * axis.factor();
            let reach = line.map_or(f64::INFINITY, |line| line.reach.get());
            format!(
                "tanβ, which the control multiplies by the distance from the reference position. +0.001 \
                 µm/mm is {} counts; at most ±{} µm/mm, which is ±{limit} µm at {reach} mm",
                signed(0.001 / per_count),
                signed(limit / reach).trim_start_matches('+'),
            )
        }
        Writes::Reference => {
            let reference = line.map_or(0.0, |line| line.reference.get());
            format!("P0, the reference position: always {reference} mm")
        }
        Writes::Corrected { position } => {
            let what = if axis.diameter { "2·Cz" } else { "Cz" };
            format!("{} + {what}, each time the position is read", profile.signal(position).name)
        }
    }
}

/// Returns the smallest and the largest count that the gateway can write, including the bias. `None` if nothing limits
/// them.
pub(super) fn counts(output: &Output, axis: &Axis, profile: &Profile) -> Option<(i64, i64)> {
    let encoding = &output.encoding;
    encoding.data_type.integer_range()?;
    let range = output.writes.position().and_then(|position| profile.signal(position).range);
    // Without a model, an axis has no line, and nothing is written.
    let (low, high) = reach(output, axis, range).or(output.writes.is_apart().then_some((0.0, 0.0)))?;
    #[allow(
        clippy::cast_possible_truncation,
        reason = "the profile check ensures that the count fits the register's type"
    )]
    let count = |value: f64| ((value / encoding.scale.get()).round() as i64).saturating_add(encoding.bias);
    let (one, other) = (count(low), count(high));
    Some((one.min(other), one.max(other)))
}

fn signed(number: f64) -> String {
    format!("{}{}", if number < 0.0 { "−" } else { "+" }, figure(number.abs(), 6))
}

/// Returns the smallest and the largest value that the gateway can write, in the unit of the output. `None` if nothing
/// limits them.
fn reach(output: &Output, axis: &Axis, range: Option<(f64, f64)>) -> Option<(f64, f64)> {
    let limit = axis.settings.guard.limit.get() * axis.factor();
    let line = axis.settings.intercept_slope;
    match output.writes {
        Writes::Offset | Writes::Intercept => Some((-limit, limit)),
        Writes::Slope => line.map(|line| (-limit / line.reach.get(), limit / line.reach.get())),
        Writes::Reference => line.map(|line| (line.reference.get(), line.reference.get())),
        Writes::Corrected { .. } => range.map(|(from, to)| (from - limit / MICRONS, to + limit / MICRONS)),
    }
}

/// Reports a type that cannot hold every value of the axis, and a `step` of the axis that is smaller than one count.
fn can_move(check: &Check<'_>, at: &KeyContext<'_>, output: &Output, axis: &Axis) {
    let encoding = &output.encoding;
    let Some((low, high)) = encoding.data_type.integer_range() else { return };
    let position = output.writes.position().and_then(|position| check.signals.get(position.0));
    if let Some((from, to)) = reach(output, axis, position.and_then(|signal| signal.range))
        && (encoding.encode(from).saturated || encoding.encode(to).saturated)
    {
        let (unit, name) = (output.writes.unit(), encoding.data_type.name());
        let message = format!(
            "{from} to {to} {unit} exceed the range of {name} at {} {unit} per count with bias {}: {name} \
             holds {low} to {high} counts",
            encoding.scale.get(),
            encoding.bias
        );
        let help = "use a wider type, a coarser `scale`, a `bias`, or a smaller `limit`";
        at.key("type").invalid(message, help);
    }
    let count = encoding.scale.get().abs();
    let count = match (output.writes, axis.settings.intercept_slope) {
        (Writes::Offset | Writes::Intercept, _) => count,
        (Writes::Slope, Some(line)) => count * line.reach.get(),
        _ => return,
    };
    let step = axis.settings.guard.step.get() * axis.factor();
    if step < f64::from(output.share.counts_of_a_step()) * count * (1.0 - 1e-9) {
        let axis = &axis.settings.name;
        let (follows, at_least) = match output.share {
            Share::Whole => ("the value could never change", "one count"),
            Share::Ledger => (
                "a step of a shared register needs two counts, because the sum in the register must never \
                 become zero",
                "two counts",
            ),
        };
        let message = format!("one count is {count} µm, one step of axis `{axis}` is {step} µm: {follows}");
        at.key("scale").invalid(message, format!("make `step` of axis `{axis}` at least {at_least}"));
    }
}

/// Stores the size of one count of this output at its axis, if it is larger than the stored size. For a diameter the
/// output contains twice Cz, so the size is divided by two. For a slope output, the size for the slope is stored
/// instead.
fn note_count(axis: &mut Axis, output: &Output) {
    if output.encoding.data_type.integer_range().is_none() {
        return;
    }
    let count = output.encoding.scale.get().abs();
    let coarser = |known: Option<Micron>, count| match known {
        Some(known) if known.get() >= count => Some(known),
        _ => Micron::new(count),
    };
    if output.writes.is_cz() {
        axis.settings.guard.count = coarser(axis.settings.guard.count, count / axis.factor());
    } else if let (Writes::Slope, Some(line)) = (output.writes, &mut axis.settings.intercept_slope) {
        line.count = coarser(line.count, count * line.reach.get());
    }
}

//! Plain figures of a series of numbers.

/// Rows as a number to compute with.
pub(super) fn count(rows: usize) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "rows of a log")]
    let count = rows as f64;
    count
}

/// Largest minus smallest.
pub fn range(values: &[f64]) -> f64 {
    let (low, high) =
        values.iter().fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(*value), high.max(*value)));
    if values.is_empty() { 0.0 } else { high - low }
}

/// Root mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / count(values.len()).max(1.0)).sqrt()
}

/// 95 % of the values are within ± this of zero.
pub(super) fn percentile_95(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get((sizes.len() * 95).div_ceil(100).saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Smallest and largest of what is finite.
pub(super) fn least_and_most(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::MAX, f64::MIN), |(low, high), value| (low.min(value), high.max(value)));
    (low <= high).then_some((low, high))
}

/// Half of the values are below it; 0 where there are none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count if count % 2 == 1 => values[count / 2],
        count => 0.5 * (values[count / 2 - 1] + values[count / 2]),
    }
}

/// The place of the smallest; the first of equals.
pub(super) fn smallest(values: &[f64]) -> usize {
    let place = |best: usize, place: usize| if values[place] < values[best] { place } else { best };
    (1..values.len()).fold(0, place)
}

//! Basic statistics of a series of numbers.

use std::borrow::Borrow;

/// Converts a number of log rows to a floating-point number.
pub(super) fn count(rows: usize) -> f64 {
    #[allow(clippy::cast_precision_loss, reason = "rows of a log")]
    let count = rows as f64;
    count
}

/// Returns the smallest and the largest of the finite values; `None` if no value is finite.
pub(super) fn least_and_most<V: Borrow<f64>>(values: impl IntoIterator<Item = V>) -> Option<(f64, f64)> {
    let finite = values.into_iter().map(|value| *value.borrow()).filter(|value| value.is_finite());
    finite.fold(None, |span, value| {
        let (low, high) = span.unwrap_or((value, value));
        Some((low.min(value), high.max(value)))
    })
}

/// Returns the range of the finite values (maximum minus minimum); 0 if no value is finite.
pub(super) fn range<V: Borrow<f64>>(values: impl IntoIterator<Item = V>) -> f64 {
    least_and_most(values).map_or(0.0, |(low, high)| high - low)
}

/// Returns the mean; 0 for an empty slice.
pub(super) fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / count(values.len()).max(1.0)
}

/// Returns the root mean square; 0 for an empty slice.
pub(super) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / count(values.len()).max(1.0)).sqrt()
}

/// Returns the 95th percentile of the absolute values; 0 for an empty slice.
pub(super) fn percentile_95(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get((sizes.len() * 95).div_ceil(100).saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Returns the median; 0 for an empty vector.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count if count % 2 == 1 => values[count / 2],
        count => 0.5 * (values[count / 2 - 1] + values[count / 2]),
    }
}

/// Returns the index of the smallest value; the first index if several values are equal.
pub(super) fn smallest(values: &[f64]) -> usize {
    let place = |best: usize, place: usize| if values[place] < values[best] { place } else { best };
    (1..values.len()).fold(0, place)
}

/// Returns the index and the sum of the column with the smallest sum over all rows. If several sums are equal, returns
/// the first of these columns. `None` if there are no rows.
pub(super) fn least_sum(rows: impl IntoIterator<Item = Vec<f64>>) -> Option<(usize, f64)> {
    let add = |sums: Vec<f64>, row: Vec<f64>| sums.iter().zip(row).map(|(sum, cost)| sum + cost).collect();
    let sums = rows.into_iter().reduce(add)?;
    let place = smallest(&sums);
    Some((place, sums[place]))
}

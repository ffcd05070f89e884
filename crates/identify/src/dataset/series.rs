//! Numbers of a log column in compressed form. Most numbers of a log are multiples of a decimal step, for example 0.1.
//! A quantity changes little within some minutes, so its multiples need few bits.

use std::fmt;
use std::ops::Range;

use crate::statistics::least_and_most;

/// Number of rows in one compressed block.
const ROWS: usize = 1024;
/// Number of decimal steps in 1, for numbers with 0 to 6 decimals: a step of 0.1 is ten steps in 1.
const STEPS: [f64; 7] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6];
/// Limit of the multiples that can be packed, 2^52. Below this limit, the difference of two multiples is exact.
const LIMIT: f64 = 4_503_599_627_370_496.0;

/// Numbers of a log column by row; NaN if missing. Each number is stored exactly.
#[derive(Clone, Default)]
pub struct Series {
    /// Compressed blocks of [`ROWS`] rows each.
    blocks: Vec<Block>,
    /// Uncompressed numbers of the rows after the last block.
    rest: Vec<f64>,
}

#[derive(Clone)]
enum Block {
    Packed(Packed),
    /// Numbers that are not multiples of a decimal step, for example because their unit was converted.
    Plain(Box<[f64]>),
}

/// Numbers that are multiples of a decimal step.
#[derive(Clone)]
struct Packed {
    /// Smallest multiple (number divided by the decimal step) in the block.
    least: f64,
    /// Number of decimal steps in 1, for example 10 if the step is 0.1.
    steps: f64,
    /// Number of bits in `words` for each row.
    width: usize,
    /// Codes of all rows as bits. The code of a row is 0 if the number is missing, otherwise 1 plus the distance from
    /// the smallest multiple. At the end is one additional word, so that each row can be read from two words.
    words: Box<[u64]>,
}

impl Series {
    /// Creates a series of `rows` rows in which every number is missing.
    pub(crate) fn missing(rows: usize) -> Series {
        (0..rows).map(|_| f64::NAN).collect()
    }

    /// Adds the number of the next row.
    pub(crate) fn push(&mut self, number: f64) {
        self.rest.push(number);
        if self.rest.len() == ROWS {
            self.blocks.push(Block::of(&self.rest));
            self.rest.clear();
        }
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        ROWS * self.blocks.len() + self.rest.len()
    }

    /// Returns whether the series has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the number in a row.
    ///
    /// # Panics
    /// The series has no such row.
    pub fn at(&self, row: usize) -> f64 {
        match self.blocks.get(row / ROWS) {
            Some(block) => block.at(row % ROWS),
            None => self.rest[row - ROWS * self.blocks.len()],
        }
    }

    /// Returns an iterator over the numbers of all rows.
    pub fn iter(&self) -> Numbers<'_> {
        self.within(0..self.len())
    }

    /// Returns an iterator over the numbers of these rows.
    pub(crate) fn within(&self, rows: Range<usize>) -> Numbers<'_> {
        Numbers { series: self, rows }
    }

    /// Calls the function `change` with the numbers of all rows, and stores the changed numbers.
    pub fn change(&mut self, change: impl FnOnce(&mut [f64])) {
        let mut numbers = self.to_vec();
        change(&mut numbers);
        *self = numbers.into();
    }

    /// Returns the numbers of all rows as a vector.
    pub fn to_vec(&self) -> Vec<f64> {
        self.iter().collect()
    }
}

impl Block {
    fn of(numbers: &[f64]) -> Block {
        Packed::of(numbers).map_or_else(|| Block::Plain(numbers.into()), Block::Packed)
    }

    fn at(&self, row: usize) -> f64 {
        match self {
            Block::Packed(packed) => packed.at(row),
            Block::Plain(numbers) => numbers[row],
        }
    }
}

impl Packed {
    /// Packs numbers; `None` if they are not multiples of one decimal step.
    fn of(numbers: &[f64]) -> Option<Packed> {
        let is_multiple = |number: f64, steps: f64| {
            let multiple = multiple(number, steps);
            number.is_nan() || (multiple.abs() < LIMIT && (multiple / steps).to_bits() == number.to_bits())
        };
        let steps =
            STEPS.into_iter().find(|steps| numbers.iter().all(|number| is_multiple(*number, *steps)))?;
        let multiples = || numbers.iter().map(move |number| multiple(*number, steps));
        let (least, most) = least_and_most(multiples()).unwrap_or_default();
        let width = (u64::BITS - code(most, least).leading_zeros()) as usize;
        let mut words = vec![0_u64; numbers.len() * width / 64 + 2];
        for (row, multiple) in multiples().enumerate() {
            let (word, shift) = (row * width / 64, row * width % 64);
            let pair = u128::from(code(multiple, least)) << shift;
            words[word] |= low(pair);
            words[word + 1] |= low(pair >> 64);
        }
        Some(Packed { least, steps, width, words: words.into_boxed_slice() })
    }

    fn at(&self, row: usize) -> f64 {
        let (word, shift) = (row * self.width / 64, row * self.width % 64);
        let pair = u128::from(self.words[word]) | (u128::from(self.words[word + 1]) << 64);
        match low(pair >> shift) & (u64::MAX >> (64 - self.width)) {
            0 => f64::NAN,
            code => (self.least + (code - 1) as f64) / self.steps,
        }
    }
}

/// Returns the multiple of a decimal step that is nearest to a number. The multiple zero never has a minus sign.
fn multiple(number: f64, steps: f64) -> f64 {
    (number * steps).round() + 0.0
}

/// Returns the code of a multiple; NaN means a missing number and gets the code 0.
fn code(multiple: f64, least: f64) -> u64 {
    #[allow(clippy::cast_possible_truncation, reason = "a whole number below 2^53")]
    let distance = (multiple - least) as u64;
    if multiple.is_nan() { 0 } else { 1 + distance }
}

/// Returns the lower 64 bits of a pair of words.
fn low(pair: u128) -> u64 {
    #[allow(clippy::cast_possible_truncation, reason = "only the lower 64 bits are needed")]
    let low = pair as u64;
    low
}

/// Iterator over the numbers of consecutive rows of a [`Series`]; NaN if missing.
#[derive(Clone)]
pub struct Numbers<'a> {
    series: &'a Series,
    rows: Range<usize>,
}

impl Iterator for Numbers<'_> {
    type Item = f64;

    fn next(&mut self) -> Option<f64> {
        self.rows.next().map(|row| self.series.at(row))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.rows.size_hint()
    }
}

impl<'a> IntoIterator for &'a Series {
    type Item = f64;
    type IntoIter = Numbers<'a>;

    fn into_iter(self) -> Numbers<'a> {
        self.iter()
    }
}

impl Extend<f64> for Series {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, numbers: I) {
        numbers.into_iter().for_each(|number| self.push(number));
    }
}

impl FromIterator<f64> for Series {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Series {
        let mut series = Series::default();
        series.extend(numbers);
        // A log may have thousands of short runs, whose numbers are all in `rest`.
        series.rest.shrink_to_fit();
        series
    }
}

impl From<Vec<f64>> for Series {
    fn from(numbers: Vec<f64>) -> Series {
        numbers.into_iter().collect()
    }
}

impl PartialEq for Series {
    fn eq(&self, other: &Series) -> bool {
        self.iter().eq(other.iter())
    }
}

impl fmt::Debug for Series {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns enough numbers for two full blocks and some rows after the last block.
    fn numbers(number: impl Fn(u32) -> f64) -> Vec<f64> {
        (0..2500).map(number).collect()
    }

    #[track_caller]
    fn is_exact(numbers: &[f64]) {
        let series: Series = numbers.iter().copied().collect();
        assert_eq!(series.len(), numbers.len());
        let bits = |number: f64| if number.is_nan() { None } else { Some(number.to_bits()) };
        for (row, number) in numbers.iter().enumerate() {
            assert_eq!(bits(series.at(row)), bits(*number), "row {row}: {number}");
        }
        assert!(series.to_vec().into_iter().map(bits).eq(numbers.iter().copied().map(bits)));
    }

    fn words(series: &Series) -> usize {
        let of = |block: &Block| match block {
            Block::Packed(packed) => packed.words.len(),
            Block::Plain(numbers) => numbers.len(),
        };
        series.blocks.iter().map(of).sum()
    }

    #[test]
    fn every_number_is_returned_exactly() {
        for decimals in 0..8 {
            let text = |row: u32| {
                format!("{:.decimals$}", 20.0 + 7.0 * (f64::from(row) / 30.0).sin() - f64::from(row % 7))
            };
            is_exact(&numbers(|row| text(row).parse().unwrap()));
        }
        is_exact(&numbers(f64::from));
        is_exact(&numbers(|row| -0.01 * f64::from(row)));
        is_exact(&numbers(|row| (0.1 * f64::from(row)).exp()));
        is_exact(&numbers(|_| 20.5));
        is_exact(&numbers(|row| f64::from(u8::from(row % 3 == 0))));
        is_exact(&[]);
    }

    #[test]
    fn missing_numbers_and_unusual_ones_are_returned() {
        is_exact(&numbers(|_| f64::NAN));
        is_exact(&numbers(|row| if row % 5 == 0 { f64::NAN } else { 0.25 * f64::from(row) }));
        let odd = [
            -0.0,
            f64::INFINITY,
            f64::NEG_INFINITY,
            9.9e37,
            f64::MIN_POSITIVE,
            f64::MAX,
            LIMIT,
            -LIMIT,
            LIMIT - 1.0,
            1.0 - LIMIT,
            999_999_999_999.9,
        ];
        for number in odd {
            is_exact(&numbers(|row| if row == 1000 { number } else { 20.5 }));
        }
        is_exact(&numbers(|row| odd[row as usize % odd.len()]));
        is_exact(&numbers(|row| [1.0 - LIMIT, LIMIT - 1.0, 3.0][row as usize % 3]));
        assert_eq!(Series::missing(2000).len(), 2000);
        assert!(Series::missing(2000).iter().all(f64::is_nan));
    }

    #[test]
    fn numbers_with_decimals_take_few_bits() {
        let series: Series = numbers(|row| f64::from(2000 + row * 7 % 997) / 100.0).into();
        assert_eq!(series.blocks.len(), 2);
        assert!(words(&series) <= 2 * (10 * ROWS / 64 + 2), "{} words", words(&series));
    }

    #[test]
    fn a_short_series_takes_eight_bytes_for_each_number() {
        for rows in [1, 600, 1100] {
            let series: Series = numbers(f64::from).into_iter().take(rows).collect();
            assert_eq!(series.rest.capacity(), rows % ROWS);
        }
    }

    #[test]
    fn some_rows_are_read_and_added() {
        let all = numbers(|row| 0.5 * f64::from(row));
        let mut series: Series = all.iter().copied().take(1500).collect();
        series.extend(all[1500..].iter().copied());
        assert_eq!(series, Series::from(all.clone()));
        assert!(series.within(1020..2100).eq(all[1020..2100].iter().copied()));
        assert_eq!(series.iter().size_hint(), (2500, Some(2500)));
    }
}

//! Finds runs that contain the same minutes. Examples are a copied file, one day in two file formats, and files that
//! overlap in time.
//!
//! A model is tested on runs that were not used to identify it. If two runs contain the same minutes, the result of
//! that test is worthless. The content of a row is all its values without the time.

use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use super::Run;
use crate::statistics::count;
use isotherm_core::quantity::{Moment, time};

/// Maximum number of rows of all runs that are compared. If there are more, only a sample is compared. The choice of
/// the sample depends only on the content of the rows.
const MOST_ROWS: usize = 400_000;
/// Minimum share of the rows of the shorter run that must also occur in the other run, in the same order.
/// With a smaller share, the shorter run does not count as a copy.
const LEAST_SHARE: f64 = 0.5;
/// Minimum number of different row contents that two runs must have in common. Fewer rows may be equal by chance.
const LEAST_ROWS: usize = 20;
/// Maximum number of runs in which a row content may occur. A content that occurs in more runs is not compared, because
/// it is usual for the machine.
const MOST_RUNS_OF_A_CONTENT: usize = 64;
/// Maximum number of rows with the same content that are compared in one run. A cold machine has many such rows.
const MOST_ROWS_OF_A_CONTENT: usize = 32;
/// Maximum number of runs for the comparison in pairs, and maximum number of rows that are compared in each pair.
const MOST_PAIRED: (usize, usize) = (200, 200);
/// Minimum share of the compared rows of two runs that must be equal except for rounding.
const LEAST_ROUNDED: f64 = 0.9;
/// Smallest time that counts as a date, s since 1970; it is in the year 1990. A smaller time counts from the start of a
/// log.
const FIRST_DATE: u64 = 631_152_000;

/// Returns a sentence for each pair of runs that contains the same minutes. `is_measured` decides whether the values of
/// a column were measured. Calculated columns are not compared, because they may be equal on several days.
pub(super) fn find(runs: &[Run], is_measured: &dyn Fn(usize) -> bool) -> Vec<String> {
    if runs.len() < 2 {
        return Vec::new();
    }
    let mut columns = common_columns(runs);
    columns.retain(|column| is_measured(*column));
    let mut copies = copies(runs, &columns);
    copies.extend(rounded_copies(runs, &columns, &copies));
    let mut found: Vec<String> = copies.iter().map(|copy| copy.message(runs)).collect();
    for (one, other) in overlaps(runs) {
        if copies.iter().any(|copy| copy.is_of(one, other)) {
            continue;
        }
        let last = runs[one].times.last().min(runs[other].times.last());
        let (from, to) = (runs[other].times.first().copied(), last.copied());
        found.push(format!(
            "{} ({}) and {} ({}) overlap in time, from {} to {}. The same minutes would be used to identify \
             the model and to test it. Leave one of these runs out, or cut off the common rows of one run",
            runs[one].name,
            runs[one].file.display(),
            runs[other].name,
            runs[other].file.display(),
            from.map(text).unwrap_or_default(),
            to.map(text).unwrap_or_default()
        ));
    }
    found
}

/// Two runs that contain the same rows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Copied {
    /// Index of the run that was read first.
    first: usize,
    second: usize,
    /// Equal rows as a share of the compared rows of the shorter run.
    share: f64,
}

impl Copied {
    fn is_of(&self, one: usize, other: usize) -> bool {
        (self.first, self.second) == (one.min(other), one.max(other))
    }

    fn message(&self, runs: &[Run]) -> String {
        let [first, second] = [&runs[self.first], &runs[self.second]];
        let how = match self.share > 0.999 {
            true => "contains the same rows as".to_owned(),
            false => format!("has {:.0} % of its rows in common with", 100.0 * self.share),
        };
        format!(
            "{} ({}) {how} {} ({}): the same rows would be used to identify the model and to test it. Leave \
             one of these runs out",
            second.name,
            second.file.display(),
            first.name,
            first.file.display()
        )
    }
}

/// Distance between two equal rows of different runs, in rows or in seconds. Only the distance in seconds
/// stays the same if one run lacks some rows of the other run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Distance {
    Rows(i64),
    Seconds(i64),
}

/// Returns the pairs of runs in which the shorter run is a copy of a part of the longer run.
fn copies(runs: &[Run], columns: &[usize]) -> Vec<Copied> {
    let rows: usize = runs.iter().map(|run| run.times.len()).sum();
    let one_of = 1 + rows / MOST_ROWS;
    if columns.is_empty() {
        return Vec::new();
    }
    let hashed: Vec<Vec<(u64, usize)>> = runs.iter().map(|run| hashes(run, columns, one_of as u64)).collect();
    let second_of = |run: usize, row: usize| {
        let times = &runs[run].times;
        i64::try_from(times[row].since(times[0]).as_secs()).unwrap_or(i64::MAX)
    };
    let contents: Vec<usize> =
        hashed.iter().map(|own| own.iter().map(|(hash, _)| hash).collect::<HashSet<_>>().len()).collect();
    // The first row of each content, by run.
    let mut known: HashMap<u64, Vec<(usize, usize)>> = HashMap::new();
    let mut found = Vec::new();
    for (second, own) in hashed.iter().enumerate() {
        // Equal rows by run and by their distance.
        let mut equal: HashMap<(usize, Distance), HashSet<u64>> = HashMap::new();
        for (hash, row) in own {
            for (first, other) in known.get(hash).into_iter().flatten() {
                let in_rows = i64::try_from(*row).unwrap_or(0) - i64::try_from(*other).unwrap_or(0);
                let in_seconds = second_of(second, *row).saturating_sub(second_of(*first, *other));
                for distance in [Distance::Rows(in_rows), Distance::Seconds(in_seconds)] {
                    equal.entry((*first, distance)).or_default().insert(*hash);
                }
            }
        }
        let mut best: HashMap<usize, usize> = HashMap::new();
        for ((first, _), hashes) in equal {
            let most = best.entry(first).or_default();
            *most = hashes.len().max(*most);
        }
        let mut copied: Vec<Copied> = best
            .into_iter()
            .filter_map(|(first, equal)| {
                let share = count(equal) / count(contents[first].min(contents[second])).max(1.0);
                // Of many rows, a part is compared.
                let is_enough = equal.saturating_mul(one_of) >= LEAST_ROWS && equal >= LEAST_ROWS / 4;
                (share >= LEAST_SHARE && is_enough).then_some(Copied { first, second, share })
            })
            .collect();
        copied.sort_by_key(|copy| copy.first);
        // A third copy is named once.
        found.extend(copied.into_iter().take(1));
        let mut seen = HashSet::new();
        for (hash, row) in own {
            let runs = known.entry(*hash).or_default();
            if seen.insert(*hash) && runs.len() < MOST_RUNS_OF_A_CONTENT {
                runs.push((second, *row));
            }
        }
    }
    found
}

/// Returns the pairs of runs with the same values except for rounding, at the same times since their first rows. An
/// example is one day as CSV and as Parquet. `known` contains the copies that were found by their content.
fn rounded_copies(runs: &[Run], columns: &[usize], known: &[Copied]) -> Vec<Copied> {
    let (most_runs, most_rows) = MOST_PAIRED;
    let mut found: Vec<Copied> = Vec::new();
    if columns.is_empty() {
        return found;
    }
    let compared = runs.len().min(most_runs);
    let is_known =
        |second: usize, found: &[Copied]| known.iter().chain(found).any(|copy| copy.second == second);
    for second in 1..compared {
        for first in 0..second {
            if is_known(second, &found) {
                break;
            }
            let (short, long) = match runs[first].times.len() < runs[second].times.len() {
                true => (&runs[first], &runs[second]),
                false => (&runs[second], &runs[first]),
            };
            let pairs = rows_at_the_same_times(short, long, most_rows);
            if pairs.len() >= LEAST_ROWS
                && columns.iter().all(|column| is_rounded(short, long, *column, &pairs))
            {
                let content = |(row, _): &(usize, usize)| {
                    columns.iter().map(|column| rounded(short.values[*column].at(*row))).collect::<Vec<u64>>()
                };
                let contents: HashSet<Vec<u64>> = pairs.iter().map(content).collect();
                if contents.len() >= LEAST_ROWS {
                    found.push(Copied { first, second, share: 1.0 });
                }
            }
        }
    }
    found
}

/// Returns pairs of rows of two runs at the same times since their first rows. The pairs are spread over the shorter
/// run.
fn rows_at_the_same_times(short: &Run, long: &Run, most: usize) -> Vec<(usize, usize)> {
    let (Some(begin), Some(other)) = (short.times.first(), long.times.first()) else { return Vec::new() };
    let step = 1 + short.times.len() / most;
    let pair = |row: usize| {
        let elapsed = short.times[row].since(*begin);
        let next = long.times.partition_point(|time| time.since(*other) < elapsed);
        (long.times.get(next)?.since(*other) == elapsed).then_some((row, next))
    };
    let rows: Vec<usize> = (0..short.times.len()).step_by(step).collect();
    let pairs: Vec<(usize, usize)> = rows.iter().filter_map(|row| pair(*row)).collect();
    // A run that was logged at other times is no copy in another format.
    if count(pairs.len()) < LEAST_ROUNDED * count(rows.len()) { Vec::new() } else { pairs }
}

/// Returns whether the values of a column in two runs differ only by rounding.
fn is_rounded(one: &Run, other: &Run, column: usize, pairs: &[(usize, usize)]) -> bool {
    let (one, other) = (&one.values[column], &other.values[column]);
    let step = f64::max(
        resolution(pairs.iter().map(|(row, _)| one.at(*row))),
        resolution(pairs.iter().map(|(_, row)| other.at(*row))),
    );
    let differs = |(row, its): &&(usize, usize)| {
        let (one, other) = (one.at(*row), other.at(*its));
        one.is_finite() != other.is_finite() || (one - other).abs() > 0.501 * step
    };
    let differing = pairs.iter().filter(differs).count();
    count(differing) <= (1.0 - LEAST_ROUNDED) * count(pairs.len())
}

/// Returns the decimal step to which these values were rounded, from 1 to 0.001.
fn resolution(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let is_rounded_to = |step: &f64| {
        let is_whole = |value: f64| ((value / step).round() - value / step).abs() < 1e-4;
        values.clone().filter(|value| value.is_finite()).all(is_whole)
    };
    [1.0, 0.1, 0.01].into_iter().find(is_rounded_to).unwrap_or(0.001)
}

/// Returns the columns that have values in every run.
fn common_columns(runs: &[Run]) -> Vec<usize> {
    let columns = runs.first().map_or(0, |run| run.values.len());
    let is_common =
        |column: &usize| runs.iter().all(|run| run.values[*column].iter().any(|value| value.is_finite()));
    (0..columns).filter(is_common).collect()
}

/// Returns a hash of the values of each row, with the index of the row. Rows without values are left out. To select a
/// sample, only about one of `one_of` rows is returned, depending on its hash.
fn hashes(run: &Run, columns: &[usize], one_of: u64) -> Vec<(u64, usize)> {
    let hash = |row: usize| {
        let mut hasher = DefaultHasher::new();
        let mut has_values = false;
        for column in columns {
            let value = run.values[*column].at(row);
            has_values |= value.is_finite();
            rounded(value).hash(&mut hasher);
        }
        has_values.then(|| (hasher.finish(), row))
    };
    let mut alike: HashMap<u64, usize> = HashMap::new();
    let mut is_compared = |hash: u64| {
        let rows = alike.entry(hash).or_default();
        *rows += 1;
        *rows <= MOST_ROWS_OF_A_CONTENT
    };
    let rows = (0..run.times.len()).filter_map(hash);
    rows.filter(|(hash, _)| hash.is_multiple_of(one_of) && is_compared(*hash)).collect()
}

/// Returns the bits of a value after rounding to three decimals. A value from decimal text and from a four-byte
/// binary number then have the same bits.
fn rounded(value: f64) -> u64 {
    let rounded = (value * 1000.0).round() / 1000.0;
    // Negative zero has other bits.
    if value.is_finite() { (rounded + 0.0).to_bits() } else { u64::MAX }
}

/// Returns the pairs of runs from different files that overlap in absolute time. The run that begins first comes first
/// in its pair.
fn overlaps(runs: &[Run]) -> Vec<(usize, usize)> {
    let is_dated = |first: &Moment| first.as_nanos() / 1_000_000_000 >= FIRST_DATE;
    let span = |(place, run): (usize, &Run)| {
        let (first, last) = (*run.times.first()?, *run.times.last()?);
        is_dated(&first).then_some((first, last, place))
    };
    let mut spans: Vec<(Moment, Moment, usize)> = runs.iter().enumerate().filter_map(span).collect();
    spans.sort_unstable();
    let mut found = Vec::new();
    // The run that ends last of those before.
    let mut longest: Option<(Moment, usize)> = None;
    for (first, last, place) in spans {
        if let Some((end, before)) = longest
            && first < end
        {
            found.push((before, place));
        }
        if longest.is_none_or(|(end, _)| last > end) {
            longest = Some((last, place));
        }
    }
    found
}

fn text(at: Moment) -> String {
    let mut text = Vec::new();
    time::write(&mut text, Moment::from_nanos(at.as_nanos() / 1_000_000_000 * 1_000_000_000));
    String::from_utf8_lossy(&text).replace(".000000000", "")
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::dataset::{Origin, Series};

    /// Creates the run of one day with two columns; `seed` changes the values. The times begin at `from`, s.
    fn day(name: &str, seed: u32, from: u64) -> Run {
        let rows = 0..100u32;
        let value = |row: u32, column: u32| {
            20.0 + 0.01 * f64::from(row) + 0.001 * f64::from((row * 37 + seed * 101 + column * 53) % 97)
        };
        Run {
            name: name.to_owned(),
            file: PathBuf::from(format!("{name}.csv")),
            times: rows
                .clone()
                .map(|row| Moment::from_nanos((from + 60 * u64::from(row)) * 1_000_000_000))
                .collect(),
            values: (0..2).map(|column| rows.clone().map(|row| value(row, column)).collect()).collect(),
            origin: Origin::default(),
        }
    }

    fn find(runs: &[Run]) -> Vec<String> {
        super::find(runs, &|_| true)
    }

    /// Returns the part of a run from the row `from` on.
    fn part(run: &Run, from: usize) -> Run {
        let values = run.values.iter().map(|column| column.within(from..column.len()).collect()).collect();
        Run { name: "part".to_owned(), times: run.times[from..].to_vec(), values, ..run.clone() }
    }

    #[test]
    fn a_copy_is_found_by_its_content_whatever_its_name_and_times_are() {
        let first = day("day1", 1, 0);
        let copy = Run { name: "day1 - Copy".to_owned(), ..first.clone() };
        let said = find(&[first.clone(), day("day2", 2, 0), copy]);
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(
            said[0].starts_with("day1 - Copy (day1.csv) contains the same rows as day1 (day1.csv)"),
            "{said:?}"
        );
        let later = Run { times: day("x", 0, 1_773_036_000).times, ..first.clone() };
        assert_eq!(find(&[first.clone(), later]).len(), 1, "a copy with another time");
        let said = find(&[first.clone(), part(&first, 40)]);
        assert!(said.len() == 1 && said[0].contains("same rows"), "{said:?}");
    }

    #[test]
    fn a_copy_that_was_rounded_or_thinned_is_found() {
        let first = day("day1", 1, 0);
        let round = |value: f64| (value * 100.0).round() / 100.0;
        let values = first.values.iter().map(|column| column.iter().map(round).collect()).collect();
        let rounded = Run { name: "day1 as CSV".to_owned(), values, ..first.clone() };
        let said = find(&[first.clone(), day("day2", 2, 0), rounded]);
        assert!(said.len() == 1 && said[0].starts_with("day1 as CSV"), "{said:?}");
        let thin = |column: &Series| column.iter().step_by(3).collect();
        let thinned = Run {
            name: "thinned".to_owned(),
            times: first.times.iter().copied().step_by(3).collect(),
            values: first.values.iter().map(thin).collect(),
            ..first.clone()
        };
        let said = find(&[first, thinned]);
        assert!(said.len() == 1 && said[0].contains("same rows"), "{said:?}");
    }

    #[test]
    fn days_with_the_same_program_of_speeds_are_no_copies() {
        let mut days = [day("day1", 1, 0), day("day2", 2, 0)];
        let speeds: Series = (0..100u32).map(|row| 100.0 * f64::from(row)).collect();
        for day in &mut days {
            day.values.push(speeds.clone());
        }
        days[0].values[0] = Series::missing(100);
        days[1].values[1] = Series::missing(100);
        assert_eq!(super::find(&days, &|column| column != 2), Vec::<String>::new());
    }

    #[test]
    fn days_that_differ_are_no_copies() {
        assert_eq!(find(&[day("day1", 1, 0), day("day2", 2, 0), day("day3", 3, 0)]), Vec::<String>::new());
        let constant = |name: &str| Run { values: vec![vec![20.0; 100].into(); 2], ..day(name, 1, 0) };
        assert_eq!(
            find(&[constant("one"), constant("two")]),
            Vec::<String>::new(),
            "a cold machine shows nothing"
        );
        assert_eq!(find(&[]), Vec::<String>::new());
    }

    #[test]
    fn days_that_overlap_in_absolute_time_are_named_with_the_span() {
        let start = 1_773_036_000;
        let said =
            find(&[day("coarse", 1, start), day("fine", 2, start + 3000), day("next", 3, start + 20_000)]);
        assert_eq!(said.len(), 1, "{said:?}");
        assert!(
            said[0].contains("coarse (coarse.csv) and fine (fine.csv) overlap in time, from 2026-03-09T"),
            "{said:?}"
        );
        assert_eq!(
            find(&[day("one", 1, 0), day("two", 2, 0)]).len(),
            0,
            "counts from the start do not overlap"
        );
        let touching = [day("one", 1, start), day("two", 2, start + 99 * 60)];
        assert_eq!(find(&touching).len(), 0, "one row at the same time is no overlap");
    }
}

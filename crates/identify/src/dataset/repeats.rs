//! Runs that contain the same minutes: copies of a file, one day in two formats, and files that overlap in time.
//!
//! A model is tested on runs that were not used to identify it. If two runs contain the same minutes, that test shows
//! nothing.

use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};

use super::Run;
use crate::statistics::count;
use isotherm_core::quantity::{Moment, time};

/// Number of rows of all runs that are compared. Of more rows, a part is compared that depends on their content only.
const MOST_ROWS: usize = 400_000;
/// Smallest share of the shorter run's rows that must occur in the other run in the same order.
const LEAST_SHARE: f64 = 0.5;
/// Smallest number of equal rows with different contents. Fewer rows may be equal by chance.
const LEAST_ROWS: usize = 20;
/// Times before this are counts from the start of a log, not dates, s (in the year 1990).
const FIRST_DATE: u64 = 631_152_000;

/// Returns a sentence for each pair of runs that contains the same minutes.
pub(super) fn find(runs: &[Run]) -> Vec<String> {
    let copies = copies(runs);
    let mut found: Vec<String> = copies.iter().map(|copy| copy.message(runs)).collect();
    for (one, other) in overlaps(runs) {
        if copies.iter().any(|copy| copy.is_of(one, other)) {
            continue;
        }
        let last = runs[one].times.last().min(runs[other].times.last());
        let (from, to) = (runs[other].times.first().copied(), last.copied());
        found.push(format!(
            "{} ({}) and {} ({}) overlap in time, from {} to {}: the same minutes would be used to identify the model \
             and to test it. Leave one of them out, or cut one of them",
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

/// Two runs with the same rows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Copied {
    /// Run that was read first.
    first: usize,
    second: usize,
    /// Share of the shorter run's compared rows that are equal.
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
            "{} ({}) {how} {} ({}): a copy would be used to identify the model and to test it. Leave one of them out",
            second.name,
            second.file.display(),
            first.name,
            first.file.display()
        )
    }
}

/// Returns the pairs of runs in which the shorter one is a copy of a part of the other.
fn copies(runs: &[Run]) -> Vec<Copied> {
    let rows: usize = runs.iter().map(|run| run.times.len()).sum();
    let one_of = 1 + rows / MOST_ROWS;
    let columns = common_columns(runs);
    if columns.is_empty() {
        return Vec::new();
    }
    let hashed: Vec<Vec<(u64, usize)>> =
        runs.iter().map(|run| hashes(run, &columns, one_of as u64)).collect();
    let contents: Vec<usize> =
        hashed.iter().map(|own| own.iter().map(|(hash, _)| hash).collect::<HashSet<_>>().len()).collect();
    // The first row of each content, by run.
    let mut known: HashMap<u64, Vec<(usize, usize)>> = HashMap::new();
    let mut found = Vec::new();
    for (second, own) in hashed.iter().enumerate() {
        // Equal rows by run and by their distance in rows.
        let mut equal: HashMap<(usize, i64), HashSet<u64>> = HashMap::new();
        for (hash, row) in own {
            for (first, other) in known.get(hash).into_iter().flatten() {
                let distance = i64::try_from(*row).unwrap_or(0) - i64::try_from(*other).unwrap_or(0);
                equal.entry((*first, distance)).or_default().insert(*hash);
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
                (share >= LEAST_SHARE && equal >= LEAST_ROWS).then_some(Copied { first, second, share })
            })
            .collect();
        copied.sort_by_key(|copy| copy.first);
        // A third copy is named once.
        found.extend(copied.into_iter().take(1));
        let mut seen = HashSet::new();
        for (hash, row) in own {
            if seen.insert(*hash) {
                known.entry(*hash).or_default().push((second, *row));
            }
        }
    }
    found
}

/// Returns the columns that have values in every run.
fn common_columns(runs: &[Run]) -> Vec<usize> {
    let columns = runs.first().map_or(0, |run| run.values.len());
    let is_common =
        |column: &usize| runs.iter().all(|run| run.values[*column].iter().any(|value| value.is_finite()));
    (0..columns).filter(is_common).collect()
}

/// Returns the hash of the values of each row, and its index. A row without values is left out. Only one of `one_of` rows
/// is returned, selected by its hash.
fn hashes(run: &Run, columns: &[usize], one_of: u64) -> Vec<(u64, usize)> {
    let hash = |row: usize| {
        let mut hasher = DefaultHasher::new();
        let mut has_values = false;
        for column in columns {
            let value = run.values[*column][row];
            has_values |= value.is_finite();
            rounded(value).hash(&mut hasher);
        }
        has_values.then(|| (hasher.finish(), row))
    };
    (0..run.times.len()).filter_map(hash).filter(|(hash, _)| hash.is_multiple_of(one_of)).collect()
}

/// Returns the bits of a value that is the same in a file with decimals and in one with binary numbers of four bytes.
fn rounded(value: f64) -> u64 {
    let rounded = (value * 1000.0).round() / 1000.0;
    // Negative zero has other bits.
    if value.is_finite() { (rounded + 0.0).to_bits() } else { u64::MAX }
}

/// Returns the pairs of runs of different files that overlap in absolute time. The run that begins first comes first.
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

    /// Day of a machine with two columns; `seed` changes its values. The times begin at `from`, s.
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
        }
    }

    /// Part of a run, from this row on.
    fn part(run: &Run, from: usize) -> Run {
        let values = run.values.iter().map(|column| column[from..].to_vec()).collect();
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
    fn days_that_differ_are_no_copies() {
        assert_eq!(find(&[day("day1", 1, 0), day("day2", 2, 0), day("day3", 3, 0)]), Vec::<String>::new());
        let constant = |name: &str| Run { values: vec![vec![20.0; 100]; 2], ..day(name, 1, 0) };
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

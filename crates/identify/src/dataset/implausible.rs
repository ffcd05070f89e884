//! Implausible values: values in a log that no sensor measured. Examples are numbers that a logger writes for an
//! overload or a broken wire, messages of a logger, and words like `n/a`.
//!
//! A suspicious value is for example 9.9E37, 850 or 0. It is implausible only if it differs from the values before and
//! after it by more than the machine can change between two rows. Implausible values are left out, and a remark names
//! their lines. Short gaps of a temperature are bridged by straight lines.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::{Range, RangeInclusive};
use std::time::Duration;

use super::active_cz::is_of_touches;
use super::kind::{HUGE, KindOf, is_suspicious};
use super::table::{Cells, Table};
use super::{Kind, Refusal, Series};
use crate::statistics::{count, range};
use isotherm_core::quantity::{Conversion, Moment};

/// Maximum share of implausible values in the rows of a run. With more, the column is rejected.
const MOST: f64 = 0.05;
/// Maximum number of text lines that a remark lists.
const NAMED: usize = 5;
/// Minimum difference between an implausible value and its neighbours, as a multiple of the usual step of the
/// column between two rows. A machine cannot make such a large step.
const TIMES_USUAL: f64 = 6.0;
/// Minimum difference between an implausible value and its neighbours, as a multiple of the resolution
/// (smallest step) of the column.
const TIMES_SMALLEST: f64 = 3.5;
/// Maximum gap of a temperature that is bridged by a straight line.
const BRIDGED: Duration = Duration::from_secs(300);
/// Maximum time between a value and the neighbouring values with which it is compared.
const NEAR: Duration = Duration::from_secs(3600);
/// Maximum number of rows of a jump that counts as implausible. After these rows, the value must return.
const SHORT: usize = 5;
/// Minimum size of an implausible jump of a displacement: in µm, and as a multiple of the usual step. The jump must
/// exceed both.
const JUMP: (f64, f64) = (20.0, 20.0);

/// Range of plausible temperatures of a machine, °C. Values outside this range are suspicious.
const OF_MACHINES: RangeInclusive<f64> = -60.0..=200.0;
/// Minimum change of a speed or position, as a share of its range, that counts as a movement of the machine.
const MOVED: f64 = 0.1;

/// Column of values that is searched for implausible values.
#[derive(Clone, Copy)]
pub(super) struct Tested<'a> {
    pub(super) kind: Kind,
    pub(super) times: &'a [Moment],
    pub(super) values: &'a [f64],
    /// Conversion by which the values were calculated from the cells of the log, for example from °F to °C.
    pub(super) conversion: Conversion,
    /// Function that returns whether the machine moved between two rows. A displacement may jump during a movement.
    pub(super) moved: &'a dyn Fn(usize, usize) -> bool,
}

/// Returns the minimum difference between an implausible value and its neighbours, in the unit of the kind;
/// `None` if values of this kind are not tested.
fn least_distance(kind: Kind) -> Option<f64> {
    match kind {
        Kind::Temperature | Kind::Displacement => Some(2.0),
        Kind::Speed => Some(5000.0),
        Kind::Position | Kind::Compensation | Kind::Switch | Kind::Other => None,
    }
}

/// Rows of a column whose values no sensor measured.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Found {
    /// Rows with suspicious values that differ clearly from the neighbouring values.
    pub(super) sentinels: Vec<usize>,
    /// Rows of short jumps of a displacement: the value returned within a few rows.
    pub(super) jumps: Vec<usize>,
    /// First row after each lasting jump of a displacement: the value did not return. The values after such a jump are
    /// used.
    pub(super) lasting: Vec<usize>,
}

/// Finds the implausible values of a column.
pub(super) fn find(tested: &Tested<'_>) -> Found {
    let Tested { kind, times, values, .. } = *tested;
    let Some(least) = least_distance(kind) else { return Found::default() };
    let is_good = |row: &usize| values[*row].is_finite() && !tested.is_suspicious(values[*row]);
    let good: Vec<usize> = (0..values.len()).filter(is_good).collect();
    let (smallest, usual) = steps(values, &good);
    // A spindle has few speeds, and their differences are no resolution.
    let smallest = if kind == Kind::Speed { 0.0 } else { smallest };
    let least = least.max(TIMES_USUAL * usual).max(TIMES_SMALLEST * smallest);
    let mut found = Found::default();
    let suspicious = (0..values.len()).filter(|row| values[*row].is_finite() && !is_good(row));
    for row in suspicious {
        let next = good.partition_point(|known| *known < row);
        let before = next.checked_sub(1).map(|place| good[place]);
        // The rows between two good ones are all suspicious or missing.
        let before = before.filter(|before| is_near(times, *before, before + 1));
        let after = good.get(next).copied().filter(|after| is_near(times, after - 1, *after));
        if stands_apart(values[row], before.map(|row| values[row]), after.map(|row| values[row]), least) {
            found.sentinels.push(row);
        }
    }
    if kind == Kind::Displacement {
        (found.jumps, found.lasting) = jumps(tested, &found.sentinels, usual);
    }
    found
}

impl Tested<'_> {
    /// Returns whether a logger may have written this value to report a fault, instead of a measured value.
    fn is_suspicious(&self, value: f64) -> bool {
        let is_outside = self.kind == Kind::Temperature && !OF_MACHINES.contains(&value);
        let is_written = || {
            let logged = self.conversion.revert(value);
            // The values of a speed are those that loggers write instead of any quantity.
            is_suspicious(Kind::Speed, logged)
                || (self.conversion == Conversion::Fahrenheit && logged.abs() < 0.004)
        };
        is_outside
            || is_suspicious(self.kind, value)
            || (self.conversion != Conversion::Same && least_distance(self.kind).is_some() && is_written())
    }
}

fn is_near(times: &[Moment], one: usize, other: usize) -> bool {
    times[other].since(times[one]) <= NEAR
}

/// Returns whether a value differs from its neighbours by more than `least`, while the neighbours are similar to each
/// other. For the value zero, it is enough that both neighbours have the same sign. The first or last row has only one
/// neighbour; a zero in such a row is not implausible.
fn stands_apart(value: f64, before: Option<f64>, after: Option<f64>, least: f64) -> bool {
    let distance = |neighbour: f64| (value - neighbour).abs();
    match (before, after) {
        (Some(before), Some(after)) => {
            let nearest = f64::min(distance(before), distance(after));
            // A sensor without a contact gives zero until it has one again. The machine moves on meanwhile.
            let is_without_contact = value.abs() < 0.004 && before * after > 0.0;
            nearest > least && (is_without_contact || (before - after).abs() < 0.5 * nearest)
        }
        (Some(only), None) | (None, Some(only)) => value.abs() > 0.004 && distance(only) > least,
        (None, None) => value.abs() >= HUGE,
    }
}

/// Returns the smallest step between neighbouring good rows, which is the resolution of the column, and the usual step.
/// The usual step is the 90th percentile of the steps. Both are 0 if the values never change.
fn steps(values: &[f64], good: &[usize]) -> (f64, f64) {
    let mut steps: Vec<f64> = good.windows(2).map(|pair| (values[pair[1]] - values[pair[0]]).abs()).collect();
    steps.sort_by(f64::total_cmp);
    let smallest = steps.get(steps.partition_point(|step| *step < 1e-9)).copied();
    (smallest.unwrap_or(0.0), steps.get(steps.len() * 9 / 10).copied().unwrap_or(0.0))
}

/// Finds the jumps of a displacement while the machine does not move. The first list contains the rows of short jumps,
/// after which the value returns within a few rows. The second list contains the first row after each lasting jump.
fn jumps(tested: &Tested<'_>, sentinels: &[usize], usual: f64) -> (Vec<usize>, Vec<usize>) {
    let Tested { times, values, moved, .. } = *tested;
    let least = f64::max(JUMP.0, JUMP.1 * usual);
    let is_used = |row: &usize| values[*row].is_finite() && sentinels.binary_search(row).is_err();
    let rows: Vec<usize> = (0..values.len()).filter(is_used).collect();
    let (mut found, mut lasting, mut place) = (Vec::new(), Vec::new(), 1);
    while place < rows.len() {
        let (before, value) = (values[rows[place - 1]], values[rows[place]]);
        let step = (value - before).abs();
        let stays = || {
            let next = &rows[place + 1..rows.len().min(place + 1 + SHORT)];
            // A fast movement over several rows is no jump.
            let was_steady = place < 2 || (before - values[rows[place - 2]]).abs() < 0.3 * step;
            was_steady
                && next.len() == SHORT
                && next.iter().all(|row| (values[*row] - value).abs() < 0.3 * step)
                && times[rows[place]].since(times[rows[place - 1]]) <= BRIDGED
        };
        let back = (place + 1..rows.len().min(place + 1 + SHORT)).find(|back| {
            let is_back = (values[rows[*back]] - before).abs() < 0.3 * step;
            is_back && times[rows[*back]].since(times[rows[place - 1]]) <= NEAR
        });
        let is_jump = step > least && !moved(rows[place - 1], rows[place]);
        match back.filter(|_| is_jump) {
            Some(back) => {
                found.extend(&rows[place..back]);
                place = back + 1;
            }
            None => {
                if is_jump && stays() {
                    lasting.push(rows[place]);
                }
                place += 1;
            }
        }
    }
    (found, lasting)
}

/// Implausible values of a column in one run.
pub(super) struct Wrong {
    /// Index of the column in the table.
    pub(super) place: usize,
    run: Range<usize>,
    pub(super) rows: BTreeSet<usize>,
    /// Text for a message that lists the rows with these values.
    text: String,
    is_bridged: bool,
    are_too_many: bool,
}

impl Wrong {
    /// Returns the error message about a column with too many implausible values; `None` if it has few.
    pub(super) fn refusal(&self) -> Option<String> {
        self.are_too_many.then(|| {
            format!(
                "{}: these are more than {:.0} % of the values. Leave this column or this log out, or repair \
                 the measurement",
                self.text,
                100.0 * MOST
            )
        })
    }

    /// Returns the remark about the values that were left out. `is_bridged` is true if a gap was bridged by a straight
    /// line.
    pub(super) fn left_out(&self, is_bridged: bool) -> String {
        let done = if is_bridged { "; gaps of up to 5 min were filled by linear interpolation" } else { "" };
        format!("{}: left out{done}", self.text)
    }
}

/// Removes the implausible values from each run of a table. Returns remarks with file, line and value, and the columns
/// that have too many implausible values.
pub(super) fn leave_out(
    table: &mut Table,
    runs: &[Range<usize>],
    kind: KindOf<'_>,
) -> (Vec<String>, Vec<Refusal>) {
    let (mut remarks, mut refused) = (Vec::new(), Vec::new());
    let (found, lasting) = wrong(table, runs, kind);
    remarks.extend(lasting);
    let Table { columns, times, .. } = table;
    let mut of_columns: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (number, wrong) in found.iter().enumerate() {
        of_columns.entry(wrong.place).or_default().push(number);
    }
    let mut are_bridged = vec![false; found.len()];
    for (place, own) in of_columns {
        let (_, Cells::Numbers(numbers)) = &mut columns[place] else { continue };
        numbers.change(|values| {
            for number in own {
                let Wrong { run, rows, is_bridged, are_too_many, .. } = &found[number];
                rows.iter().for_each(|row| values[*row] = f64::NAN);
                are_bridged[number] = *is_bridged && !are_too_many && bridge(times, values, rows, run);
            }
        });
    }
    for (wrong, is_bridged) in found.iter().zip(are_bridged) {
        match wrong.refusal() {
            Some(message) => refused.push(Refusal { column: columns[wrong.place].0.clone(), message }),
            None => remarks.push(wrong.left_out(is_bridged)),
        }
    }
    (remarks, refused)
}

/// Returns the implausible values of each column and run. Also returns a remark about each displacement that jumps and
/// does not return.
pub(super) fn wrong(table: &Table, runs: &[Range<usize>], kind: KindOf<'_>) -> (Vec<Wrong>, Vec<String>) {
    let numbers = table.columns.iter().enumerate().filter_map(|(place, (name, cells))| match cells {
        // The gateway has tested its touches.
        Cells::Numbers(values) if !table.acted.contains(name) && !is_of_touches(name, &table.acted) => {
            Some((place, name.as_str(), values, kind(name, values)))
        }
        _ => None,
    });
    let numbers: Vec<(usize, &str, &Series, Kind)> = numbers.collect();
    let movers: Vec<(&Series, f64)> = numbers
        .iter()
        .filter_map(|(_, _, values, kind)| match kind {
            Kind::Speed => Some((*values, 100.0)),
            Kind::Position => Some((*values, 1.0)),
            Kind::Switch => Some((*values, 0.5)),
            _ => None,
        })
        .collect();
    // The rows are ascending.
    let words: Vec<[Vec<usize>; 2]> = numbers
        .iter()
        .map(|(_, name, ..)| [table.failed_rows(name).collect(), table.unavailable_rows(name).collect()])
        .collect();
    let (mut found, mut remarks) = (Vec::new(), Vec::new());
    for run in runs {
        let least =
            |(values, least): &(&Series, f64)| f64::max(*least, MOVED * range(values.within(run.clone())));
        let steps: Vec<f64> = movers.iter().map(least).collect();
        let moved = |before: usize, row: usize| {
            movers.iter().zip(&steps).any(|((values, _), step)| {
                (values.at(run.start + row) - values.at(run.start + before)).abs() > *step
            })
        };
        for ((place, name, values, kind), words) in numbers.iter().copied().zip(&words) {
            let [failed, unavailable] = words.each_ref().map(|rows| {
                let until = |end: usize| rows.partition_point(|row| *row < end);
                &rows[until(run.start)..until(run.end)]
            });
            if least_distance(kind).is_none() && failed.is_empty() && unavailable.is_empty() {
                continue;
            }
            let conversion = table.conversions.get(name).copied().unwrap_or_default();
            let (times, own) = (&table.times[run.clone()], values.within(run.clone()).collect::<Vec<f64>>());
            let Found { sentinels, jumps, lasting } =
                find(&Tested { kind, times, values: &own, conversion, moved: &moved });
            let mut rows: BTreeSet<usize> = sentinels.into_iter().map(|row| row + run.start).collect();
            rows.extend(failed.iter().copied());
            let all = count(run.len()).max(1.0);
            let are_too_many = count(rows.len()) / all > MOST;
            if !are_too_many && count(jumps.len()) / all <= MOST {
                rows.extend(jumps.into_iter().map(|row| row + run.start));
            }
            // The log itself says that these values are missing, so any number of them is a gap.
            rows.extend(unavailable.iter().copied());
            if let Some(first) = lasting.first() {
                remarks.push(lasting_jump(table, name, run.start + first, lasting.len()));
            }
            if rows.is_empty() {
                continue;
            }
            let text = remark(table, (name, conversion), values, &rows);
            let is_bridged = kind == Kind::Temperature;
            found.push(Wrong { place, run: run.clone(), rows, text, is_bridged, are_too_many });
        }
    }
    (found, remarks)
}

/// Returns the remark about jumps of a column that do not return. `first` is the row after the first jump, and `jumps`
/// is the number of jumps.
fn lasting_jump(table: &Table, name: &str, first: usize, jumps: usize) -> String {
    let more = if jumps > 1 { format!(", and jumps {} more times", jumps - 1) } else { String::new() };
    format!(
        "{}, {} {}, column {name}: the value jumps from one row to the next and does not return{more}. A \
         machine cannot move so fast. If the probe was moved or set to zero, split the log at this row",
        table.file.display(),
        table.row,
        table.lines.of(first)
    )
}

/// Returns the remark about these rows of a column. It contains the value in the first row, and the lines of the rows.
fn remark(
    table: &Table,
    (name, conversion): (&str, Conversion),
    values: &Series,
    rows: &BTreeSet<usize>,
) -> String {
    let Some(first) = rows.first().copied() else { return String::new() };
    let value = match conversion.revert(values.at(first)) {
        value if value.is_finite() && value.abs() < HUGE => value.to_string(),
        value if value.is_finite() => format!("{value:e}"),
        _ => table.word(name, first).to_owned(),
    };
    let lines: Vec<String> =
        rows.iter().skip(1).take(NAMED).map(|row| table.lines.of(*row).to_string()).collect();
    let more = match (lines.is_empty(), rows.len() > NAMED + 1) {
        (true, _) => String::new(),
        (false, false) => format!(", also in {} {}", table.row, lines.join(", ")),
        (false, true) => {
            format!(", also in {} {} and {} more", table.row, lines.join(", "), rows.len() - NAMED - 1)
        }
    };
    format!(
        "{}, {} {}, column {name}: `{value}` is not a measured value{more}",
        table.file.display(),
        table.row,
        table.lines.of(first)
    )
}

/// Bridges short gaps between values by straight lines. Returns whether any gap was bridged.
fn bridge(times: &[Moment], values: &mut [f64], wrong: &BTreeSet<usize>, rows: &Range<usize>) -> bool {
    let mut bridged = false;
    for row in wrong.iter().copied() {
        let mut earlier =
            (rows.start..row).rev().take_while(|other| times[row].since(times[*other]) <= BRIDGED);
        let mut later = (row + 1..rows.end).take_while(|other| times[*other].since(times[row]) <= BRIDGED);
        let before = earlier.find(|before| values[*before].is_finite());
        let after = later.find(|after| values[*after].is_finite() && !wrong.contains(after));
        let (Some(before), Some(after)) = (before, after) else { continue };
        let gap = times[after].since(times[before]);
        if gap > BRIDGED || gap.is_zero() {
            continue;
        }
        let share = times[row].since(times[before]).as_secs_f64() / gap.as_secs_f64();
        values[row] = values[before] + share * (values[after] - values[before]);
        bridged = true;
    }
    bridged
}

#[cfg(test)]
mod tests {
    use super::*;

    fn minutes(rows: usize) -> Vec<Moment> {
        (0..rows as u64).map(|row| Moment::from_nanos(row * 60_000_000_000)).collect()
    }

    /// Returns a drift of 20 µm over 200 min with the noise of a probe.
    fn drift() -> Vec<f64> {
        (0..200u32).map(|row| 5.0 + 0.1 * f64::from(row) + 0.2 * f64::from(row * 7 % 5)).collect()
    }

    fn found(kind: Kind, values: &[f64]) -> Found {
        found_in(kind, values, Conversion::Same)
    }

    fn found_in(kind: Kind, values: &[f64], conversion: Conversion) -> Found {
        let times = minutes(values.len());
        find(&Tested { kind, times: &times, values, conversion, moved: &|_, _| false })
    }

    #[test]
    fn values_of_a_logger_are_found_in_its_own_unit() {
        for logged in [-9999.0, 999.9, 0.0] {
            let mut values: Vec<f64> = (0..200u32).map(|row| 20.0 + 0.03 * f64::from(row)).collect();
            values[100] = Conversion::Fahrenheit.apply(logged);
            assert_eq!(found_in(Kind::Temperature, &values, Conversion::Fahrenheit).sentinels, [100]);
        }
        let mut values = drift();
        values[100..120].fill(Conversion::Factor(1000.0).apply(999.9));
        let rows: Vec<usize> = (100..120).collect();
        assert_eq!(found_in(Kind::Displacement, &values, Conversion::Factor(1000.0)).sentinels, rows);
        let mut hot: Vec<f64> = (0..200u32).map(|row| 20.0 + 0.03 * f64::from(row)).collect();
        hot[100] = 451.7;
        assert_eq!(found(Kind::Temperature, &hot).sentinels, [100], "no machine is as hot");
    }

    #[test]
    fn a_jump_while_the_machine_moves_is_kept() {
        let mut values = drift();
        values[50] = 180.0;
        let times = minutes(values.len());
        let moved = |before: usize, row: usize| (before, row) == (49, 50);
        let tested = Tested {
            kind: Kind::Displacement,
            times: &times,
            values: &values,
            conversion: Conversion::Same,
            moved: &moved,
        };
        assert_eq!(find(&tested), Found::default());
    }

    #[test]
    fn values_that_stand_apart_from_both_neighbours_are_found() {
        for value in [9.9e37, 999.9, -9999.0, 0.0, 32_767.0] {
            let mut values = drift();
            [100, 101, 150].into_iter().for_each(|row| values[row] = value);
            assert_eq!(found(Kind::Displacement, &values).sentinels, [100, 101, 150], "{value}");
        }
        for value in [850.0, 1372.0, 85.0, -127.0, 0.0, 9.9e37] {
            let mut values: Vec<f64> = (0..200u32).map(|row| 20.0 + 0.03 * f64::from(row)).collect();
            [0, 100, 101, 199].into_iter().for_each(|row| values[row] = value);
            let expected: &[usize] = if value.abs() < 1.0 { &[100, 101] } else { &[0, 100, 101, 199] };
            assert_eq!(found(Kind::Temperature, &values).sentinels, expected, "{value}");
        }
        let mut speeds = vec![3000.0; 100];
        speeds[40] = 65_535.0;
        speeds[60..80].fill(0.0);
        assert_eq!(found(Kind::Speed, &speeds), Found { sentinels: vec![40], ..Found::default() });
    }

    #[test]
    fn the_zero_of_a_coarse_gauge_is_a_value() {
        let mut values: Vec<f64> = vec![5.0; 200];
        values[50] = 0.0;
        values[120..].fill(10.0);
        assert_eq!(found(Kind::Displacement, &values), Found::default());
    }

    #[test]
    fn zeros_of_a_lost_contact_are_found_although_the_machine_moves_on() {
        let mut values: Vec<f64> = (0..200u32).map(|row| 4.0 + 0.1 * f64::from(row)).collect();
        values[20..80].fill(0.0);
        assert_eq!(found(Kind::Displacement, &values).sentinels, (20..80).collect::<Vec<usize>>());
    }

    #[test]
    fn values_that_a_machine_reaches_are_kept() {
        let warm: Vec<f64> = (0..200u32).map(|row| 80.0 + 0.05 * f64::from(row)).collect();
        assert_eq!(found(Kind::Temperature, &warm), Found::default(), "a spindle passes 85.0 °C");
        let cold: Vec<f64> = (0..200u32).map(|row| -1.0 + 0.01 * f64::from(row)).collect();
        assert_eq!(found(Kind::Temperature, &cold), Found::default());
        let through: Vec<f64> = (0..200u32).map(|row| -10.0 + 0.1 * f64::from(row)).collect();
        assert_eq!(found(Kind::Displacement, &through), Found::default(), "an error passes zero");
        let mut zeroed = drift();
        zeroed[100..].iter_mut().for_each(|value| *value -= 16.0);
        zeroed[100] = 0.0;
        assert_eq!(
            found(Kind::Displacement, &zeroed).sentinels,
            Vec::<usize>::new(),
            "a new zero is no fault"
        );
        let places: Vec<f64> = (0..200u32)
            .map(|row| [0.0, 0.0, 0.0, 15.0, 15.0, 15.0, 20.0, 20.0, 20.0][(row % 9) as usize])
            .collect();
        assert_eq!(found(Kind::Displacement, &places), Found::default(), "an error at three places");
        let constant = vec![850.0; 50];
        assert_eq!(
            found(Kind::Temperature, &constant),
            Found::default(),
            "a constant sensor is reported as constant"
        );
    }

    #[test]
    fn a_jump_that_stays_is_found_and_its_values_are_kept() {
        let mut values = drift();
        values[100..].iter_mut().for_each(|value| *value -= 300.0);
        assert_eq!(found(Kind::Displacement, &values), Found { lasting: vec![100], ..Found::default() });
        assert_eq!(found(Kind::Position, &values), Found::default());
        let mut slow = drift();
        (100..110u32).for_each(|row| slow[row as usize] -= 30.0 * f64::from(row - 99));
        slow[110..].iter_mut().for_each(|value| *value -= 300.0);
        assert_eq!(found(Kind::Displacement, &slow).lasting, Vec::<usize>::new(), "it moves over ten rows");
    }

    #[test]
    fn a_jump_that_returns_is_found_in_displacements_only() {
        let mut values = drift();
        values[50] = 180.0;
        values[51] = 181.0;
        assert_eq!(found(Kind::Displacement, &values), Found { jumps: vec![50, 51], ..Found::default() });
        assert_eq!(found(Kind::Other, &values), Found::default());
    }
}

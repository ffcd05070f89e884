//! Repair of sensor faults. A fault affects the readings of a sensor in one run. The faulty readings are replaced if a
//! test on the good runs shows that this is accurate enough. The neighbours of a sensor are the other sensors.
//!
//! - Spikes are replaced by straight lines.
//! - After a permanent jump, the step is subtracted from the readings. The size of the step is estimated from the
//!   neighbours and the good runs.
//! - Rows of a freeze are masked: no model is identified from these rows or tested on them. The lagged values of later
//!   rows depend on the masked readings, so these are rebuilt from the neighbours. If that is not possible, the
//!   readings are treated as missing, and a straight line bridges them for the lags. If less than [`LEFT_OF_RUN`] of a
//!   run would remain, the rows are not masked, and the rebuilt readings are used for identification.
//!
//! A sensor is left out of every run in these cases:
//! - It jumps or spikes in most runs, jumps too often in one run, or is constant or missing.
//! - The error of the repair of a jump is more than [`LARGEST_ERROR`] times the change of the readings in good runs.
//! - It was frozen for more than [`MASKED`] of the time.
//! - Less than [`LEAST_OF_RUN`] of a run would remain after masking, and the readings cannot be rebuilt.
//!
//! Replacements are computed only from temperatures, never from the measured error, and never from a held-out run.

use std::collections::HashMap;

use super::rebuild::{Likeness, Replaced, bridged};
use super::{Damage, Fault, Finding, Frozen, Repaired, faults};
use crate::dataset::{Dataset, Run};
use crate::statistics::count;

/// Largest accepted error of rebuilt readings, as a ratio to the change of the sensor's readings (root mean square
/// about the mean of the run). To measure the error, hours of good runs are hidden and rebuilt.
const LARGEST_ERROR: f64 = 0.8;
/// Maximum number of jumps in one run. A sensor with more jumps has a loose contact.
const MOST_JUMPS: usize = 3;
/// Maximum share of the time of all runs for which a sensor may be frozen. A sensor that was frozen for longer is left
/// out.
const MASKED: f64 = 0.25;
/// Minimum share of the rows of a run that must remain unmasked. If fewer would remain, the rows are not
/// masked, and the rebuilt readings are used for identification.
const LEFT_OF_RUN: f64 = 0.25;
/// Minimum share of the rows of a run that must remain unmasked if the readings cannot be rebuilt. If fewer would
/// remain, the sensor is left out.
const LEAST_OF_RUN: f64 = 0.05;

/// Logs as recorded, and the faults that are repaired in them.
#[derive(Clone, Debug)]
pub(crate) struct Mending<'a> {
    logs: &'a Dataset,
    /// Log columns of the sensors that are not left out.
    columns: Vec<usize>,
    faults: Vec<Fault>,
}

/// Result of the repair of all sensor faults: the repaired sensors, and the sensors that are left out.
#[derive(Clone, Debug)]
pub(crate) struct Mended<'a> {
    /// Data with which the logs can be repaired again without a held-out run; `None` if nothing was repaired.
    pub(crate) mending: Option<Mending<'a>>,
    pub(crate) excluded: Vec<Finding>,
    pub(crate) repaired: Vec<Repaired>,
}

/// Description of how a fault was repaired; `None` if no accurate repair is possible.
type Done = Option<String>;

/// Finds the faults of the sensors in these log columns. Repairs these faults, and the freezes in `frozen`, if
/// possible.
pub(crate) fn mend<'a>(logs: &'a Dataset, columns: &[usize], frozen: &[Frozen]) -> Mended<'a> {
    let frozen: Vec<Frozen> =
        frozen.iter().copied().filter(|frozen| columns.contains(&frozen.column)).collect();
    let mut found = faults(logs, columns, &frozen);
    found.extend(frozen.iter().map(|frozen| Fault::frozen(logs, frozen)));
    let good: Vec<usize> =
        columns.iter().copied().filter(|column| !is_hopeless(logs, &found, *column)).collect();
    let tried: Vec<usize> = (0..found.len()).filter(|place| good.contains(&found[*place].column)).collect();
    let faults = tried.iter().map(|place| found[*place].clone()).collect();
    let mut mending = Mending { logs, columns: good, faults };
    let (_, done) = mending.dataset(None);
    let mut tried: Vec<(usize, Done)> = tried.into_iter().zip(done).collect();
    // Shortest first: each fault is masked if enough of its run is left, together with the earlier masks.
    tried.sort_by_key(|(place, _)| found[*place].rows.len());
    let mut masks: Vec<Vec<bool>> = logs.runs.iter().map(|run| vec![false; run.times.len()]).collect();
    let mut outcomes: HashMap<usize, Done> = HashMap::new();
    for (place, done) in tried {
        let (damage, done) = settled(&found[place], &mut masks, done);
        found[place].damage = damage;
        outcomes.insert(place, done);
    }
    let is_lost = |(place, done): (&usize, &Done)| done.is_none().then_some(found[*place].column);
    let lost: Vec<usize> = outcomes.iter().filter_map(is_lost).collect();
    let shares: HashMap<usize, f64> =
        columns.iter().map(|column| (*column, masked_share(logs, &found, *column))).collect();
    mending.columns.retain(|column| !lost.contains(column));
    mending.faults.clear();
    let (mut excluded, mut repaired) = (Vec::new(), Vec::new());
    for (place, fault) in found.into_iter().enumerate() {
        match (outcomes.remove(&place), fault.run) {
            (Some(Some(done)), Some(run)) if !lost.contains(&fault.column) => {
                repaired.push(Repaired {
                    signal: logs.columns[fault.column].name.clone(),
                    run: logs.runs[run].name.clone(),
                    fault: fault.message.clone(),
                    done,
                });
                mending.faults.push(fault);
            }
            (Some(None), _) => {
                excluded.push(fault.finding(logs, " (the readings of this sensor cannot be repaired)"))
            }
            _ => {
                let share = shares.get(&fault.column).copied().unwrap_or_default();
                let more = match fault.damage.is_frozen() && share > MASKED {
                    true => format!(" (frozen for {:.0} % of the time of all runs in total)", 100.0 * share),
                    false => String::new(),
                };
                excluded.push(fault.finding(logs, &more));
            }
        }
    }
    let mending = Some(mending).filter(|mending| !mending.faults.is_empty());
    Mended { mending, excluded, repaired }
}

/// Returns whether a sensor must be left out. The reasons are jumps or spikes in most runs, too many jumps in
/// one run, a freeze for too long, or unknown faulty rows.
fn is_hopeless(logs: &Dataset, found: &[Fault], column: usize) -> bool {
    let own = || found.iter().filter(move |fault| fault.column == column);
    let mut runs: Vec<usize> =
        own().filter(|fault| !fault.damage.is_frozen()).filter_map(|fault| fault.run).collect();
    runs.sort_unstable();
    runs.dedup();
    let jumps =
        |run: usize| own().filter(|fault| fault.run == Some(run) && fault.damage == Damage::Jump).count();
    own().any(|fault| fault.damage == Damage::Whole)
        || 2 * runs.len() > logs.runs.len()
        || runs.iter().any(|run| jumps(*run) > MOST_JUMPS)
        || masked_share(logs, found, column) > MASKED
}

/// Returns the share of the time of all runs in which the sensor of a column was frozen. Rows are weighted by their
/// duration, because runs may have different numbers of rows per minute.
fn masked_share(logs: &Dataset, found: &[Fault], column: usize) -> f64 {
    let (mut frozen, mut all) = (0.0, 0.0);
    for (number, run) in logs.runs.iter().enumerate() {
        let lasts = run.lasts().as_secs_f64();
        let own = found.iter().filter(|fault| fault.column == column && fault.run == Some(number));
        let rows: usize = own.filter(|fault| fault.damage.is_frozen()).map(|fault| fault.rows.len()).sum();
        frozen += lasts * count(rows) / count(run.times.len()).max(1.0);
        all += lasts;
    }
    frozen / f64::max(all, 1.0)
}

/// Decides whether the rows of a freeze are masked or rebuilt. Returns the kind of damage and the repair; the
/// repair is `None` if the sensor must be left out. `masks` contains for each row of each run whether the row
/// is masked. If enough other rows of the run remain, the rows of this fault are masked as well.
fn settled(fault: &Fault, masks: &mut [Vec<bool>], done: Done) -> (Damage, Done) {
    let (Damage::Frozen, Some(run)) = (fault.damage, fault.run) else { return (fault.damage, done) };
    let mut mask = masks[run].clone();
    fault.rows.iter().for_each(|row| mask[*row] = true);
    let left = count(mask.iter().filter(|masked| !**masked).count()) / count(mask.len()).max(1.0);
    let is_masked = left >= if done.is_some() { LEFT_OF_RUN } else { LEAST_OF_RUN };
    if is_masked {
        masks[run] = mask;
    }
    match (done, is_masked) {
        (Some(done), true) => (
            Damage::Frozen,
            Some(format!(
                "these rows were masked, so no model uses them; for the lagged values of later rows, {done}"
            )),
        ),
        (Some(done), false) => (Damage::Rebuilt, Some(done)),
        (None, true) => {
            (Damage::Missing, Some("these rows were masked: the model is identified without them".to_owned()))
        }
        (None, false) => (Damage::Missing, None),
    }
}

impl Mending<'_> {
    /// Returns the repaired logs, from which models are identified.
    pub(crate) fn mended(&self) -> Dataset {
        self.dataset(None).0
    }

    /// Returns the rows of a run that no model uses, because some sensor was frozen in them.
    pub(crate) fn masked(&self, run: usize) -> Vec<usize> {
        let is_masked = |fault: &&Fault| {
            fault.run == Some(run) && matches!(fault.damage, Damage::Frozen | Damage::Missing)
        };
        self.faults.iter().filter(is_masked).flat_map(|fault| fault.rows.iter().copied()).collect()
    }

    /// Returns the logs, repaired without data from this run. `None` if no repair uses data from it.
    pub(crate) fn never_saw(&self, run: usize) -> Option<Dataset> {
        let needs = |fault: &Fault| {
            fault.run != Some(run) && !matches!(fault.damage, Damage::Spikes | Damage::Missing)
        };
        self.faults.iter().any(needs).then(|| self.dataset(Some(run)).0)
    }

    /// Returns the logs with all possible repairs, and for each fault the description of its repair. `unseen` is a run
    /// whose data must not be used for the repairs.
    fn dataset(&self, unseen: Option<usize>) -> (Dataset, Vec<Done>) {
        let mut dataset = self.logs.clone();
        let mut done: Vec<Done> = vec![None; self.faults.len()];
        // Spikes come first, because they need no other sensor. Steps come before freezes, so that a freeze is tied to
        // readings of one level.
        let mut order: Vec<usize> = (0..self.faults.len()).collect();
        order.sort_by_key(|place| self.faults[*place].damage);
        for place in order {
            let fault = &self.faults[place];
            if let Some(run) = fault.run
                && fault.damage != Damage::Missing
                && let Some(replaced) = self.replaced(&dataset, fault, run, unseen)
            {
                dataset.runs[run].values[fault.column] = replaced.values.into();
                done[place] = Some(replaced.message);
            }
        }
        // The values of unrepaired rows are unknown, so they are missing.
        for (fault, done) in self.faults.iter().zip(&done) {
            let is_unknown = done.is_none() && unseen.is_some() && fault.damage != Damage::Spikes;
            if let Some(run) = fault.run
                && (is_unknown || fault.damage == Damage::Missing)
            {
                dataset.runs[run].values[fault.column]
                    .change(|values| fault.rows.iter().for_each(|row| values[*row] = f64::NAN));
            }
        }
        (dataset, done)
    }

    /// Returns the repaired readings of the faulty sensor in a run; `None` if no accurate repair is possible.
    fn replaced(
        &self,
        dataset: &Dataset,
        fault: &Fault,
        run: usize,
        unseen: Option<usize>,
    ) -> Option<Replaced> {
        if fault.damage == Damage::Spikes {
            return Some(over_spikes(&dataset.runs[run], fault));
        }
        let worse = || self.faults.iter().filter(|other| other.damage != Damage::Spikes);
        let is_good = |column: &usize| !worse().any(|other| other.column == *column);
        let neighbours: Vec<usize> = self.columns.iter().copied().filter(is_good).collect();
        let is_donor = |run: &usize| {
            let is_spoilt = worse().any(|other| other.column == fault.column && other.run == Some(*run));
            Some(*run) != unseen && !is_spoilt
        };
        let donors: Vec<usize> = (0..dataset.runs.len()).filter(is_donor).collect();
        // If one of two good runs is held out, the other one must suffice.
        if neighbours.is_empty() || donors.len() + usize::from(unseen.is_some()) < 2 {
            return None;
        }
        let likeness = Likeness::new(dataset, fault.column, neighbours, &donors);
        let replaced = match fault.damage {
            Damage::Jump => likeness.without_step(run, &fault.rows)?,
            _ => likeness.rebuilt(run, &fault.rows)?,
        };
        // A replacement was accepted or rejected with all runs. It is not judged again here.
        let is_accepted = unseen.is_some() || replaced.error < LARGEST_ERROR * likeness.moves();
        is_accepted.then_some(replaced)
    }
}

fn over_spikes(run: &Run, fault: &Fault) -> Replaced {
    let seconds: Vec<f64> = run.seconds().collect();
    let mut values = run.values[fault.column].to_vec();
    fault.rows.iter().for_each(|row| values[*row] = f64::NAN);
    let lines = bridged(&seconds, &values);
    fault.rows.iter().for_each(|row| values[*row] = lines[*row]);
    let message = "these minutes were filled by linear interpolation".to_owned();
    Replaced { values, message, error: 0.0 }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::dataset::{Column, Kind, Origin};
    use isotherm_core::quantity::Moment;

    /// Run of 100 minutes in which each sensor moves independently. `dense`: rows in each minute.
    fn run(number: u32, sensors: u32, dense: u32) -> Run {
        let minute = |row: u32| f64::from(row) / f64::from(dense);
        let rows = || 0..100 * dense;
        let nanos = |row: u32| u64::from(row) * 60_000_000_000 / u64::from(dense);
        let reading = |sensor: u32, row: u32| {
            20.0 + 2.0 * (minute(row) / f64::from(15 + 4 * sensor) + f64::from(number)).sin()
        };
        Run {
            name: format!("day{number}"),
            file: PathBuf::from("day.csv"),
            times: rows().map(|row| Moment::from_nanos(nanos(row))).collect(),
            values: (0..sensors).map(|sensor| rows().map(|row| reading(sensor, row)).collect()).collect(),
            origin: Origin::default(),
        }
    }

    fn logs(runs: Vec<Run>) -> Dataset {
        let sensors = 0..runs[0].values.len();
        let column = |sensor: usize| Column { name: format!("s{sensor}"), kind: Kind::Temperature };
        Dataset { columns: sensors.map(column).collect(), runs, ..Dataset::default() }
    }

    fn frozen(column: usize, run: usize, first: usize, last: usize) -> Frozen {
        Frozen { column, run, first, last, lasts_to_the_end: false, missed: 1.0 }
    }

    #[test]
    fn a_freeze_that_nothing_can_rebuild_is_masked_if_it_leaves_a_part_of_its_run() {
        let logs = logs((0..4).map(|number| run(number, 1, 1)).collect());
        let mended = mend(&logs, &[0], &[frozen(0, 1, 10, 99)]);
        assert_eq!(mended.excluded, []);
        assert!(
            mended.repaired[0].done.contains("masked: the model is identified without them"),
            "{:?}",
            mended.repaired
        );
        let mending = mended.mending.unwrap();
        assert_eq!(mending.masked(1), (11..100).collect::<Vec<usize>>());
        assert!(mending.mended().runs[1].values[0].at(50).is_nan(), "nobody knows what it was");
        let whole = mend(&logs, &[0], &[frozen(0, 1, 0, 99)]);
        assert!(whole.mending.is_none() && whole.repaired.is_empty());
        assert!(
            whole.excluded[0].reason.contains("the readings of this sensor cannot be repaired"),
            "{:?}",
            whole.excluded
        );
    }

    #[test]
    fn two_sensors_that_froze_one_after_the_other_leave_a_run_its_rows() {
        let logs = logs((0..4).map(|number| run(number, 2, 1)).collect());
        let mended = mend(&logs, &[0, 1], &[frozen(0, 1, 0, 59), frozen(1, 1, 30, 99)]);
        let named = |found: &[Finding]| found.iter().map(|own| own.signal.clone()).collect::<Vec<String>>();
        assert_eq!(named(&mended.excluded), ["s1"], "it is frozen for longer");
        assert_eq!(mended.repaired.len(), 1, "{:?}", mended.repaired);
        assert_eq!(mended.mending.unwrap().masked(1), (1..60).collect::<Vec<usize>>());
    }

    #[test]
    fn how_long_a_sensor_was_frozen_counts_by_time_whatever_the_rows_of_a_run_are() {
        let runs = [10, 1, 1, 1].into_iter().zip(0..).map(|(dense, number)| run(number, 1, dense));
        let logs = logs(runs.collect());
        // 400 of 1300 rows, but 40 of 400 minutes.
        let mended = mend(&logs, &[0], &[frozen(0, 0, 100, 500)]);
        assert_eq!((mended.excluded.len(), mended.repaired.len()), (0, 1), "{:?}", mended.excluded);
        // 160 of 1300 rows, but 160 of 400 minutes.
        let often = [frozen(0, 1, 10, 90), frozen(0, 2, 10, 90)];
        assert_eq!(mend(&logs, &[0], &often).excluded.len(), 2);
    }
}

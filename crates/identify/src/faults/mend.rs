//! A fault spoils one run, not the sensor: what it spoilt is replaced, where the good runs show that it can be.
//!
//! - Spikes are bridged by straight lines.
//! - After a jump that stays, the readings are taken less the step, as its neighbours and the good runs show it.
//! - Rows in which it was frozen are masked: no model is learnt from them or judged by them. For the lags that still see
//!   them, the readings are rebuilt from its neighbours; if these cannot, they are missing, and a lag crosses them in a straight
//!   line.
//!
//! A sensor is left out of every run where it jumps or spikes in most of them, where nobody knows which rows are faulty (constant,
//! missing), where the replacement of a jump leaves more than [`BELIEVED`] of what the sensor moves, and where more than
//! [`MASKED`] of its rows are masked.
//!
//! Replacements are learnt from temperatures alone, never from the error; and where a run is held out, it is no donor.

use std::collections::HashMap;

use super::rebuild::{Likeness, Replaced, bridged};
use super::{Damage, Fault, Finding, Frozen, Repaired, faults};
use crate::dataset::{Dataset, Run};
use crate::statistics::count;

/// Of the root mean square that a sensor moves: the most that its replacement may be off by, as hidden hours of good runs
/// tell.
const BELIEVED: f64 = 0.8;
/// A sensor that jumps more often in one run is loose.
const MOST_JUMPS: usize = 3;
/// Share of a sensor's rows: it is left out where more are masked.
const MASKED: f64 = 0.25;
/// Share of a run's rows: where a freeze leaves less of its run, rebuilt readings are learnt from, so that the run stays.
const LEFT_OF_RUN: f64 = 0.25;

/// The logs, and what is replaced in them.
#[derive(Clone, Debug)]
pub(crate) struct Mending<'a> {
    logs: &'a Dataset,
    /// The sensors that stay in.
    columns: Vec<usize>,
    faults: Vec<Fault>,
}

/// What became of the faults.
#[derive(Clone, Debug)]
pub(crate) struct Mended<'a> {
    /// What must be mended again where a run may not be seen; `None`: nothing was faulty.
    pub(crate) mending: Option<Mending<'a>>,
    pub(crate) excluded: Vec<Finding>,
    pub(crate) repaired: Vec<Repaired>,
}

/// What was put in place of a fault's rows, as a sentence; `None`: nothing that may be believed.
type Done = Option<String>;

/// Finds the faults of these columns of temperatures, and which of them and of the freezes among them can be mended.
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
    let mut outcomes: HashMap<usize, Done> = HashMap::new();
    for (place, done) in tried.into_iter().zip(done) {
        let (damage, done) = settled(logs, &found, place, done);
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
            (Some(None), _) => excluded.push(fault.finding(logs, ", which no other sensor can replace,")),
            _ => {
                let share = shares.get(&fault.column).copied().unwrap_or_default();
                let more = match fault.damage.is_frozen() && share > MASKED {
                    true => format!(", as it is in {:.0} % of all its rows,", 100.0 * share),
                    false => String::new(),
                };
                excluded.push(fault.finding(logs, &more));
            }
        }
    }
    let mending = Some(mending).filter(|mending| !mending.faults.is_empty());
    Mended { mending, excluded, repaired }
}

/// A sensor that jumps or spikes in most runs, is loose, has a fault of which nobody knows the rows, or was frozen too long.
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

/// Share of the rows of all runs in which a column was frozen.
fn masked_share(logs: &Dataset, found: &[Fault], column: usize) -> f64 {
    let rows: usize = logs.runs.iter().map(|run| run.times.len()).sum();
    count(frozen_rows(found, column, None)) / count(rows).max(1.0)
}

/// Number of rows in which a column was frozen, in one run or in all.
fn frozen_rows(found: &[Fault], column: usize, run: Option<usize>) -> usize {
    let own = found.iter().filter(|fault| fault.column == column && fault.damage.is_frozen());
    own.filter(|fault| run.is_none() || fault.run == run).map(|fault| fault.rows.len()).sum()
}

/// What becomes of a fault once it was tried to be mended. A freeze that cannot be rebuilt is masked all the same.
fn settled(logs: &Dataset, found: &[Fault], place: usize, done: Done) -> (Damage, Done) {
    let fault = &found[place];
    let (Damage::Frozen, Some(run)) = (fault.damage, fault.run) else { return (fault.damage, done) };
    let rows = count(logs.runs[run].times.len()).max(1.0);
    let left = 1.0 - count(frozen_rows(found, fault.column, Some(run))) / rows;
    match done {
        Some(done) if left < LEFT_OF_RUN => (Damage::Rebuilt, Some(done)),
        None if left < LEFT_OF_RUN => (Damage::Missing, None),
        Some(done) => (Damage::Frozen, Some(format!("these rows were masked, and for its lags {done}"))),
        None => (Damage::Missing, Some("these rows were masked: nothing is learnt from them".to_owned())),
    }
}

impl Mending<'_> {
    /// The logs as they are learnt from.
    pub(crate) fn mended(&self) -> Dataset {
        self.dataset(None).0
    }

    /// Rows of a run that no model is learnt from or judged by: some sensor was frozen in them.
    pub(crate) fn masked(&self, run: usize) -> Vec<usize> {
        let is_masked = |fault: &&Fault| {
            fault.run == Some(run) && matches!(fault.damage, Damage::Frozen | Damage::Missing)
        };
        self.faults.iter().filter(is_masked).flat_map(|fault| fault.rows.iter().copied()).collect()
    }

    /// The same where this run was never seen; `None`: it was needed for nothing.
    pub(crate) fn never_saw(&self, run: usize) -> Option<Dataset> {
        let needs = |fault: &Fault| {
            fault.run != Some(run) && !matches!(fault.damage, Damage::Spikes | Damage::Missing)
        };
        self.faults.iter().any(needs).then(|| self.dataset(Some(run)).0)
    }

    /// The logs with every fault mended as far as it can be, and by fault what was done.
    fn dataset(&self, unseen: Option<usize>) -> (Dataset, Vec<Done>) {
        let mut dataset = self.logs.clone();
        let mut done: Vec<Done> = vec![None; self.faults.len()];
        // Spikes first: they need no other sensor. Then steps, so that what was frozen is tied to readings of one level.
        let mut order: Vec<usize> = (0..self.faults.len()).collect();
        order.sort_by_key(|place| self.faults[*place].damage);
        for place in order {
            let fault = &self.faults[place];
            if let Some(run) = fault.run
                && fault.damage != Damage::Missing
                && let Some(replaced) = self.replaced(&dataset, fault, run, unseen)
            {
                dataset.runs[run].values[fault.column] = replaced.values;
                done[place] = Some(replaced.message);
            }
        }
        // Nobody knows what they were: the rows are missing then.
        for (fault, done) in self.faults.iter().zip(&done) {
            let is_unknown = done.is_none() && unseen.is_some() && fault.damage != Damage::Spikes;
            if let Some(run) = fault.run
                && (is_unknown || fault.damage == Damage::Missing)
            {
                let values = &mut dataset.runs[run].values[fault.column];
                fault.rows.iter().for_each(|row| values[*row] = f64::NAN);
            }
        }
        (dataset, done)
    }

    /// The run's column as it should have been, where that may be believed.
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
        // One of two good runs may be held out, and the other must do then.
        if neighbours.is_empty() || donors.len() + usize::from(unseen.is_some()) < 2 {
            return None;
        }
        let likeness = Likeness::new(dataset, fault.column, neighbours, &donors);
        let replaced = match fault.damage {
            Damage::Jump => likeness.without_step(run, &fault.rows)?,
            _ => likeness.rebuilt(run, &fault.rows)?,
        };
        // Whether it may be believed was asked when all runs were seen.
        let is_believed = unseen.is_some() || replaced.error < BELIEVED * likeness.moves();
        is_believed.then_some(replaced)
    }
}

fn over_spikes(run: &Run, fault: &Fault) -> Replaced {
    let seconds: Vec<f64> = run.seconds().collect();
    let mut values = run.values[fault.column].clone();
    fault.rows.iter().for_each(|row| values[*row] = f64::NAN);
    let lines = bridged(&seconds, &values);
    fault.rows.iter().for_each(|row| values[*row] = lines[*row]);
    let message = "these minutes were bridged by straight lines".to_owned();
    Replaced { values, message, error: 0.0 }
}

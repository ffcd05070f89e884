//! A fault spoils one run, not the sensor: what it spoilt is replaced, where the good runs show that it can be.
//!
//! - Spikes are bridged by straight lines.
//! - After a jump that stays, the readings are taken less the step, as its neighbours and the good runs show it.
//! - Where it was stuck, the readings are rebuilt from its neighbours.
//!
//! A sensor is left out of every run where it is faulty in most of them, where nobody knows which rows are faulty (constant, missing),
//! and where a replacement leaves more than [`BELIEVED`] of what the sensor moves.
//!
//! Replacements are learnt from temperatures alone, never from the error; and where a run is held out, it is no donor.

use std::collections::HashMap;

use super::rebuild::{Likeness, Replaced, bridged};
use super::{Damage, Fault, Finding, Frozen, Repaired, faults};
use crate::dataset::{Dataset, Run};

/// Of the root mean square that a sensor moves: the most that its replacement may be off by, as hidden hours of good runs
/// tell.
const BELIEVED: f64 = 0.8;
/// A sensor that jumps more often in one run is loose.
const MOST_JUMPS: usize = 3;

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

/// Finds the faults of these columns of temperatures, and which of them and of those that were found otherwise can be mended.
pub(crate) fn mend<'a>(logs: &'a Dataset, columns: &[usize], frozen: &[Frozen]) -> Mended<'a> {
    let frozen = frozen.iter().filter(|frozen| columns.contains(&frozen.column));
    let mut found = faults(logs, columns);
    found.extend(frozen.map(|frozen| Fault::frozen(logs, frozen)));
    let good: Vec<usize> =
        columns.iter().copied().filter(|column| !is_hopeless(logs, &found, *column)).collect();
    let tried: Vec<usize> = (0..found.len()).filter(|place| good.contains(&found[*place].column)).collect();
    let faults = tried.iter().map(|place| found[*place].clone()).collect();
    let mut mending = Mending { logs, columns: good, faults };
    let (_, done) = mending.dataset(None);
    let mut done: HashMap<usize, Done> = tried.into_iter().zip(done).collect();
    let is_lost = |(place, done): (&usize, &Done)| done.is_none().then_some(found[*place].column);
    let lost: Vec<usize> = done.iter().filter_map(is_lost).collect();
    mending.columns.retain(|column| !lost.contains(column));
    mending.faults.clear();
    let (mut excluded, mut repaired) = (Vec::new(), Vec::new());
    for (place, fault) in found.into_iter().enumerate() {
        match (done.remove(&place), fault.run) {
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
            _ => excluded.push(fault.finding(logs, "")),
        }
    }
    let mending = Some(mending).filter(|mending| !mending.faults.is_empty());
    Mended { mending, excluded, repaired }
}

/// A sensor that is faulty in most runs, is loose, or has a fault of which nobody knows the rows.
fn is_hopeless(logs: &Dataset, found: &[Fault], column: usize) -> bool {
    let own = || found.iter().filter(move |fault| fault.column == column);
    let mut runs: Vec<usize> = own().filter_map(|fault| fault.run).collect();
    runs.sort_unstable();
    runs.dedup();
    let jumps =
        |run: usize| own().filter(|fault| fault.run == Some(run) && fault.damage == Damage::Jump).count();
    own().any(|fault| fault.damage == Damage::Whole)
        || 2 * runs.len() > logs.runs.len()
        || runs.iter().any(|run| jumps(*run) > MOST_JUMPS)
}

impl Mending<'_> {
    /// The logs as they are learnt from.
    pub(crate) fn mended(&self) -> Dataset {
        self.dataset(None).0
    }

    /// The same where this run was never seen; `None`: it was needed for nothing.
    pub(crate) fn never_saw(&self, run: usize) -> Option<Dataset> {
        let needs = |fault: &Fault| fault.run != Some(run) && fault.damage != Damage::Spikes;
        self.faults.iter().any(needs).then(|| self.dataset(Some(run)).0)
    }

    /// The logs with every fault mended as far as it can be, and by fault what was done.
    fn dataset(&self, unseen: Option<usize>) -> (Dataset, Vec<Done>) {
        let mut dataset = self.logs.clone();
        let mut done: Vec<Done> = vec![None; self.faults.len()];
        // Spikes first: they need no other sensor. Then steps, so that what was stuck is tied to readings of one level.
        let mut order: Vec<usize> = (0..self.faults.len()).collect();
        order.sort_by_key(|place| self.faults[*place].damage);
        for place in order {
            let fault = &self.faults[place];
            if let Some(run) = fault.run
                && let Some(replaced) = self.replaced(&dataset, fault, run, unseen)
            {
                dataset.runs[run].values[fault.column] = replaced.values;
                done[place] = Some(replaced.message);
            }
        }
        // Nobody knows what they were: the rows are missing then.
        for (fault, done) in self.faults.iter().zip(&done) {
            if let (Some(run), None, Some(_)) = (fault.run, done, unseen)
                && fault.damage != Damage::Spikes
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

//! A fault spoils one run, not the sensor: what it spoilt is replaced, where the good runs show that it can be.
//!
//! - Spikes are bridged by straight lines.
//! - After a jump that stays, the readings are taken less the step, as its neighbours and the good runs tell it.
//! - Where it was stuck, the readings are rebuilt from its neighbours.
//!
//! A sensor is left out of every run where it is faulty in most of them, where it has no telling fault (constant, missing),
//! and where a replacement leaves more than [`BELIEVED`] of what the sensor moves.
//!
//! Replacements are learnt from temperatures alone, never from the error; and where a run is held out, it is no donor.

use super::rebuild::Likeness;
use super::{Damage, Excluded, Fault, Repaired, faults, rows};
use crate::dataset::Dataset;

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
    pub(crate) excluded: Vec<Excluded>,
    pub(crate) repaired: Vec<Repaired>,
}

/// What was put in place of a fault's rows, in words; `None`: nothing that may be believed.
type Done = Option<String>;

/// A run's column as it should have been.
struct Replaced {
    values: Vec<f64>,
    words: String,
    /// Root mean square, °C.
    error: f64,
}

/// Finds the faults of these columns of temperatures, and which of them can be mended.
pub(crate) fn mend<'a>(logs: &'a Dataset, columns: &[usize]) -> Mended<'a> {
    let found = faults(logs, columns);
    let hopeless = |column: usize| {
        let own = || found.iter().filter(move |fault| fault.column == column);
        let mut runs: Vec<usize> = own().filter_map(|fault| fault.run).collect();
        runs.dedup();
        let jumps = |run: usize| {
            own().filter(|fault| fault.run == Some(run) && matches!(fault.damage, Damage::Jump(_))).count()
        };
        own().any(|fault| fault.damage == Damage::Whole)
            || 2 * runs.len() > logs.runs.len()
            || runs.iter().any(|run| jumps(*run) > MOST_JUMPS)
    };
    let good: Vec<usize> = columns.iter().copied().filter(|column| !hopeless(*column)).collect();
    let faults = found.iter().filter(|fault| good.contains(&fault.column)).cloned().collect();
    let mut mending = Mending { logs, columns: good, faults };
    let (_, done) = mending.dataset(None);
    let told: Vec<(Fault, Done)> = mending.faults.drain(..).zip(done).collect();
    let is_lost = |column: usize| told.iter().any(|(fault, done)| fault.column == column && done.is_none());
    let mut excluded: Vec<Excluded> = Vec::new();
    for fault in &found {
        let cannot = told.iter().any(|(other, done)| other == fault && done.is_none());
        let words = if cannot {
            format!("{}, which no other sensor can replace,", fault.words)
        } else {
            fault.words.clone()
        };
        if !mending.columns.contains(&fault.column) || is_lost(fault.column) {
            excluded.push(Fault { words, ..fault.clone() }.excluded(logs));
        }
    }
    mending.columns.retain(|column| !is_lost(*column));
    let mut repaired = Vec::new();
    for (fault, done) in &told {
        if let (false, Some(done), Some(run)) = (is_lost(fault.column), done, fault.run) {
            mending.faults.push(fault.clone());
            repaired.push(Repaired {
                signal: logs.columns[fault.column].name.clone(),
                run: logs.runs[run].name.clone(),
                fault: fault.words.clone(),
                done: done.clone(),
            });
        }
    }
    let mending = Some(mending).filter(|mending| !mending.faults.is_empty());
    Mended { mending, excluded, repaired }
}

impl Mending<'_> {
    /// The logs as they are learnt from.
    pub(crate) fn mended(&self) -> Dataset {
        self.dataset(None).0
    }

    /// The same where this run was never seen; `None`: it was needed for nothing.
    pub(crate) fn never_saw(&self, run: usize) -> Option<Dataset> {
        let needs = |fault: &Fault| fault.run != Some(run) && !matches!(fault.damage, Damage::Spikes(_));
        self.faults.iter().any(needs).then(|| self.dataset(Some(run)).0)
    }

    fn dataset(&self, unseen: Option<usize>) -> (Dataset, Vec<Done>) {
        let mut dataset = self.logs.clone();
        let mut done: Vec<Done> = vec![None; self.faults.len()];
        // Spikes first: they need nobody. Then steps, so that what was stuck is tied to readings of one level.
        for (place, fault) in self.each(|damage| matches!(damage, Damage::Spikes(_))) {
            done[place] = bridge(&mut dataset, fault);
        }
        for (place, fault) in self.each(|damage| matches!(damage, Damage::Jump(_))) {
            done[place] = self.with_likeness(&dataset, fault, unseen, step).map(|(shifted, words)| {
                dataset.runs[fault.run.unwrap_or(0)].values[fault.column] = shifted;
                words
            });
        }
        for (place, fault) in self.each(|damage| matches!(damage, Damage::Stuck(..))) {
            done[place] = self.with_likeness(&dataset, fault, unseen, rebuild).map(|(rebuilt, words)| {
                dataset.runs[fault.run.unwrap_or(0)].values[fault.column] = rebuilt;
                words
            });
        }
        // Nobody left to tell: the rows are missing then.
        for (fault, done) in self.faults.iter().zip(&done) {
            if let (Some(run), None, Some(_)) = (fault.run, done, unseen) {
                let values = &mut dataset.runs[run].values[fault.column];
                let (from, to) = match fault.damage {
                    Damage::Stuck(from, to) => (from, to.min(values.len())),
                    Damage::Jump(row) => (row, values.len()),
                    Damage::Spikes(_) | Damage::Whole => continue,
                };
                values[from..to].fill(f64::NAN);
            }
        }
        (dataset, done)
    }

    fn each(&self, is: impl Fn(&Damage) -> bool) -> impl Iterator<Item = (usize, &Fault)> {
        self.faults.iter().enumerate().filter(move |(_, fault)| is(&fault.damage))
    }

    fn with_likeness(
        &self,
        dataset: &Dataset,
        fault: &Fault,
        unseen: Option<usize>,
        mend: fn(&Likeness<'_>, &Fault) -> Option<Replaced>,
    ) -> Option<(Vec<f64>, String)> {
        let worse = |fault: &&Fault| !matches!(fault.damage, Damage::Spikes(_));
        let is_good = |column: &usize| !self.faults.iter().filter(worse).any(|other| other.column == *column);
        let neighbours: Vec<usize> = self.columns.iter().copied().filter(is_good).collect();
        let is_donor = |run: &usize| {
            let own = |other: &&Fault| other.column == fault.column && other.run == Some(*run);
            Some(*run) != unseen && !self.faults.iter().filter(worse).any(|other| own(&other))
        };
        let donors: Vec<usize> = (0..dataset.runs.len()).filter(is_donor).collect();
        // One of two good runs may be held out, and the other must do then.
        if neighbours.is_empty() || donors.len() + usize::from(unseen.is_some()) < 2 {
            return None;
        }
        let likeness = Likeness { dataset, column: fault.column, neighbours: &neighbours, donors: &donors };
        let mended = mend(&likeness, fault)?;
        // Whether it may be believed was asked when all runs were seen.
        let is_believed = unseen.is_some() || mended.error < BELIEVED * likeness.moves();
        is_believed.then_some((mended.values, mended.words))
    }
}

fn bridge(dataset: &mut Dataset, fault: &Fault) -> Done {
    let (Damage::Spikes(spoilt), Some(run)) = (&fault.damage, fault.run) else { return None };
    let run = &mut dataset.runs[run];
    let seconds: Vec<f64> = run.seconds().collect();
    let mut good = run.values[fault.column].clone();
    spoilt.iter().for_each(|row| good[*row] = f64::NAN);
    let bridged = rows::bridged(&seconds, &good);
    for row in spoilt {
        run.values[fault.column][*row] = bridged[*row];
    }
    Some("these minutes were bridged by straight lines".to_owned())
}

fn step(likeness: &Likeness<'_>, fault: &Fault) -> Option<Replaced> {
    let (Damage::Jump(row), Some(run)) = (&fault.damage, fault.run) else { return None };
    let step = likeness.step(run, *row)?;
    let mut values = likeness.dataset.runs[run].values[fault.column].clone();
    values.iter_mut().skip(*row).for_each(|value| *value -= step.size);
    let words = format!("from there on its readings were taken {:+.2} °C (± {:.2})", -step.size, step.error);
    Some(Replaced { values, words, error: step.error })
}

fn rebuild(likeness: &Likeness<'_>, fault: &Fault) -> Option<Replaced> {
    let (Damage::Stuck(from, to), Some(run)) = (&fault.damage, fault.run) else { return None };
    let rebuilt = likeness.rebuilt(run, (*from, *to))?;
    let mut values = likeness.dataset.runs[run].values[fault.column].clone();
    values.iter_mut().skip(*from).zip(&rebuilt.values).for_each(|(value, rebuilt)| *value = *rebuilt);
    let names: Vec<&str> =
        rebuilt.from.iter().map(|column| likeness.dataset.columns[*column].name.as_str()).collect();
    let words = format!(
        "its readings of that time were rebuilt, mostly from {} (± {:.2} °C where good runs were rebuilt so)",
        names.join(" and "),
        rebuilt.error
    );
    Some(Replaced { values, words, error: rebuilt.error })
}
